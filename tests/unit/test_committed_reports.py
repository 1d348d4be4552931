"""Test that everything committed below `reports/` is whole, explained, and regenerates to the byte."""

from __future__ import annotations

import hashlib
import re
import shutil
from pathlib import Path

import pytest

from harness.machine.store import Store
from harness.matrix import matrix_file
from harness.model import Verdict
from harness.model.report_types import Document
from harness.reports import document, judge_again, packs, publishing
from harness.reports.tables import tables
from harness.reports.text import author_pages

REPORTS = Path(__file__).parents[2] / "reports"
MATRICES = REPORTS.parent / "matrices"
UNAVAILABLE = {
    "interop": 1,
    "torchrl": 3,
    "isaac-gym": 2,
    "isaac-lab": 2,
    "libero": 1,
    "meta-world": 1,
    "playground": 1,
    "robocasa": 1,
}
"""Number of cells, by report, that need what these machines lack: a CPU torch, an archive, a checkout, a GPU."""

INCONCLUSIVE = {"masks": 21}
"""How many cells say nothing of packages, as they are meant to: workers that somebody kills by SIGKILL."""

FOLDERS = sorted(path.parent for path in REPORTS.glob("*/report.json"))
FOREIGN = re.compile(r"https?://[^ \"]*/(?:simple|packages)/|(?<!\$BUILD)/(?:root|home|tmp|work)/")
"""Addresses of an index, folders of a machine."""


def read(folder: Path) -> Document:
    """Return the document of a report."""
    return document.read((folder / "report.json").read_bytes(), "report.json")


def test_every_matrix_was_measured() -> None:
    """Every matrix that comes with the harness has a report, quickstart among them."""
    matrices = {path.stem for path in (REPORTS.parent / "matrices").glob("*.toml")}

    assert {"quickstart"} <= matrices == {folder.name for folder in FOLDERS}


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_report_is_judged_from_its_evidence(folder: Path, tmp_path: Path) -> None:
    """`report.json` is, byte for byte, what judging makes of the pack today; the pack is no larger than it may be."""
    index = packs.index(folder)
    assert index
    assert all((folder / name).stat().st_size <= packs.MOST_PACK for name in index.packs)
    copy = tmp_path / folder.name
    for name in [packs.INDEX, *index.packs]:
        copy.mkdir(exist_ok=True)
        shutil.copy(folder / name, copy / name)
    for name in ("frames", "locks"):
        if (folder / name).is_dir():
            shutil.copytree(folder / name, copy / name)
    again = judge_again.judge(copy, index, Store(tmp_path / "state"))

    assert document.encode(again.document) == (folder / "report.json").read_bytes()
    evidence = {path.relative_to(folder): path.read_bytes() for path in folder.glob("evidence/*/*")}
    assert {path.relative_to(copy): path.read_bytes() for path in copy.glob("evidence/*/*")} == evidence


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_evidence_names_no_machine_and_no_index(folder: Path) -> None:
    """No text inside a pack of evidence names a machine or an index."""
    for pack in folder.glob("*.tar.xz"):
        texts = [content.decode("utf-8", "replace") for _, content in packs.members(pack.read_bytes())]
        assert texts
        assert not [found[0] for found in map(FOREIGN.search, texts) if found]


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
class TestCommittedReport:
    """One committed report."""

    def test_page_is_made_from_the_document(self, folder: Path) -> None:
        """`report.md` is what its `report.json` gives."""
        assert publishing.page(tables.report(read(folder))) == (folder / "report.md").read_text()

    def test_every_cell_is_as_expected(self, folder: Path) -> None:
        """No red cell without an expectation, no expectation out of date."""
        whole = read(folder)

        told = [cell for cell in whole.cells if cell.verdict not in {Verdict.UNAVAILABLE, Verdict.INCONCLUSIVE}]
        proofs = {cell.id for cell in told if cell.base and cell.as_expected is None and cell.verdict is Verdict.WORKS}
        assert [cell.id for cell in told if cell.as_expected is not True and cell.id not in proofs] == []
        untold = UNAVAILABLE.get(folder.name, 0) + INCONCLUSIVE.get(folder.name, 0)
        assert len(told) >= len(whole.cells) - untold
        assert whole.stale == ()

    def test_page_in_words_is_made_from_the_document(self, folder: Path) -> None:
        """`README.md` is there where the matrix has a template of it, and is what its `report.json` gives."""
        matrix = matrix_file.read((MATRICES / f"{folder.name}.toml").read_text(), f"{folder.name}.toml")
        words, whole = folder / "README.md", read(folder)

        assert words.exists() == (matrix.page is not None)
        if matrix.page:
            template = (MATRICES / matrix.page).read_text()
            assert author_pages.render(template, whole, tables.report(whole)) == words.read_text()

    def test_locks_are_those_that_were_measured(self, folder: Path) -> None:
        """Each cell's lock lies beside the report, with the hash that the report gives."""
        for cell in read(folder).cells:
            if cell.lock is None:
                assert cell.verdict in {Verdict.UNRESOLVABLE, Verdict.UNINSTALLABLE, Verdict.UNAVAILABLE}
                continue
            assert hashlib.sha256((folder / cell.lock).read_bytes()).hexdigest() == cell.lock_sha256

    def test_frames_are_there(self, folder: Path) -> None:
        """Each frame that is named lies beside the report, and each picture that was drawn is named."""
        cases = [case for cell in read(folder).cells for case in cell.cases]
        frames = [frame for case in cases for frame in case.frames]

        drawing = ("render.rgb_array", "behave.pixels")
        assert bool(frames) == any(case.checks.get(check) == "passed" for case in cases for check in drawing)
        assert all((folder / frame).is_file() for frame in frames)

    def test_nothing_of_a_machine_or_an_index(self, folder: Path) -> None:
        """No file names an index's address or a folder of the machine that it was made on."""
        for path in folder.rglob("*"):
            if path.suffix in {".json", ".jsonl", ".log", ".md", ".txt"}:
                assert not FOREIGN.search(path.read_text()), path
