"""Write pictures as Markdown: the table of looks, and a sentence for each way in which releases differ."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

from harness.model.report_types import PictureBoundaryEntry, PictureDifferenceEntry, PicturesEntry, first_few
from harness.physics.pixel_sentences import describe_making
from harness.physics.relation import JUST_NOTICEABLE, Look
from harness.physics.sentences import percent
from harness.reports.text.markdown_texts import table_cell

NAMED = 12
"""Environments that a sentence names at most."""

SUBJECTS = {
    "states": "Every release drew some states of each bank with the environment's own camera",
    "start": "Every release drew the image after a reset with one seed; compared where the first observation is equal",
}


def picture_table(entry: PicturesEntry) -> str:
    """Return a table of looks: a row for each environment, a column for each range of releases that look alike."""
    columns = list(zip(*entry.letters.values(), strict=True))
    starts = [0, *(number + 1 for number, (left, right) in enumerate(pairwise(columns)) if left != right)]
    ranges = list(pairwise([*starts, len(columns)]))
    names = [
        entry.releases[start] if end == start + 1 else f"{entry.releases[start]} to {entry.releases[end - 1]}"
        for start, end in ranges
    ]
    head = [f"images / {entry.axis}", *names]
    rows = [[env, *(letters[start] for start, _ in ranges)] for env, letters in sorted(entry.letters.items())]
    lines = [head, ["---", *(":-:" for _ in ranges)], *rows]
    return "".join(f"| {' | '.join(table_cell(cell) for cell in line)} |\n" for line in lines)


def picture_legend(entry: PicturesEntry) -> str:
    """Explain the letters."""
    marks = {letter[-1] for letters in entry.letters.values() for letter in letters}
    endings = {
        "'": "A prime: some pixels differ, but the eye does not see it.",
        "?": "`?`: not comparable, because the environment starts or draws differently each time.",
        "-": "`-`: not drawn.",
    }
    if entry.method == "start":
        endings["?"] = "`?`: not comparable, because the first observation differs."
    return " ".join(
        [
            f"{SUBJECTS[entry.method]}. The same small letter in a row means the same look; another letter means a "
            f"visible difference (colours differ by more than {JUST_NOTICEABLE} in CIELAB).",
            *(text for mark, text in endings.items() if mark in marks),
        ]
    )


def picture_title(entry: PicturesEntry) -> str:
    """Return the heading: the axis, and all others as they stand."""
    where = ", ".join(f"{name} {value}" for name, value in entry.where.items())
    return f"{entry.axis} ({where})" if where else entry.axis


def picture_sentences(entry: PicturesEntry) -> list[str]:
    """Return a sentence for each boundary and each way in which environments differ there."""
    return [sentence for boundary in entry.boundaries for sentence in _sentences(entry, boundary)]


def _sentences(entry: PicturesEntry, boundary: PictureBoundaryEntry) -> Iterator[str]:
    groups: dict[tuple[object, ...], list[PictureDifferenceEntry]] = {}
    for difference in boundary.differences:
        groups.setdefault((difference.kind, difference.moved, difference.compared), []).append(difference)
    others = ", ".join(
        f"{name} {one or 'absent'} to {other or 'absent'}" for name, (one, other) in boundary.moved.items()
    )
    for differences in sorted(groups.values(), key=lambda group: -len(group)):
        first = differences[0]
        count = f"{len(differences)} of {boundary.tasks} tasks"
        names = "" if len(differences) == boundary.tasks else f" ({_names(differences)})"
        text = _difference(count, first, differences)
        unseparated = f"; other packages differ, too: {others}" if others else ""
        yield f"{entry.axis} {boundary.before} to {boundary.after}: {text}{names}{unseparated}."


def _difference(count: str, first: PictureDifferenceEntry, differences: Iterable[PictureDifferenceEntry]) -> str:
    making = describe_making(first.moved, first.compared)
    if first.kind == Look.IMPERCEPTIBLE:
        return f"{count} differ in pixels, but not visibly; {making}"
    if first.kind == Look.OTHER_SIZE:
        return f"{count} are drawn in another size"
    if first.kind == Look.NONDETERMINISTIC:
        return f"{count} draw the same state differently each time"
    shares = [one.share for one in differences]
    low, high = percent(min(shares)), percent(max(shares))
    span = low if low == high else f"{low} to {high}"
    return f"{count} look different in {span} of the image; {making}"


def _names(differences: Sequence[PictureDifferenceEntry]) -> str:
    return first_few([one.env or one.case for one in differences], NAMED)
