"""List what a second measurement of the committed reports changed, and why: `measured_again.py COMMIT`.

Verdicts, phases, decisive lines and causes of every cell are held against those of the report at COMMIT. Each
difference needs a reason in `measured_again.toml`, which says how to see it by hand; one without is listed as such, and
the exit code is 1. `--write` writes `measured_again.md`.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
REPORTS = HERE.parent / "reports"
REASONS, PAGE = HERE / "measured_again.toml", HERE / "measured_again.md"
FIELDS = ("verdict", "phase", "decisive", "causes")
NUMBER = re.compile(r"\d+\.\d+(?:e[+-]\d+)?")
MOST_NAMED = 4

Cells = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Difference:
    """One field of a cell that differs between two reports."""

    cell: str
    field: str
    before: Any
    after: Any


@dataclass(frozen=True, kw_only=True)
class Reason:
    """A reason why cells differ.

    It holds for cells that the glob fits, in these fields, if the patterns find the values before and after.
    """

    id: str
    why: str
    by_hand: str
    cells: str = "*"
    fields: tuple[str, ...] = FIELDS
    before: str = ""
    after: str = ""

    def explains(self, difference: Difference) -> bool:
        """Return whether a difference is one of these."""
        applies = difference.field in self.fields and fnmatchcase(difference.cell, self.cells)
        return applies and bool(
            re.search(self.before, str(difference.before)) and re.search(self.after, str(difference.after))
        )


def cells(document: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the fields of each cell of a report, and the outcome of each phase."""
    return {
        cell["id"]: {
            **{name: cell[name] for name in ("verdict", "phase", "decisive")},
            "causes": [one["signature"] for one in cell["diagnoses"]],
            **cell["phases"],
        }
        for cell in document["cells"]
    }


def differences(before: Cells, after: Cells) -> Iterator[Difference]:
    """Yield each field of each cell that differs, except for decimal numbers in a line."""
    for name in {**before, **after}:
        old, new = before.get(name, {}), after.get(name, {})
        for field in {**old, **new}:
            value, other = old.get(field), new.get(field)
            if value != other and NUMBER.sub("…", str(value)) != NUMBER.sub("…", str(other)):
                yield Difference(cell=name, field=field, before=value, after=other)


def read_report(commit: str, name: str) -> dict[str, Any]:
    """Return the report of a matrix at a commit."""
    command = ["git", "show", f"{commit}:reports/{name}/report.json"]
    output = subprocess.run(command, check=True, capture_output=True, cwd=HERE.parent).stdout
    return dict(json.loads(output))


def page(
    commit: str,
    names: Sequence[str],
    total: int,
    by_reason: Mapping[str, list[Difference]],
    reasons: Mapping[str, Reason],
) -> str:
    """Return the table of all differences, by reason."""
    lines = [
        "# The committed reports, measured a second time",
        "",
        f"Made by `python benchmarks/measured_again.py {commit} --write` on {datetime.now(UTC):%Y-%m-%d}. "
        f"{len(names)} reports with {total} cells were measured again, with their evidence. Verdicts, phases, decisive "
        "lines and causes are held against those of before; numbers within a line are not.",
        "",
        "| reason | cells | differences | by hand |",
        "| --- | --- | --- | --- |",
    ]
    for name, group in sorted(by_reason.items(), key=lambda pair: -len(pair[1])):
        seen = list(dict.fromkeys(one.cell for one in group))
        named = ", ".join(f"`{cell}`" for cell in seen[:MOST_NAMED]) + (" …" if len(seen) > MOST_NAMED else "")
        reason = reasons.get(name)
        why, hand = (reason.why, reason.by_hand) if reason else ("**no reason known**", "")
        lines.append(f"| {why} | {len(seen)}: {named} | {len(group)} | {hand} |")
    lines += ["", f"Measured again: {', '.join(names)}.", ""]
    return "\n".join(lines)


def main() -> int:
    """Compare the reports with those of a commit; return 1 if a difference has no reason."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("commit")
    parser.add_argument("--write", action="store_true")
    args = parser.parse_args()
    listed = tomllib.loads(REASONS.read_text(encoding="utf-8"))["reason"]
    reasons = {one["id"]: Reason(**{**one, "fields": tuple(one.get("fields", FIELDS))}) for one in listed}
    names = sorted(path.parent.name for path in REPORTS.glob("*/index.json"))
    by_reason: dict[str, list[Difference]] = {}
    total = 0
    for name in names:
        now = cells(json.loads((REPORTS / name / "report.json").read_bytes()))
        total += len(now)
        for difference in differences(cells(read_report(args.commit, name)), now):
            reason = next((each.id for each in reasons.values() if each.explains(difference)), "")
            by_reason.setdefault(reason, []).append(difference)
    text = page(args.commit, names, total, by_reason, reasons)
    if args.write:
        PAGE.write_text(text, encoding="utf-8")
    print(text)
    for difference in by_reason.get("", []):
        print(
            f"no reason: {difference.cell} {difference.field}: {difference.before} -> {difference.after}",
            file=sys.stderr,
        )
    return 1 if "" in by_reason else 0


if __name__ == "__main__":
    raise SystemExit(main())
