"""Read the templates of pages, certificates and CI files."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent / "templates"


def read_template(name: str) -> str:
    """Return the text of a template, such as `report.md.j2`."""
    return (FOLDER / name).read_text(encoding="utf-8")
