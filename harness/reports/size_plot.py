"""Plot how much the behaviour of each environment changes from release to release.

matplotlib takes a third of a second to import, and few reports have behaviour: functions import it.
"""

from __future__ import annotations

import io
import math
import warnings
from typing import TYPE_CHECKING, Any

from harness.physics.relation import AGREEING, Class
from harness.reports.tables.family_tables import FamilyTable, ReleaseStep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SMALLEST = -12
"""The logarithm of the smallest size that has a colour of its own."""

ALIKE, OTHER, UNMEASURED = "#eeeeee", "#444444", "#ffffff"
"""Colours of releases that behave like the one before them, that differ in no size, and that were not measured."""

SETTINGS: Any = {
    "svg.hashsalt": "simmatrix",
    "svg.fonttype": "none",
    "text.parse_math": False,  # a dollar in a name is one
    "font.size": 7,
    "font.family": "sans-serif",
}
WIDTH, HEIGHT = 0.2, 0.19
"""Inches of a square."""

LEGEND = (
    "Colour and number: power of ten of the median relative difference to the release before, where it differs. "
    "Light grey: alike up to rounding. Dark: another interface, observation, reward or end. Dot: other starts. "
    "Question mark: cannot be decided."
)


def draw(table: FamilyTable) -> bytes:
    """Return an SVG picture: a row for each environment, a column for each release."""
    from matplotlib import rc_context  # noqa: PLC0415 - start-up
    from matplotlib.figure import Figure  # noqa: PLC0415 - start-up

    with rc_context(SETTINGS), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # names longer than the picture leave no room: it is drawn all the same
        rows, columns = len(table.steps), len(table.releases)
        figure = Figure(figsize=(2.2 + WIDTH * columns, 1.3 + HEIGHT * rows), layout="constrained")
        axes = figure.add_subplot()
        _fill(axes, table)
        axes.set_xticks(range(columns), table.releases, rotation=90)
        axes.set_yticks(range(rows), list(table.steps))
        axes.tick_params(length=0)
        axes.set_title(f"Change of behaviour, release by release of {table.subject}", loc="left")
        figure.supxlabel(LEGEND, x=0.01, ha="left", fontsize=5.5, wrap=True)
        content = io.BytesIO()
        figure.savefig(content, format="svg", metadata={"Date": None, "Creator": None})
    return content.getvalue()


def _fill(axes: Axes, table: FamilyTable) -> None:
    colours = [[_colour(step) for step in row] for row in table.steps.values()]
    axes.imshow(colours, interpolation="none", aspect="auto")
    for place, row in enumerate(table.steps.values()):
        for column, step in enumerate(row):
            text = _mark(step) if step else ""
            if step and text:
                ink = "white" if _has_size(step) and _power(step.size) < SMALLEST / 2 else "black"
                axes.text(column, place, text, ha="center", va="center", fontsize=5, color=ink)


def _mark(step: ReleaseStep) -> str:
    if step.kind == Class.UNDECIDED:
        return "?"
    if _has_size(step):
        return str(_power(step.size))
    return "●" if step.starts_otherwise else ""


def _has_size(step: ReleaseStep) -> bool:
    return step.size > 0 and step.kind != Class.UNDECIDED


def _colour(step: ReleaseStep | None) -> tuple[float, ...]:
    from matplotlib import colormaps  # noqa: PLC0415 - start-up
    from matplotlib.colors import to_rgba  # noqa: PLC0415 - start-up

    if step is None:
        return to_rgba(UNMEASURED)
    if _has_size(step):
        share = 1 - _power(step.size) / SMALLEST
        return colormaps["viridis"](min(1.0, max(0.0, share)))
    return to_rgba(ALIKE if step.kind in {*AGREEING, Class.UNDECIDED} else OTHER)


def _power(size: float) -> int:
    """Return the power of ten of a size."""
    return math.floor(math.log10(size))
