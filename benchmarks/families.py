"""Write what each family of packages cost to measure: `python -m benchmarks.families` writes `families.md`.

The figures are those of `families.toml`, written down after each run, and the verdicts those of the committed reports.
"""

from __future__ import annotations

import argparse
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from harness.reports import document

HERE = Path(__file__).parent
PAGE = HERE / "families.md"
FIGURES = ("hours", "cpu_hours", "gigabytes")
"""The columns; one that was not measured is empty."""
HEAD = """# What each family cost

Made by `python -m benchmarks.families` from [families.toml](families.toml): wall hours on two cores that other runs
shared, CPU hours (user and system), and gigabytes of the cache that the run filled.

| family | combinations | verdicts | hours | CPU hours | GB | note |
| --- | --: | --- | --: | --: | --: | --- |
"""


def rows(families: dict[str, dict[str, Any]]) -> Iterator[str]:
    """Yield a row for each family, and their sum."""
    for name, cost in families.items():
        cells = document.read_file(HERE.parent / "reports" / name / "report.json").cells
        verdicts = ", ".join(f"{count} {verdict}" for verdict, count in Counter(cell.verdict for cell in cells).items())
        figures = " | ".join(f"{cost[key]:.2f}" if key in cost else "" for key in FIGURES)
        yield f"| [{name}](../reports/{name}/report.md) | {len(cells)} | {verdicts} | {figures} | {cost['note']} |"
    total = " | ".join(f"{sum(each.get(key, 0) for each in families.values()):.2f}" for key in FIGURES)
    yield f"| sum | {sum(each['cells'] for each in families.values())} | | {total} | |"


def main() -> None:
    """Write the page."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    families = tomllib.loads((HERE / "families.toml").read_text(encoding="utf-8"))["family"]
    PAGE.write_text(HEAD + "\n".join(rows(families)) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
