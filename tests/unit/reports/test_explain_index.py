"""The file that `explain` starts from: made once for each state of signatures and reports."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from builders import measured_cell

from harness.model.errors import BadInput
from harness.model.measured import Measured
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
