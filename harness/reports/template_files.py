"""Read and fill the templates of pages, certificates and CI files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

FOLDER = Path(__file__).parent / "templates"


def read_template(name: str) -> str:
    """Return the text of a template, such as `report.md.j2`."""
    return (FOLDER / name).read_text(encoding="utf-8")


def fill(template: str, filters: Mapping[str, Callable[..., Any]], **values: Any) -> str:
    """Fill the text of a template with values."""
    environment = _environment()
    environment.filters |= filters
    template_class, code = environment.template_class, _compiled(template, frozenset(filters))
    return template_class.from_code(environment, code, environment.make_globals(None)).render(**values)


def _environment() -> Environment:
    from jinja2 import Environment, StrictUndefined  # noqa: PLC0415 - start-up

    # Jinja escapes for HTML, also inside code that people copy. The filters escape for Markdown instead.
    # Not optimized: a template is compiled without its filters, which then cannot be applied to constants.
    return Environment(
        undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True, autoescape=False, optimized=False
    )


@cache
def _compiled(template: str, filters: frozenset[str]) -> CodeType:
    """Return the code of a template that knows filters of these names."""
    environment = _environment()
    environment.filters |= dict.fromkeys(filters, str)
    return environment.compile(template)
