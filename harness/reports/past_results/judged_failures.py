"""Read the failing combinations that judge diagnoses: `benchmarks/judged.toml`, with what is so of each.

Combinations of the file without a line of the truth did not fail. How they ended is not written down anywhere.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from harness.model import Phase
from harness.model.schema import toml_table
from harness.reports.past_results import table_files
from harness.reports.past_results.table_cells import Row, RowCase, Table

MATRIX = "judged"
DAY = re.compile(r"^Made by .* on (\d{4}-\d\d-\d\d): Python ", re.MULTILINE)


def read_rows(matrix: str, truth: str, page: str) -> Iterator[tuple[Row, Table]]:
    """Yield each failing combination with its table; the page has the day. Raises BadInput."""
    combinations_file = toml_table(matrix, table_files.JUDGED)
    day = DAY.search(page)
    table = Table(
        matrix=MATRIX,
        source=table_files.TRUTH,
        measured=f"{day[1] if day else combinations_file['snapshot']}T00:00:00Z",
        machine="linux-x86_64",
        supplied={"MUJOCO_GL": "egl", "SDL_VIDEODRIVER": "dummy"},
    )
    combinations = {f"py{python}_{name}": (python, name) for name, python in _pythons(combinations_file).items()}
    for entry in toml_table(truth, table_files.TRUTH)["truth"]:
        python, name = combinations[entry["cell"]]
        yield _row(entry, python, combinations_file["axes"]["what"][name]), table


def _pythons(matrix: Mapping[str, Any]) -> dict[str, str]:
    """Return the Python of each combination: that of the axis, or the one on which it is met."""
    (usual,) = matrix["axes"]["python"]
    others = {one["axes"]["what"]: one["axes"]["python"] for one in matrix["include"]}
    return {name: others.get(name, usual) for name in matrix["axes"]["what"]}


def _row(truth: Mapping[str, Any], python: str, value: Mapping[str, Any]) -> Row:
    phase = Phase(truth["phase"])
    return Row(
        label=truth["cell"],
        python=python,
        requirements=tuple(value["requirements"]),
        cases=tuple(
            RowCase(
                env=case.get("env"),
                api=case.get("api") or case.get("env", "import").partition(":")[0],
                first_failure=phase,
                decisive=truth["line"],
            )
            for case in value["cases"]
        ),
        installed={},
        environment=value.get("environment", {}),
        # All of them say the same cause, the first one best.
        causes=tuple(truth["named"][:1]),
    )
