"""The file that `explain` reads: it is made once, and made again when something that it is made of changes."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from specimens import quick_document

from harness.reports import document
from harness.reports.answers import result_index
from harness.reports.explanations import explain_index


def test_results_of_others_are_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells of a report elsewhere that failed are shown, from a kept file until the report changes."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    monkeypatch.setenv(result_index.VARIABLE, str(tmp_path))
    report = tmp_path / "report.json"
    report.write_bytes(document.encode(quick_document()))
    shipped = {cell["id"] for cell in explain_index.load_index()["cells"]}

    first = explain_index.load_measured()["cells"]
    assert [cell for cell in first if cell["id"] not in shipped]
    reads: list[str] = []
    load = result_index.load_elsewhere
    monkeypatch.setattr(result_index, "load_elsewhere", lambda: reads.append("once more") or load())
    assert explain_index.load_measured()["cells"] == first
    assert reads == []
    os.utime(report, ns=(1, 1))
    assert explain_index.load_measured()["cells"] == first
    assert reads == ["once more"]
