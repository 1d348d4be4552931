"""A change of our own code makes a run repeat only the checks that changed."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commandline import CommandResult, Desk

import harness
from harness.probes.vault import Vault

PACKAGE = Path(harness.__file__).parent
Changed = Callable[..., CommandResult]


@pytest.fixture
def changed(desk_with_results: Desk) -> Changed:
    """Return a function that runs the matrix with a copy of the package in which one text of a file is replaced."""
    copy = desk_with_results.folder / "copy"
    shutil.copytree(PACKAGE, copy / "harness", ignore=shutil.ignore_patterns("__pycache__", "matrices"))
    (copy / "matrices").symlink_to(PACKAGE.parent / "matrices")

    def run(file: str, old: str, new: str) -> CommandResult:
        path = copy / "harness" / file
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))
        return desk_with_results.run("run", "small.toml", "--json", PYTHONPATH=str(copy))

    return run


def evidence(desk: Desk) -> dict[str, bytes]:
    """Return every stored piece of evidence by name."""
    return {path.name: path.read_bytes() for path in Vault(desk.state).folder.glob("cas/*/*")}


def checks_of_runs(desk: Desk) -> list[tuple[str, ...]]:
    """Return the checks of every stored probe run."""
    vault = Vault(desk.state)
    names = [name for claim in vault.folder.glob("ac/*/*") for name in vault.runs(claim.parent.name + claim.name)]
    return sorted(tuple(vault.reading(name).run.request.limits) for name in names)


def summarise(ran: CommandResult) -> dict[str, Any]:
    """Return the verdict, the decisive line and whether results were reused, for each cell."""
    return {name: (cell["verdict"], cell["decisive"], cell["reused"]) for name, cell in ran.cells("which").items()}


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("judging/runs/fold.py", "RUNS_TO_CONFIRM = 3", "RUNS_TO_CONFIRM = 3  # times"),
        ("judging/runs/todo.py", '"""Say which', '"""Tell which'),
        ("incell/check_vector_sync.py", '"""', '"""In other words: '),
        ("incell/cell_episode.py", '"""', '"""In other words: '),
    ],
)
def test_words_about_code_measure_nothing(
    desk_with_results: Desk, changed: Changed, file: str, old: str, new: str
) -> None:
    """A changed comment in judging code, or docstring in cell code, causes no measurement."""
    before, runs = evidence(desk_with_results), checks_of_runs(desk_with_results)
    known = summarise(desk_with_results.run("run", "small.toml", "--json"))

    assert summarise(changed(file, old, new)) == known
    assert (evidence(desk_with_results), checks_of_runs(desk_with_results)) == (before, runs)


def test_other_judging_says_something_else_of_the_same_evidence(desk_with_results: Desk, changed: Changed) -> None:
    """A changed message is applied to stored evidence: the affected cell is judged again, and nothing is measured."""
    before, runs = evidence(desk_with_results), checks_of_runs(desk_with_results)
    known = summarise(desk_with_results.run("run", "small.toml", "--json"))
    again = summarise(changed("model/words.toml", '"render.blank" = "blank frame', '"render.blank" = "empty frame'))

    verdict, line, reused = known["blank"]
    assert line.startswith("ContractViolation: blank frame")
    assert again == {**known, "blank": (verdict, line.replace("blank frame", "empty frame"), reused)}
    assert (evidence(desk_with_results), checks_of_runs(desk_with_results)) == (before, runs)


def test_a_changed_check_is_measured_alone(desk_with_results: Desk, changed: Changed) -> None:
    """A changed check is measured once for each case, alone; stored evidence stays as it was."""
    before, runs = evidence(desk_with_results), checks_of_runs(desk_with_results)
    known = summarise(desk_with_results.run("run", "small.toml", "--json"))
    path = PACKAGE / "incell" / "check_vector_sync.py"
    end = path.read_text().splitlines()[-1]
    again = summarise(changed("incell/check_vector_sync.py", end, f"{end}\n\n\nCHANGED = True"))

    assert {name: told[:2] for name, told in again.items()} == {name: told[:2] for name, told in known.items()}
    new = sorted(checks_of_runs(desk_with_results))
    for one in runs:
        new.remove(one)
    assert set(new) == {("vector.sync",)}
    assert before.items() <= evidence(desk_with_results).items()
