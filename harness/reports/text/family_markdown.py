"""Write behaviour as Markdown: the table of families, and what changes at each boundary."""

from __future__ import annotations

from collections.abc import Sequence

from harness.physics.sentences import percent
from harness.reports.tables.family_tables import EXERCISED, FamilyTable
from harness.reports.text.markdown_texts import table_cell

NAMES = {"contact": "in contact", "limit": "at a joint limit", "equality": "with an equality"}


def family_table(table: FamilyTable) -> str:
    """Return a table of families: a row for each environment, a column for each range of releases."""
    head = [f"environment / {table.axis}", *table.columns]
    rows = [[env, *letters] for env, letters in table.rows]
    lines = [head, ["---", *(":-:" for _ in table.columns)], *rows]
    return "".join(f"| {' | '.join(table_cell(cell) for cell in line)} |\n" for line in lines)


def coverage_table(table: FamilyTable) -> str:
    """Return a table of the shares of states that exercise each kind of constraint."""
    head = ["environment", *(NAMES[kind] for kind in EXERCISED)]
    rows = [[env, *map(percent, shares)] for env, shares in table.coverage]
    lines = [head, ["---", *("--:" for _ in EXERCISED)], *rows]
    return "".join(f"| {' | '.join(table_cell(cell) for cell in line)} |\n" for line in lines)


def changed(tables: Sequence[FamilyTable]) -> str:
    """Say how many environments change their behaviour, of each table."""
    return " ".join(
        f"{table.changed} of {table.tasks} environments {'changes its' if table.changed == 1 else 'change their'} "
        f"behaviour over {table.measured} releases of "
        f"{table.subject}{f' ({table.where})' if len(tables) > 1 else ''}."
        for table in tables
    )


def family_legend(table: FamilyTable) -> str:
    """Explain the letters, and say how many environments change."""
    open_ends = " `?`: undecided." if any("?" in letter for _, row in table.rows for letter in row) else ""
    return (
        f"Every release of {table.subject} was stepped from the same states. The same letter in a row means the same "
        "motion, observations, rewards and ends, up to rounding; another letter means a difference."
        f"{open_ends} {table.changed} of {table.tasks} environments change somewhere in these {table.measured} "
        "releases. Observations of more than 30 numbers were compared in every second state."
    )
