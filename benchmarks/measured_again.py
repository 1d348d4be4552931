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

    def explains(self, one: Difference) -> bool:
        """Return whether a difference is one of these."""
        said = one.field in self.fields and fnmatchcase(one.cell, self.cells)
        return said and bool(re.search(self.before, str(one.before)) and re.search(self.after, str(one.after)))


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
            one, other = old.get(field), new.get(field)
            if one != other and NUMBER.sub("…", str(one)) != NUMBER.sub("…", str(other)):
                yield Difference(cell=name, field=field, before=one, after=other)


def at(commit: str, name: str) -> dict[str, Any]:
    """Return the report of a matrix at a commit."""
    asked = ["git", "show", f"{commit}:reports/{name}/report.json"]
    told = subprocess.run(asked, check=True, capture_output=True, cwd=HERE.parent).stdout
    return dict(json.loads(told))


def page(
    commit: str, names: Sequence[str], total: int, found: Mapping[str, list[Difference]], known: Mapping[str, Reason]
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
    for name, those in sorted(found.items(), key=lambda pair: -len(pair[1])):
        seen = list(dict.fromkeys(one.cell for one in those))
        named = ", ".join(f"`{cell}`" for cell in seen[:MOST_NAMED]) + (" …" if len(seen) > MOST_NAMED else "")
        reason = known.get(name)
        why, hand = (reason.why, reason.by_hand) if reason else ("**no reason known**", "")
        lines.append(f"| {why} | {len(seen)}: {named} | {len(those)} | {hand} |")
    lines += ["", f"Measured again: {', '.join(names)}.", ""]
    return "\n".join(lines)


def main() -> int:
    """Compare the reports with those of a commit; return 1 if a difference has no reason."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("commit")
    parser.add_argument("--write", action="store_true")
    args = parser.parse_args()
    listed = tomllib.loads(REASONS.read_text(encoding="utf-8"))["reason"]
    known = {one["id"]: Reason(**{**one, "fields": tuple(one.get("fields", FIELDS))}) for one in listed}
    names = sorted(path.parent.name for path in REPORTS.glob("*/index.json"))
    found: dict[str, list[Difference]] = {}
    total = 0
    for name in names:
        now = cells(json.loads((REPORTS / name / "report.json").read_bytes()))
        total += len(now)
        for one in differences(cells(at(args.commit, name)), now):
            reason = next((each.id for each in known.values() if each.explains(one)), "")
            found.setdefault(reason, []).append(one)
    text = page(args.commit, names, total, found, known)
    if args.write:
        PAGE.write_text(text, encoding="utf-8")
    print(text)
    for one in found.get("", []):
        print(f"no reason: {one.cell} {one.field}: {one.before} -> {one.after}", file=sys.stderr)
    return 1 if "" in found else 0


if __name__ == "__main__":
    raise SystemExit(main())
