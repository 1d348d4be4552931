"""Read and fill the templates of pages, certificates and CI files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "templates"


def read_template(name: str) -> str:
    """Return the text of a template, such as `report.md.j2`."""
    return (FOLDER / name).read_text(encoding="utf-8")


def fill(template: str, filters: Mapping[str, Callable[..., Any]], **values: Any) -> str:
    """Fill the text of a template with values."""
    from jinja2 import Environment, StrictUndefined  # noqa: PLC0415 - start-up

    # Jinja escapes for HTML, also inside code that people copy. The filters escape for Markdown instead.
    environment = Environment(undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True, autoescape=False)
    environment.filters |= filters
    return environment.from_string(template).render(**values)
