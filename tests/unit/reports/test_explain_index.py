"""The file that `explain` starts from: made once for each state of signatures and reports."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from builders import measured_cell
from specimens import quick_document

from harness.model.errors import BadInput
from harness.model.measured import Measured
from harness.reports import document
from harness.reports.answers import result_index
from harness.reports.explanations import explain_index
from harness.running.signatures import shipped_signatures
from harness.standalone.failures import literals

ISSUE = """
[[signature]]
id = "no-wings"
phases = ["single"]
pattern = '''no wings at all'''
cause = "it has none"
remedy = { text = "wait" }
references = ["https://example.org/1"]
examples = ["no wings at all", "oh: no wings at all", "there are no wings at all here"]
"""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Keep the file below a folder of the test, and read none that was read before."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("HARNESS_RESULTS", raising=False)
    monkeypatch.chdir(tmp_path)
    cells = (
        measured_cell("good"),
        measured_cell("bad", "broken", decisive="ValueError: no wings", causes=("no-wings",)),
    )
    results = Measured(generated="", machines={}, cells=cells, locks={}, hashes={}, taken={})
    monkeypatch.setattr(result_index, "load_shipped", lambda: results)
    explain_index.load_index.cache_clear()
    yield tmp_path / "cache" / "remembered" / "explain"
    explain_index.load_index.cache_clear()


def test_the_file_holds_what_the_signatures_and_reports_do(cache: Path) -> None:
    """The signatures are all there, with the literals of their patterns, and cells that failed."""
    ids = [each.id for each in explain_index.load_signatures()]
    assert ids == [each.id for each in shipped_signatures.load_all()]
    (cell,) = explain_index.load_measured()["cells"]
    assert (cell["causes"], cell["decisive"]) == (["no-wings"], "ValueError: no wings")
    assert len(list(cache.iterdir())) == 1


def test_a_changed_signature_makes_another_file(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another folder of signatures is another file, and a damaged file is made again."""
    folder = tmp_path / "signatures"
    folder.mkdir()
    (folder / "wings.toml").write_text(ISSUE)
    monkeypatch.setenv("HARNESS_SIGNATURES", str(folder))
    assert [each.id for each in explain_index.load_signatures()] == ["no-wings"]
    assert literals.clauses("no wings at all") == (frozenset({"no wings at all"}),)
    for file in cache.iterdir():
        file.write_text("{")
    explain_index.load_index.cache_clear()
    assert [each.id for each in explain_index.load_signatures()] == ["no-wings"]


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The user named it, so that nothing is not an answer."""
    monkeypatch.setenv("HARNESS_SIGNATURES", str(tmp_path / "none"))
    with pytest.raises(BadInput, match="is not a folder"):
        explain_index.load_signatures()


def test_results_of_others_are_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells of a report elsewhere that failed are shown, from a kept file until the report changes."""
    monkeypatch.setenv(result_index.VARIABLE, str(tmp_path))
    report = tmp_path / "report.json"
    report.write_bytes(document.encode(quick_document()))

    first = explain_index.load_measured()["cells"]
    assert {cell["id"] for cell in first} > {"m/bad"}
    reads: list[str] = []
    load = result_index.load_elsewhere
    monkeypatch.setattr(result_index, "load_elsewhere", lambda: reads.append("once more") or load())
    assert explain_index.load_measured()["cells"] == first
    assert reads == []
    os.utime(report, ns=(1, 1))
    assert explain_index.load_measured()["cells"] == first
    assert reads == ["once more"]


def test_a_cell_that_was_measured_again_is_shown_as_it_is_now(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cell that failed where the harness was made, and works in a result of others, is no failure any more."""
    again = Measured(generated="", machines={}, cells=(measured_cell("bad"),), locks={}, hashes={}, taken={})
    (failed,) = explain_index.load_measured()["cells"]
    monkeypatch.setenv(result_index.VARIABLE, ".")
    monkeypatch.setattr(result_index, "files_of_others", list)
    monkeypatch.setattr(result_index, "load_elsewhere", lambda: [again])
    assert (failed["decisive"], explain_index.load_measured()["cells"]) == ("ValueError: no wings", [])


def test_a_store_without_results_adds_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that has just begun has a folder for its cells, and none in it."""
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    before = explain_index.load_measured()
    (tmp_path / "state" / "cells").mkdir(parents=True)
    assert explain_index.load_measured() == before == explain_index.load_measured()
