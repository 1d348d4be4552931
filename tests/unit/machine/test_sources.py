"""Tests which of our files a stored result or a report depends on: all imported ones, found and not listed."""

from __future__ import annotations

import ast
from importlib.util import resolve_name
from pathlib import Path

import pytest

import harness
from harness.machine import source_digests
from harness.reports import freshness
from harness.running import case_run

PACKAGE = Path(harness.__file__).parent


def imports_by_syntax(module: str) -> set[str]:
    """Return our modules that a module imports, directly or not, by their syntax trees."""
    found: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        place = PACKAGE.parent / name.replace(".", "/")
        path = next((path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None)
        if not name.startswith("harness") or path is None or name in found:
            continue
        found.add(name)
        waiting.append(name.rpartition(".")[0])
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                waiting += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                package = name if path.name == "__init__.py" else name.rpartition(".")[0]
                base = resolve_name("." * node.level + (node.module or ""), package)
                waiting += [base, *(f"{base}.{alias.name}" for alias in node.names)]
    return found


@pytest.mark.parametrize(
    "module", ["harness.running.case_run", "harness.running.own_suites", "harness.reports.publishing"]
)
def test_nothing_that_is_imported_is_missed(module: str) -> None:
    """The quick reading of import lines finds what the compiler finds."""
    assert set(source_digests.imported_files(module)) == imports_by_syntax(module)


JUDGING = tuple(f"judging.runs.{name}" for name in ("case", "check", "fold", "todo", "misleading", "native_errors"))


@pytest.mark.parametrize("module", [*JUDGING, "judging.runs.decisive_line", "standalone.failures.lines", "probes.wire"])
def test_modules_that_judge_a_probe_are_part_of_a_mark(module: str) -> None:
    """The record of a cell is judged again when any module changes that has a say in an outcome, line or finding."""
    assert any(f"harness.{module}" in source_digests.imported_files(one) for one in case_run.JUDGING)


def test_a_change_two_imports_away_changes_the_digest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Imports of imports count, at the top or inside a function, and data beside them; other modules do not."""
    package = tmp_path / "harness"
    (package / "inner").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "inner" / "__init__.py").write_text("")
    (package / "judge.py").write_text("from harness import (\n    words,  # as they are said\n)\n")
    (package / "words.py").write_text("def said():\n    from harness.inner.lines import LINE\n    return LINE\n")
    (package / "inner" / "lines.py").write_text("LINE = 1\n")
    (package / "other.py").write_text("")
    monkeypatch.setattr(source_digests, "PACKAGE", package)

    def digest() -> str:
        source_digests.digest.cache_clear()
        return source_digests.digest("harness.judge")

    first = digest()
    (package / "other.py").write_text("# changed\n")
    assert digest() == first
    (package / "inner" / "lines.py").write_text("LINE = 2\n")
    second = digest()
    assert second != first
    (package / "other.toml").write_text("a = 1\n")
    assert digest() == second
    (package / "words.toml").write_text("a = 1\n")
    assert digest() != second
    source_digests.digest.cache_clear()


def test_a_report_depends_on_all_that_it_is_made_with() -> None:
    """A change of a module that renders, judges or matches, or of a template, makes a report anew."""
    files = {Path(path) for path, _, _ in freshness.stat_sources()}

    assert set(source_digests.imported_files("harness.reports.publishing").values()) <= files
    assert PACKAGE / "standalone" / "failures" / "matching.py" in files
    assert {path.name for path in files} >= {"report.md.j2", "camera_pages.py", "identity.py", "check.py", "words.toml"}
