"""Values that clash only with the newest release of another axis are told from those that a project cannot have."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
from builders import cell_requiring, interpreter, lock, step

from harness.ci import first_values
from harness.ci.drafts import Range, values
from harness.machine.store import Store
from harness.model import Cell, Interpreter, Lock, Outcome, Phase, Step
from harness.model.vocabulary import Rule

PYTHON = interpreter()
LOCK = lock()


def planned(**versions: str) -> Cell:
    """Return a cell whose axes are these package versions."""
    axes = {"python": "3.11", **versions}
    return cell_requiring(
        *(f"{name}=={version}" for name, version in versions.items()), axes=axes, python=axes["python"]
    )


class Resolver:
    """Resolves all but some combinations: those of which every requirement is asked for."""

    refused: tuple[tuple[str, ...], ...] = ()
    outcome = Outcome.FAILED

    def __init__(self, *_: object) -> None:
        pass

    def lock_of(self, asked: Cell, _: Interpreter) -> tuple[Lock | None, Step]:
        """Return a lock, or none if the combination is refused, in the form that the runner returns."""
        there = {*asked.question.requirements, f"python=={asked.python}"}
        refused = any({*lines} <= there for lines in self.refused)
        return (None, step(Phase.RESOLVE, self.outcome)) if refused else (LOCK, step(Phase.RESOLVE))


CELLS = (
    planned(sim="3", gymnasium="1"),
    planned(sim="3", gymnasium="0.28"),
    planned(sim="3", gymnasium="0.26"),
    planned(sim="2", gymnasium="1"),
    planned(sim="3", gymnasium="1", python="3.9"),
)


@pytest.mark.parametrize(
    ("refused", "outcome", "expected"),
    [
        ((("gymnasium==0.28", "sim==3"),), Outcome.FAILED, {"gymnasium": ("0.28",)}),
        ((("gymnasium==0.28",),), Outcome.FAILED, {}),
        ((("gymnasium==1", "sim==2"), ("gymnasium==0.26", "sim==3")), Outcome.FAILED,
         {"gymnasium": ("0.26",), "sim": ("2",)}),
        ((("gymnasium==1", "sim==3"),), Outcome.FAILED, {}),
        ((("gymnasium==0.28", "sim==3"),), Outcome.INFRA, {}),
        ((("gymnasium==1", "python==3.9"),), Outcome.FAILED, {"python": ("3.9",)}),
        ((("python==3.9",),), Outcome.FAILED, {}),
    ],
    ids=["beside the newest sim", "beside nothing", "both axes", "the newest of all", "no network", "an old Python",
         "a Python that the project cannot have"],
)  # fmt: skip
def test_values_that_clash_with_the_newest_of_another_axis(
    monkeypatch: pytest.MonkeyPatch,
    refused: tuple[tuple[str, ...], ...],
    outcome: Outcome,
    expected: Mapping[str, tuple[str, ...]],
) -> None:
    """A package that does not resolve even without the other pins stays: the project's user has to know."""
    monkeypatch.setattr(Resolver, "refused", refused)
    monkeypatch.setattr(Resolver, "outcome", outcome)
    monkeypatch.setattr(first_values, "Runner", Resolver)
    monkeypatch.setattr(first_values.interpreters, "find", lambda _: PYTHON)

    found = first_values.find_clashes(CELLS, ("gymnasium", "sim"), Store(Path("nowhere")), None)  # type: ignore[arg-type]

    assert found == expected


def test_a_range_without_values_that_clash_says_so() -> None:
    """They are left out one by one, beside what was left out before."""
    wanted = Range(package="gymnasium", range=">=0.26", rule=Rule.LATEST_PATCH, note="Left out: 0.27.")

    found = values.exclude(wanted, ("0.28.1",))

    assert found.range == ">=0.26,!=0.28.1"
    assert found.note == (
        "Left out: 0.27. Left out, not installable with the newest release of the other axes: 0.28.1."
    )
    assert values.exclude(wanted, ()) is wanted
