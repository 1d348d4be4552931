"""Write pages from templates. Everything in them is escaped; code between backticks becomes code."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from harness.model import Outcome, Phase
from harness.model.report_types import format_count
from harness.reports.site.site_facts import name_mark, sign
from harness.reports.text.markdown_texts import ADDRESS
from harness.standalone.control_characters import strip_controls

FOLDER = Path(__file__).parent
CODE = re.compile(r"`([^`\n]+)`")
LINK = re.compile(r"https?://(?:www\.)?([^/]+)(?:/([^/]+/[^/]+)/(?:issues|pull|discussions)/(\d+))?")

OUTCOMES = {
    Outcome.PASSED: "✔",
    Outcome.SKIPPED: "-",
    Outcome.NOT_REACHED: "·",
    Outcome.UNAVAILABLE: "◌",
}
"""Signs of outcomes; every other one is a failure."""


def prose(text: str) -> Markup:
    """Return text as HTML, with code where it stands between backticks."""
    pieces = CODE.split(text)
    return Markup("").join(
        Markup("<code>{}</code>").format(piece) if place % 2 else escape(piece) for place, piece in enumerate(pieces)
    )


def link(address: str) -> Markup:
    """Return a web address as a link with a short text; anything else as code."""
    if not ADDRESS.fullmatch(address):
        return Markup("<code>{}</code>").format(address)
    match = LINK.match(address)
    text = (f"{match[2]}#{match[3]}" if match[3] else match[1]) if match else address
    return Markup('<a href="{}" rel="noreferrer noopener">{}</a>').format(address, text)


def sentence(text: str) -> str:
    """Return text that begins with a capital letter and ends with a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""


def outcome_sign(outcome: Outcome | str) -> str:
    """Return the sign of the outcome of a phase."""
    return OUTCOMES.get(Outcome(outcome), "✘")


def tone(outcome: Outcome | str) -> str:
    """Return the class of an outcome in the style sheet."""
    tones = {Outcome.PASSED: "works", Outcome.SKIPPED: "not_run", Outcome.NOT_REACHED: "not_run"}
    return tones.get(Outcome(outcome), "unavailable" if outcome == Outcome.UNAVAILABLE else "broken")


def in_order(phases: Mapping[Phase, Outcome]) -> list[tuple[Phase, Outcome]]:
    """Return phases in the order in which they run."""
    return [(phase, phases[phase]) for phase in Phase if phase in phases]


class PageWriter:
    """Writes the pages of one site into its folder; `shared` are values that every page shows."""

    def __init__(self, target: Path, shared: dict[str, Any]) -> None:
        self._target = target
        self._environment = Environment(
            loader=FileSystemLoader(FOLDER / "templates"),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        filters: dict[str, Callable[..., Any]] = {
            "prose": prose, "link": link, "sign": sign, "word": name_mark, "number": format_count, "sentence": sentence,
            "in_order": in_order, "outcome_sign": outcome_sign, "tone": tone,
        }  # fmt: skip
        self._environment.filters |= filters
        self._environment.globals |= shared
        self.pages = 0

    def write(self, address: str, template: str, **values: Any) -> None:
        """Write a page. In its template `root` is the way to the home page, before every address of the site."""
        root = "../" * address.count("/")
        text = self._environment.get_template(template).render(root=root, page_address=address, **values)
        self._write(address, strip_controls(text))
        self.pages += 1

    def write_data(self, address: str, name: str, value: Any) -> None:
        """Write a script that sets one variable: a page that is opened from disk cannot load JSON."""
        # JSON allows two ends of a line that older scripts do not.
        text = msgspec.json.encode(value).decode().replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
        self._write(address, f"window.{name} = {text};\n")

    def copy_assets(self) -> None:
        """Copy the style sheet and the script."""
        for file in sorted((FOLDER / "assets").iterdir()):
            self._write(f"assets/{file.name}", file.read_text(encoding="utf-8"))

    def _write(self, address: str, text: str) -> None:
        path = self._target / address
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", errors="replace")
