"""Try version changes in a throw-away copy of an environment (`doctor --prove`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from harness.machine import store
from harness.model.errors import CouldNotTell
from harness.model.report_types import UNTOLD, word
from harness.reports.text import progress
from harness.rootcause.bench import Bench, Trial
from harness.rootcause.doctor.environment_copies import EnvironmentCopies, find_python, instant, public_versions
from harness.running.scheduler import Settings


class Copied(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one throw-away copy."""

    requirements: tuple[str, ...]
    verdict: str
    phases: dict[str, str]
    decisive: str | None


class Proof(msgspec.Struct, frozen=True, kw_only=True):
    """The result of trying the changes. `before` is the copy without them, `after` with them; None if it was not made.

    `left_out` are packages that could not be copied in their version. `text` is the result as a sentence.
    """

    proven: bool
    text: str
    before: Copied | None = None
    after: Copied | None = None
    left_out: tuple[str, ...] = ()


def proof(document: Mapping[str, Any], *, env: str | None, offline: bool) -> Proof:
    """Try the changes that lead to the nearest known-good combination. Raises CouldNotTell."""
    near = document["nearest"]
    if near is None or not near["changes"]:
        text = "nothing is to be proven: " + ("no change is known" if near is None else "no version has to change")
        return Proof(proven=False, text=text)
    environment = document["environment"]
    changed = {one["name"]: one["then"] for one in near["changes"]}
    python = find_python("doctor --prove", environment["executable"] or environment["python"])
    opened = store.open_store()
    installed = public_versions(environment["packages"])
    with (
        progress.Progress(2, 1, progress.headline) as board,
        Bench(opened, Settings(offline=offline), board) as bench,
    ):
        copies = EnvironmentCopies(bench=bench, python=python, env=env, as_of=instant(opened))
        # The copy with the changes comes first: if it tells nothing, the other one need not be made.
        after, left_out = copies.measure({**installed, **changed}, changed)
        if after.assessed.verdict in UNTOLD:
            message = f"doctor --prove: this cannot be decided here: {after.assessed.decisive}"
            raise CouldNotTell(message)
        before, _ = copies.measure(installed, {})
    return _proof(before, after, left_out)


def _proof(before: Trial, after: Trial, left_out: tuple[str, ...]) -> Proof:
    works = after.works and not before.works
    sentence = f"without the changes a copy {_describe_trial(before)}; with them it {_describe_trial(after)}"
    if after.works and before.works:
        sentence = "a copy works with and without the changes: this test shows no fault of the versions"
    beside = f" ({len(left_out)} other packages were left to the resolver)" if left_out else ""
    return Proof(
        proven=works,
        text=("proven: " if works else "not proven: ") + sentence + beside,
        before=_copied(before),
        after=_copied(after),
        left_out=left_out,
    )


def _describe_trial(trial: Trial) -> str:
    if trial.works:
        passed = [phase for phase, how in trial.assessed.phases.items() if how == "passed"]
        return f"works ({', '.join(passed)})"
    return f"does not: {word(trial.assessed.verdict)} in {trial.assessed.phase}: {trial.assessed.decisive}"


def _copied(trial: Trial) -> Copied:
    return Copied(
        requirements=trial.cell.question.requirements,
        verdict=str(trial.assessed.verdict),
        phases={str(phase): str(how) for phase, how in trial.assessed.phases.items()},
        decisive=trial.assessed.decisive,
    )


def lines(result: Proof) -> Iterable[str]:
    """Yield the proof as lines for a terminal."""
    yield result.text
    for name, copy in (("without", result.before), ("with", result.after)):
        if copy:
            yield f"  {name}: {', '.join(copy.requirements)}"
