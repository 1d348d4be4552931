"""Write the environments that were tried as Markdown: those with the same result in one row, failing ones first."""

from __future__ import annotations

from collections.abc import Sequence

from harness.model.report_types import first_few
from harness.reports.tables.table_types import Task
from harness.reports.text.markdown_texts import code, table_cell

NAMED = 24
"""Tasks of one row that are named."""

ALIKE = 6
"""Tasks up to which each has a row of its own."""


def task_table(tasks: Sequence[Task]) -> str:
    """Return a sentence on what all tasks share, and a table; tasks with the same result are one row."""
    groups: dict[tuple[object, ...], list[Task]] = {}
    for place, task in enumerate(tasks):
        alone = place if len(tasks) <= ALIKE else None
        groups.setdefault((task.api, task.phases, task.passed, task.tried, alone), []).append(task)
    rows = sorted(groups.values(), key=lambda held: held[0].passed == held[0].tried)
    columns = [
        ("API", [held[0].api or "-" for held in rows]),
        ("phases", [", ".join(held[0].phases) or "-" for held in rows]),
    ]
    same = [f"{name} {cells[0]}" for name, cells in columns if len({*cells}) == 1 and cells[0] != "-"]
    shown = [(name, cells) for name, cells in columns if len({*cells}) > 1]
    lines = [
        ["task", *(name for name, _ in shown), "passed in"],
        ["---", *("---" for _ in shown), "--:"],
        *(
            [
                table_cell(first_few([_name(task) for task in held], NAMED)),
                *(table_cell(cells[place]) for _, cells in shown),
                f"{held[0].passed} of {held[0].tried}",
            ]
            for place, held in enumerate(rows)
        ),
    ]
    words = f"The same for all: {'; '.join(same)}.\n\n" if same else ""
    return words + "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _name(task: Task) -> str:
    """Return the name of a task, with its environment if that has another name."""
    if not task.env:
        return f"import of {code(task.name)}"
    return code(task.name) if task.env == task.name else f"{code(task.name)} ({code(task.env)})"
