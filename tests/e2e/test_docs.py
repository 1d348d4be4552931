"""The documents: the site builds strictly and needs no other host, a sample of the commands prints what pages show."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RUNNER = ROOT / "docs" / "making" / "run_examples.py"
LOADED = re.compile(
    r"<(?:script|img|iframe)\b[^>]*\bsrc=[\"']?(https?:)?//|<link\b[^>]*\bhref=[\"']?(https?:)?//[^>]*stylesheet"
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site; every link to a page, a heading or a file of the repository leads somewhere."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return folder


def test_pages_of_the_site_load_nothing_from_elsewhere(site: Path) -> None:
    """No script, style, font or picture comes from another host."""
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > len(list((ROOT / "docs").rglob("*.md")))
    assert [page.name for page in pages if LOADED.search(page.read_text(encoding="utf-8"))] == []


def test_references_are_made_from_the_code(site: Path) -> None:
    """Each verb has its help and each table of a matrix its keys; documents list their fields."""
    commands, matrix, documents = (
        (site / "reference" / f"{name}.html").read_text(encoding="utf-8")
        for name in ("commands", "matrix", "documents/report")
    )
    assert "usage: simmatrix bisect" in commands
    assert "tutorials/traceback.html" in commands
    assert 'id="case"' in matrix
    assert 'id="cellentry"' in documents


def test_reports_are_pages_of_the_site(site: Path) -> None:
    """A link of a guide to a report stays in the site."""
    assert (site / "repository" / "reports" / "drift-mujoco" / "report.html").is_file()
    assert 'href="repository/reports/drift-mujoco/report.html"' in (site / "reports.html").read_text(encoding="utf-8")


def test_commands_print_as_pages_show() -> None:
    """Those of all pages that need no index; `nox -s docs` runs the others, too."""
    command = [sys.executable, str(RUNNER), "--no-network"]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)

    assert ran.returncode == 0, ran.stdout


def test_a_page_that_shows_something_else_fails(tmp_path: Path) -> None:
    """An output that differs, or another exit code, is reported with its line."""
    page = tmp_path / "page.md"
    page.write_text("```console\n$ echo one\ntwo\n$ false\n```\n", encoding="utf-8")
    ran = subprocess.run([sys.executable, str(RUNNER), str(page)], capture_output=True, text=True, check=False)

    assert ran.returncode == 1
    assert f"{page}:2: $ echo one" in ran.stdout
    assert f"{page}:4: $ false\nexit code 1, not 0" in ran.stdout


def test_without_a_network_no_command_reaches_one(tmp_path: Path) -> None:
    """Examples marked `network` are left out, and the others have a proxy that is not there, and an empty cache."""
    page = tmp_path / "page.md"
    page.write_text(
        "<!-- example: network -->\n```console\n$ false\n```\n"
        '```console\n$ echo "$HTTPS_PROXY"; ls "$HARNESS_CACHE" || echo none\nhttp://127.0.0.1:9\n...none\n```\n',
        encoding="utf-8",
    )
    command = [sys.executable, str(RUNNER), "--no-network", str(page)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)

    assert ran.returncode == 0, ran.stdout
