"""Write the frames of a matrix as Markdown: a row of pictures for each task, with its releases under each."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Sequence

from harness.model import Verdict
from harness.model.report_types import SYMBOLS, format_count
from harness.reports.tables.table_types import EVERY, Frame, FrameRow
from harness.reports.text.markdown_texts import FILE, code, table_cell

SHOWN = 6
"""Tasks whose pictures are shown at once; those of more are folded."""

WIDEST = 5
"""Pictures side by side; more of them are shown below."""

Picture = Callable[[str, str], str]
"""From words and a path to what stands for a picture in a page."""


class Pictures:
    """The pictures of a page. Their Markdown is put in last, so that no text of a package can become one."""

    def __init__(self) -> None:
        self._mark = secrets.token_hex(16)
        self._pictures: list[str] = []

    def place(self, words: str, path: str) -> str:
        """Return a mark that stands for a picture beside the page; the words alone if the path is no plain one."""
        plain = "".join(letter for letter in words if letter.isalnum() or letter in " .,:-_/=")
        if not FILE.fullmatch(path):
            return plain
        self._pictures.append(f"![{plain}]({path})")
        return f"{self._mark}-{len(self._pictures) - 1}-"

    def put_in(self, page: str) -> str:
        """Return the page with its pictures."""
        for number, picture in enumerate(self._pictures):
            page = page.replace(f"{self._mark}-{number}-", picture)
        return page


def frame_tables(rows: Sequence[FrameRow], picture: Picture) -> str:
    """Return a table for each task; tasks of one picture share tables. The tables of many tasks are folded."""
    several = [row for row in rows if len(row.frames) > 1 or row.frames[0].misleads]
    alone = [row for row in rows if row not in several]
    tables = [_task_table(row, picture) for row in several]
    if alone:
        tables.append(_shared_table(alone, picture))
    if len(several) <= SHOWN:
        return "\n".join(tables)
    hidden = tables[SHOWN:]
    summary = f"The images of {format_count(len(rows) - SHOWN, 'more task')}"
    return "\n".join([*tables[:SHOWN], f"<details>\n<summary>{summary}</summary>\n", "\n".join(hidden), "</details>\n"])


def _task_table(row: FrameRow, picture: Picture) -> str:
    title = code(row.task) + (f" ({code(row.env)})" if row.env not in {"", row.task} else "")
    shown = [(picture(f"{row.task}, {frame.where}", frame.path), _caption(frame)) for frame in row.frames]
    return f"{title}:\n\n{_table(shown)}"


def _shared_table(rows: Sequence[FrameRow], picture: Picture) -> str:
    shown = [(picture(row.task, row.frames[0].path), _shared_caption(row)) for row in rows]
    return f"These look the same wherever they were drawn:\n\n{_table(shown)}"


def _shared_caption(row: FrameRow) -> str:
    frame = row.frames[0]
    return _code(row.task) + ("" if frame.where == EVERY else f"<br>{table_cell(frame.where)}")


def _caption(frame: Frame) -> str:
    """Return the releases of a picture; before them a sign and words if it misleads."""
    where = table_cell(frame.where)
    if not frame.misleads:
        return where
    what = "this image misleads" if frame.misleads.startswith("render.") else "the task misleads"
    return f"{SYMBOLS[Verdict.MISLEADS]} **{what}**<br>{where}<br>{_code(frame.issue or frame.misleads)}"


def _code(text: str) -> str:
    return table_cell(code(text))


def _table(shown: Sequence[tuple[str, str]]) -> str:
    """Return a table of pictures, each above its words."""
    columns = min(len(shown), WIDEST)
    lines: list[list[str]] = []
    for start in range(0, len(shown), columns):
        held = [*shown[start : start + columns], *[("", "")] * (start + columns - len(shown))]
        lines += [[picture for picture, _ in held], [words for _, words in held]]
    lines.insert(1, [":-:"] * columns)
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
