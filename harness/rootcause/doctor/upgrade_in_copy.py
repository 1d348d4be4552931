"""Measure an upgrade in throw-away copies of an environment: does a task run, and does it behave the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from harness.machine import store
from harness.machine.store import Store
from harness.model import Outcome
from harness.model.errors import CouldNotTell
from harness.physics import sentences
from harness.physics.comparison import compare
from harness.physics.outputs import Outputs
from harness.probes import array_files
from harness.probes.vault import Vault
from harness.reports.projects.tried_task import TriedTask
from harness.reports.text import progress
from harness.rootcause.bench import Bench, Trial
from harness.rootcause.doctor.environment_copies import EnvironmentCopies, find_python, instant, public_versions
from harness.running import behaviour_runs
from harness.running.scheduler import Observer, Settings

Compared = tuple[bool | None, str]
"""An answer whether a task behaves otherwise; and how, or why that is unknown."""


def try_upgrade(
    python: str, versions: Mapping[str, str], moves: Mapping[str, str], envs: Sequence[str], *, offline: bool
) -> list[TriedTask]:
    """Measure tasks in copies of an environment.

    Args:
        python: The interpreter that the copies are made of.
        versions: The installed versions by name.
        moves: The new versions of the packages that move.
        envs: The ids of the environments.
        offline: Whether only what is in the caches may be used.

    Raises:
        CouldNotTell: This machine cannot measure it.
    """
    base = find_python("upgrade --try", python)
    opened = store.open_store()
    settings = Settings(offline=offline)
    results = []
    with progress.Progress(2 * len(envs), 1, progress.headline) as board, Bench(opened, settings, board) as bench:
        for env in envs:
            copies = EnvironmentCopies(bench=bench, python=base, env=env, as_of=instant(opened))
            installed = public_versions(versions)
            after, left_out = copies.measure({**installed, **moves}, moves)
            before, _ = copies.measure(installed, ())
            if before.untold or after.untold:
                trial = before if before.untold else after
                message = f"upgrade --try: this cannot be decided here: {trial.assessed.decisive}"
                raise CouldNotTell(message)
            compared: Compared = None, "it does not run in both"
            if _runs(before) and _runs(after):
                compared = _compare(before, after, opened, settings, board)
            results.append(_describe(env, before, after, left_out, compared))
    return results


def _describe(env: str, before: Trial, after: Trial, left_out: tuple[str, ...], compared: Compared) -> TriedTask:
    return TriedTask(
        env=env,
        runs_now=before.works,
        runs_then=after.works,
        line=None if after.works else after.assessed.decisive,
        behaves_otherwise=compared[0],
        text=compared[1],
        left_out=left_out,
    )


def _runs(trial: Trial) -> bool:
    """Return whether a task was made and stepped."""
    return trial.assessed.phases.get("single") is Outcome.PASSED  # type: ignore[call-overload]


def _compare(before: Trial, after: Trial, opened: Store, settings: Settings, board: Observer) -> Compared:
    """Return whether a task behaves otherwise in the second copy, and how, from states of the first one.

    None where no state can be set: then the text says why.
    """
    try:
        return _compare_steps(before, after, opened, settings, board)
    except CouldNotTell as error:
        return None, str(error)


def _compare_steps(before: Trial, after: Trial, opened: Store, settings: Settings, board: Observer) -> Compared:
    cells = before.cell, after.cell
    cases = [behaviour_runs.case_of(cell, None) for cell in cells]
    vault = Vault(opened.folder)
    bank = vault.keep(array_files.seal(behaviour_runs.make_bank(cells[0], cases[0], opened, settings, board)))
    outputs = [
        behaviour_runs.step_from(cell, case, bank, opened, settings, board)
        for cell, case in zip(cells, cases, strict=True)
    ]
    mine, theirs = (Outputs(arrays, array_files.facts(arrays)) for arrays in outputs)
    comparison = compare(mine, theirs, behaviour_runs.read_bank(bank, vault))
    return comparison.behaves_otherwise, sentences.describe(comparison)
