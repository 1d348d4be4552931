"""Read the combinations that were measured by hand, with uv and Python alone: `tests/real/measured.toml`."""

from __future__ import annotations

import html
import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import msgspec

from harness.model import Phase, cellid
from harness.model.schema import load_toml
from harness.model.vocabulary import parsed_requirement
from harness.reports.past_results import table_files
from harness.reports.past_results.table_cells import Row, RowCase, Table

MATRIX = "measured-by-hand"
NOTHING = "none"
SUPPLIED = {"MUJOCO_GL": "egl", "SDL_VIDEODRIVER": "dummy"}
"""The facts of all probes, which the head of the file holds."""
MACHINE = re.compile(r"^Made by .* on \d{4}-\d\d-\d\d, ([\w.-]+), Python ", re.MULTILINE)
ROW = re.compile(r"^\|  \| (?P<python>\S+) \| `(?P<typed>.*?)` \| (?P<env>.*?) \| \w+ \| \w+ \| (?P<line>.*) \|$")


class HandCase(msgspec.Struct, frozen=True, kw_only=True):
    """One environment of an entry, as the file has it."""

    env: str
    api: str
    first_failure: str
    decisive: str | None = None
    cause: str | None = None
    check: str | None = None
    imports: tuple[str, ...] = ()
    kwargs: dict[str, Any] = {}


class HandEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One entry of the file."""

    requirements: tuple[str, ...]
    python: str
    snapshot: str
    cases: tuple[HandCase, ...]
    note: str = ""
    installed: dict[str, str] = {}
    environment: dict[str, str] = {}
    only_binary: tuple[str, ...] = ()
    sample: bool = False


class HandFile(msgspec.Struct, frozen=True, kw_only=True):
    """The whole file."""

    combination: tuple[HandEntry, ...]


def read_rows(text: str, agreement: str) -> Iterator[tuple[Row, Table]]:
    """Yield each entry with its table; the pages of agreement have longer lines, and the machine. Raises BadInput."""
    longer = dict(_agreed_lines(agreement))
    machine = MACHINE.search(agreement)
    seen: Counter[str] = Counter()
    for entry in load_toml(text, HandFile, table_files.HAND).combination:
        label = cellid.of_question(entry.python, map(parsed_requirement, entry.requirements))
        seen[label] += 1
        # Some entries ask for the same packages in another way, such as wheels alone.
        number = f"{cellid.BETWEEN}{cellid.MORE}{seen[label]}" if seen[label] > 1 else ""
        row = Row(
            label=f"{label}{number}",
            python=entry.python,
            requirements=entry.requirements,
            cases=tuple(_case(entry, case, longer) for case in entry.cases),
            installed=entry.installed,
            environment=entry.environment,
        )
        yield (
            row,
            Table(
                matrix=MATRIX,
                source=table_files.HAND,
                # The day is that of the index: nothing newer was installed.
                measured=entry.snapshot,
                machine=machine[1] if machine else "linux",
                supplied=SUPPLIED,
            ),
        )


def _case(entry: HandEntry, case: HandCase, longer: dict[tuple[str, str, str], str]) -> RowCase:
    whole = longer.get((entry.python, " ".join(entry.requirements), case.env), "")
    decisive = whole if case.decisive and case.decisive[:100] in whole else case.decisive
    return RowCase(
        env=case.env,
        api=case.api,
        first_failure=None if case.first_failure == NOTHING else Phase(case.first_failure),
        decisive=decisive,
        more=(case.cause,) if case.cause else (),
    )


def _agreed_lines(page: str) -> Iterator[tuple[tuple[str, str, str], str]]:
    """Yield the line that the harness gave for each case of the page on which both agree."""
    for line in page.splitlines():
        row = ROW.match(line)
        if row and row["line"].strip():
            typed, env, text = (html.unescape(row[name]).replace("\\", "") for name in ("typed", "env", "line"))
            yield (row["python"], typed, env), _without_code_span(text.strip())


def _without_code_span(text: str) -> str:
    """Return the text inside a code span, whose fence is one backtick or more than the text has in a row."""
    fence = text[: len(text) - len(text.lstrip("`"))]
    inner = text.removeprefix(fence).removesuffix(fence)
    return inner[1:-1] if len(fence) > 1 and inner[:1] == inner[-1:] == " " else inner
