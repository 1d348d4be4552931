"""Write the combinations of a matrix as Markdown: red ones first, green ones folded, no column of one value."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msgspec import Struct

from harness.model import Role, Verdict
from harness.model.report_types import SYMBOLS, format_count, word
from harness.reports.tables.table_types import Row, Sheet, Trouble
from harness.reports.text.cause_markdown import Headings
from harness.reports.text.markdown_texts import code, code_cell, file_link, table_cell

LONGEST_WHY = 200
"""Characters of a line that a row shows."""

FOLDED = 8
"""Green combinations of which the table is shown at once; that of more is folded."""

EMPTY = {"", "-"}

MACHINE = "machine"
"""The head of a column; a single machine is told below the table."""


class Column(Struct, frozen=True):
    """A column of the table: its head, its cells by row, and whether they are numbers."""

    head: str
    cells: tuple[str, ...]
    numbers: bool = False

    @property
    def constant(self) -> bool:
        """Return whether it holds one value in all of several rows, or none in any."""
        return len({*self.cells}) == 1 and (len(self.cells) > 1 or {*self.cells} <= EMPTY)

    def named_in(self, labels: Sequence[str]) -> bool:
        """Return whether the names of the combinations say all of it, as `mujoco-3.3.7` says the version of mujoco."""
        return all(f"_{self.head}-{cell}_" in f"_{label}_" for cell, label in zip(self.cells, labels, strict=True))


def combination_tables(sheet: Sheet, headings: Headings) -> str:
    """Return a sentence on what all combinations share, and tables of the others and of those that work."""
    columns = _columns(sheet, headings)
    result, *others = columns
    same = [
        f"{column.head} {column.cells[0]}"
        for column in others
        if column.constant and column.cells[0] not in EMPTY and column.head != MACHINE
    ]
    labels = [row.label for row in sheet.rows]
    shown = [result, *(column for column in others if not column.constant and not column.named_in(labels))]
    green = [row.verdict is Verdict.WORKS and row.as_expected is not False for row in sheet.rows]
    tables = [
        _table(shown, [number for number, works in enumerate(green) if not works]),
        _folded(_table(shown, [number for number, works in enumerate(green) if works]), sum(green)),
    ]
    words = f"The same in all {len(sheet.rows)}: {', '.join(same)}.\n" if same else ""
    return "\n".join(filter(None, [words, *tables]))


def _folded(table: str, count: int) -> str:
    if count <= FOLDED:
        return table
    return f"<details>\n<summary>{format_count(count, 'combination')} that work</summary>\n\n{table}\n</details>\n"


def _columns(sheet: Sheet, headings: Headings) -> list[Column]:
    rows = sheet.rows

    def column(head: str, make: Callable[[Row], str], *, numbers: bool = False) -> Column:
        return Column(head, tuple(map(make, rows)), numbers)

    return [
        column("result", _outcome),
        column("combination", lambda row: table_cell(code(row.label))),
        column("why", _reasons(sheet, headings)),
        column("tasks", lambda row: f"{row.passed}/{row.tried}" if row.tried else "", numbers=True),
        column("own tests", lambda row: table_cell(row.suite), numbers=True),
        *(
            column(table_cell(name), lambda row, place=place: table_cell(row.versions[place]))  # type: ignore[misc]
            for place, name in enumerate(sheet.columns)
        ),
        column("lock", lambda row: file_link("lock", row.lock) if row.lock else ""),
        column("findings", lambda row: str(row.findings or ""), numbers=True),
        column("seconds", lambda row: f"{row.seconds:.1f}", numbers=True),
        column(MACHINE, lambda row: table_cell(row.machine)),
    ]


def _table(columns: Sequence[Column], places: Sequence[int]) -> str:
    """Return a table of some of the rows, without columns that are empty in all of them; empty without rows."""
    if not places:
        return ""
    shown = [column for column in columns if {column.cells[place] for place in places} - {""}]
    lines = [
        [column.head for column in shown],
        ["--:" if column.numbers else "---" for column in shown],
        *([column.cells[place] for column in shown] for place in places),
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _outcome(row: Row) -> str:
    """Return `◐ partial in render, repair (not expected)`."""
    phase = f" in {row.phase}" if row.phase else ""
    patched = ", patched" if row.repaired else ""
    role = f", {row.role}" if row.role is not Role.MAIN else ""
    unexpected = " (not expected)" if row.as_expected is False else ""
    return f"{SYMBOLS[row.verdict]} {word(row.verdict)}{phase}{patched}{role}{unexpected}"


def _reasons(sheet: Sheet, headings: Headings) -> Callable[[Row], str]:
    """Return a function from a row to why it is not green: a link to its cause, else its line."""
    sections: dict[tuple[str, Verdict], Trouble] = {}
    for trouble in sheet.troubles:
        for why in trouble.explanations:
            for cell in why.cells:
                sections.setdefault((cell.partition(" on ")[0], why.verdict), trouble)

    def reason(row: Row) -> str:
        trouble = sections.get((row.label, row.verdict))
        if trouble:
            return headings.link(trouble) + (", fix proven" if row.proven else "")
        if row.verdict is Verdict.WORKS:
            return table_cell(short(row.why))
        return code_cell(short(row.why))

    return reason


def short(text: str) -> str:
    """Return one line of a text, its end cut off if it is long."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST_WHY else f"{line[: LONGEST_WHY - 1].rstrip()}…"
