"""Test that measured results become one document."""

import gzip
import hashlib
from pathlib import Path
from typing import Any

import msgspec
import pytest
import specimens
from builders import measured_cell

from harness.model.measured import Measured, MeasuredCell
from harness.model.report_types import UNTOLD, DiagnosisEntry
from harness.reports.answers import digest

ONE, TWO = "1" * 64, "2" * 64
NUMPY = f"numpy==2.2.6 \\\n    --hash=sha256:{ONE} \\\n    --hash=sha256:{TWO}\n"
SHORTER = f"numpy==2.2.6 \\\n    --hash=sha256:{TWO}\n"


def sha256(text: str) -> str:
    """Return the hash by which a document names a lock."""
    return hashlib.sha256(text.encode()).hexdigest()


def cell(name: str, measured: str = "2026-11-21T12:00:00Z", machine: str = "here", **more: Any) -> MeasuredCell:
    """Return a measured cell."""
    return measured_cell(name, measured=measured, machine=machine, **more)


def part(*cells: MeasuredCell, machines: dict[str, Any] | None = None, locks: tuple[str, ...] = ()) -> Measured:
    """Return a document of these cells and texts of locks."""
    return digest.with_locks("", machines or {}, cells, {sha256(text): text for text in locks})


def with_lock(folder: Path, text: str | None) -> Measured:
    """Return the results of a report whose locks all have this text; None means that they are gone."""
    report = specimens.quick_document()
    for name in {cell.lock for cell in report.cells if cell.lock}:
        (folder / name).parent.mkdir(exist_ok=True)
        if text is not None:
            (folder / name).write_text(text)
    return digest.from_report(report, folder)


def test_a_cell_that_says_nothing_of_its_packages_is_left_out(tmp_path: Path) -> None:
    """Cells that were not run, not to be had or not told leave nothing; all others keep verdict and phases."""
    report = specimens.quick_document()

    found = {one.id: one for one in digest.from_report(report, tmp_path).cells}

    told = [one for one in report.cells if one.verdict not in UNTOLD]
    assert 0 < len(told) < len(report.cells)
    assert {name: one.verdict for name, one in found.items()} == {one.id: one.verdict for one in told}
    assert all(found[one.id].phases == one.phases for one in told)


def test_a_cell_keeps_its_lock(tmp_path: Path) -> None:
    """A lock is named by the SHA-256 of its text, and comes out again to the byte."""
    made = with_lock(tmp_path, NUMPY)

    (sha,) = made.locks
    assert sha == sha256(NUMPY)
    assert {one.lock for one in made.cells} == {sha, None}
    assert made.lock_text(sha) == NUMPY


@pytest.mark.parametrize("text", [None, "numpy @ file:///a.whl\n"], ids=["gone", "no lock"])
def test_a_lock_that_cannot_be_given_again_is_none(tmp_path: Path, text: str | None) -> None:
    """Nobody is told of a lock that is not there, or that is not pinned by hashes."""
    made = with_lock(tmp_path, text)

    assert not made.locks
    assert {one.lock for one in made.cells} == {None}


def test_locks_of_two_pythons_keep_their_own_files() -> None:
    """Two locks with one release and other files of it: each gets its own hashes again."""
    cells = [cell(name, lock=sha256(text)) for name, text in (("a", NUMPY), ("b", SHORTER))]

    made = digest.combine([part(one, locks=(NUMPY, SHORTER)) for one in cells])

    assert made.hashes == {"numpy==2.2.6": (ONE, TWO)}
    assert {text: made.lock_text(sha256(text)) for text in (NUMPY, SHORTER)} == {NUMPY: NUMPY, SHORTER: SHORTER}


def test_the_newer_measurement_stands() -> None:
    """Whichever comes first, of a cell on one machine the newer measurement stands, with its lock alone."""
    old = part(cell("a", "2026-01-01T00:00:00Z", lock=sha256(NUMPY)), locks=(NUMPY,))
    new = part(cell("a", "2026-02-01T00:00:00Z", lock=sha256(SHORTER)), locks=(SHORTER,))

    for parts in ([old, new], [new, old]):
        made = digest.combine(parts)
        assert [one.measured for one in made.cells] == ["2026-02-01T00:00:00Z"]
        assert [*made.locks] == [sha256(SHORTER)]


def test_machines_never_mix() -> None:
    """A cell measured on two machines has a result of each, however old."""
    here, there = cell("a", "2026-02-01T00:00:00Z", "here"), cell("a", "2026-01-01T00:00:00Z", "there")

    made = digest.combine(
        [
            part(there, machines={"there": {"os": "another"}}),
            part(here, machines={"here": {"os": "one"}, "unused": {}}),
        ]
    )

    assert [(one.machine, one.measured[:7]) for one in made.cells] == [("here", "2026-02"), ("there", "2026-01")]
    assert made.machines == {"here": {"os": "one"}, "there": {"os": "another"}}


def test_a_packed_document_comes_out_equal(tmp_path: Path) -> None:
    """Packed twice it is the same bytes; unpacked, and put under nothing, it is the same document."""
    made = digest.combine([with_lock(tmp_path, NUMPY)])

    content = digest.pack(made)
    unpacked = msgspec.json.decode(gzip.decompress(content), type=Measured)

    assert content == digest.pack(unpacked)
    assert unpacked == made
    assert digest.combine([made]) == made


def test_a_mask_is_a_cause_only_where_it_is_what_the_cell_says(tmp_path: Path) -> None:
    """Causes are the known failures that are no masks, else the mask that is the line itself, as in a report."""
    report = specimens.quick_document()
    red = next(one for one in report.cells if one.decisive and one.verdict == "partial")

    def fitting(name: str, seen: str, *, masks: bool) -> DiagnosisEntry:
        return DiagnosisEntry(signature=name, cause="", remedy={}, proven=False, masks=masks, references=(), seen=seen)

    def causes(line: str, *found: DiagnosisEntry) -> tuple[str, ...]:
        told = msgspec.structs.replace(red, decisive=line, cases=(), diagnoses=found)
        (made,) = digest.from_report(msgspec.structs.replace(report, cells=(told,)), tmp_path).cells
        return made.causes

    mask = fitting("mask", "EOFError", masks=True)
    assert causes("EOFError: ", mask) == ("mask",)
    assert causes("KeyError: 1", mask) == ()
    assert causes("EOFError: ", fitting("deep", "x", masks=False), mask) == ("deep",)
