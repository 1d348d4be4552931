"""Test that committed reports give a worker's own line as the reason of its end, and name the line that hid it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.model.report_types import CellEntry
from harness.reports import document

REPORTS = Path(__file__).parents[3] / "reports"
FORK = "vector.async.fork"
XML = "ValueError: XML Error: top-level default class 'main' cannot be renamed / Element 'default', line 0"
RACE = r"ConnectionResetError: \[Errno 104\] .*|BrokenPipeError: \[Errno 32\] .*"
"""Of a worker that ended in its constructor: which of them it is, is a race."""

LOST = r"TypeError: (cannot unpack non-iterable NoneType object|object of type 'NoneType' has no len\(\))"
"""Of a worker that raised in its step, in gym and gymnasium 0.26."""

MASKS = f"{RACE}|EOFError|{LOST}"


def cells(name: str) -> tuple[CellEntry, ...]:
    """Return the cells of a committed report."""
    return document.read((REPORTS / name / "report.json").read_bytes(), name).cells


def ended(cell: CellEntry, case: str) -> tuple[str | None, str | None]:
    """Return the reason why the workers of a case ended, and the line that hid it."""
    (found,) = [one for one in cell.cases if one.case == case]
    return found.reasons.get(FORK), found.masked.get(FORK)


def all_reasons() -> Iterator[tuple[str, str, str | None]]:
    """Yield from every committed report each check of workers, its reason, and the line that hid it."""
    for path in sorted(REPORTS.glob("*/report.json")):
        for cell in cells(path.parent.name):
            for case in cell.cases:
                for check, reason in case.reasons.items():
                    yield f"{cell.id} {case.case} {check}", reason, case.masked.get(check)


def test_a_mask_is_no_reason() -> None:
    """Nowhere does the echo of a worker's death stand as the reason of a failure."""
    found = list(all_reasons())

    assert len(found) > 100
    assert [where for where, reason, _ in found if re.fullmatch(MASKS, reason)] == []
    assert [where for where, _, mask in found if mask and not re.fullmatch(MASKS, mask)] == []


@pytest.mark.skipif(not (REPORTS / "masks").is_dir(), reason="the matrix was not measured yet")
@pytest.mark.parametrize("place", ["constructor", "reset", "step"])
class TestMasks:
    """The matrix masks: seven libraries, six ends at three places."""

    def of(self, place: str, end: str) -> dict[str, tuple[str | None, str | None]]:
        """Return reason and mask by library, for one kind of end at one place."""
        found = [cell for cell in cells("masks") if (cell.axes["PLACE"], cell.axes["END"]) == (place, end)]
        assert len(found) == 7
        return {cell.axes["library"]: ended(cell, "workers") for cell in found}

    @pytest.mark.parametrize("end", ["crashes", "killed", "exits", "leaves"])
    def test_a_death_is_hidden_by_what_the_parent_was_at(self, place: str, end: str) -> None:
        """A race in the constructor, the end of a pipe later."""
        masks = {mask for _, mask in self.of(place, end).values()}
        assert all(re.fullmatch(RACE if place == "constructor" else "EOFError", mask or "") for mask in masks)

    def test_an_exception_goes_through_later(self, place: str) -> None:
        """An exception in the constructor is hidden by every library, one in a step only by those that lose it."""
        hidden = {library: mask for library, (_, mask) in self.of(place, "raises").items() if mask}
        known = {
            "constructor": {cell.axes["library"]: RACE for cell in cells("masks")},
            "reset": {},
            "step": {"gym0.26.2": LOST, "gymnasium0.26.3": LOST},
        }[place]
        assert {library: bool(re.fullmatch(known.get(library, "-"), mask)) for library, mask in hidden.items()} == (
            dict.fromkeys(known, True)
        )

    def test_a_hanging_worker_is_named(self, place: str) -> None:
        """Nothing is seen by the parent but that nothing comes."""
        assert {mask for _, mask in self.of(place, "hangs").values()} == {None}


@pytest.mark.parametrize(("name", "case"), [("kitchen", "runner"), ("kitchen-twin", "workers")])
def test_the_kitchen_ends_in_what_mujoco_says(name: str, case: str) -> None:
    """On both sides of MuJoCo 3.2.0: workers run, or end in its error behind a mask."""
    if not (REPORTS / name).is_dir():
        pytest.skip("the matrix was not measured yet")
    kitchens = {"kitchen": "checkout", "kitchen-twin": "alone"}
    axis = {"kitchen": "kitchen", "kitchen-twin": "twin"}[name]
    found = {
        cell.axes["mujoco"]: ended(cell, case)
        for cell in cells(name)
        if cell.axes[axis] == kitchens[name] and cell.base is None
        if (cell.axes["python"], cell.axes["gym"], cell.axes["dm-control"])
        in {("3.9", "0.21.0", "1.0.20"), ("3.11", "absent", "absent")}
    }
    assert found["3.1.6"] == (None, None)
    assert (found["3.2.0"][0], bool(re.fullmatch(RACE, found["3.2.0"][1] or ""))) == (XML, True)
