"""Compare the committed reports with combinations measured by hand: `python tests/real/agreement.py`.

`measured.toml` says, for each case, in which phase it fails first (plain uv and Python, no harness). The reports
`typed-*` have the same combinations; the table of agreement is written to `agreement.md`. Exit 1 below 97 of 100, or
for a single `works` that is none. `test_agreement.py` runs a sample of them anew.
"""

from __future__ import annotations

import json
import sys
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.judging.assess import assess
from harness.machine import store
from harness.machine.capacity import default_jobs
from harness.matrix import plan
from harness.model import Cell, CellRecord, Outcome, Phase, replace
from harness.reports.text.markdown_texts import code_cell
from harness.reports.text.progress import Progress, headline
from harness.running import scheduler

HERE = Path(__file__).parent
REPORTS = HERE.parents[1] / "reports"
GOAL = 0.97
PROBED = (Phase.IMPORT, Phase.SINGLE, Phase.VECTOR, Phase.RENDER)
NONE = "none"


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One case of one entry: its first failing phase by hand and by the harness, `none` where all passed."""

    cell: str
    python: str
    requirements: tuple[str, ...]
    env: str
    by_hand: str
    by_harness: str
    fragments: tuple[str, ...]
    decisive: str

    @property
    def agrees(self) -> bool:
        """Return whether the first failing phase is the same."""
        return self.by_hand == self.by_harness

    @property
    def wrong_works(self) -> bool:
        """Return whether the harness says `works` about a case that failed by hand: the worst error."""
        return self.by_harness == NONE and not self.agrees

    @property
    def line_agrees(self) -> bool:
        """Return whether the decisive line holds what was seen by hand: the exception, or the one beneath it."""
        return not self.fragments or any(fragment[:120] in self.decisive for fragment in self.fragments)


def entries() -> list[dict]:
    """Return the combinations that were measured by hand."""
    return tomllib.loads((HERE / "measured.toml").read_text())["combination"]


def cell_of(number: int, entry: dict) -> Cell:
    """Return the cell of an entry."""
    options = plan.TrialOptions(
        requirements=tuple(entry["requirements"]),
        only_binary=tuple(entry.get("only_binary", ())),
        python=entry["python"],
        environment=entry.get("environment", {}),
        envs=tuple(case["env"] for case in entry["cases"]),
        api=entry["cases"][0]["api"],
        as_of=str(entry["snapshot"]),
    )
    (cell,) = plan.single(options).cells
    cases_by_env = {case["env"]: case for case in entry["cases"]}
    cases = tuple(
        replace(
            case,
            imports=tuple(cases_by_env[case.env].get("imports", ())),
            kwargs=cases_by_env[case.env].get("kwargs", {}),
            packages=(),  # by hand nothing was imported but what the entry says
        )
        for case in cell.cases
        if case.env
    )
    return replace(cell, matrix="measured", id=f"measured/{number:02}-{cell.label}"[:150], cases=cases)


def run(cells: Sequence[Cell], opened: store.Store) -> tuple[CellRecord, ...]:
    """Run the cells, except those measured before under the same keys."""
    settings = scheduler.Settings(jobs=default_jobs())
    with Progress(len(cells), settings.jobs, headline) as board:
        return scheduler.run(cells, opened, settings, board)


def compare(entry: dict, record: CellRecord) -> list[Comparison]:
    """Compare each case of an entry with the harness's record."""
    judged = assess(record)
    comparisons = []
    for case in entry["cases"]:
        phase, decisive = first_failure(record, case["env"])
        comparisons.append(
            Comparison(
                cell=record.cell.label,
                python=entry["python"],
                requirements=tuple(entry["requirements"]),
                env=case["env"],
                by_hand=case["first_failure"],
                by_harness=phase if phase != NONE or not judged.untold else judged.verdict.value,
                fragments=tuple(case[key] for key in ("decisive", "cause") if key in case),
                decisive=decisive or "",
            )
        )
    return comparisons


def first_failure(record: CellRecord, env: str) -> tuple[str, str | None]:
    """Return the first phase of a case that did not pass, and its decisive line."""
    for step in (record.resolve, record.install):
        if step and step.outcome is not Outcome.PASSED:
            return step.phase.value, step.decisive
    for case in (case for case in record.cases if case.env == env):
        for phase in case.phases:
            if phase.outcome not in {Outcome.PASSED, Outcome.SKIPPED}:
                return phase.phase.value, phase.decisive
    return NONE, record.unavailable


def reported() -> Iterator[Comparison]:
    """Compare each case that was measured by hand with the report that has its combination.

    A combination that no report has yet is left out. So is a task whose package the script by hand did not import: a
    report imports the package of each task, as its documentation says.
    """
    cells = [cell for file in sorted(REPORTS.glob("typed-*/report.json")) for cell in read_document(file)]
    for entry in entries():
        cell = next((one for one in cells if _is_of(one, entry)), None)
        if cell:
            yield from (_of_report(entry, case, cell) for case in entry["cases"] if not case.get("unimported"))


def read_document(file: Path) -> list[dict]:
    """Return the cells of a report."""
    return json.loads(file.read_bytes())["cells"]


def _is_of(cell: dict, entry: dict) -> bool:
    same = sorted(cell["requirements"]) == sorted(entry["requirements"]) and cell["environment"] == entry.get(
        "environment", {}
    )
    envs = {case["env"] for case in cell["cases"]}
    same &= cell["id"].endswith("-wheels") is bool(entry.get("only_binary"))
    return same and cell["requested_python"] == entry["python"] and envs >= {case["env"] for case in entry["cases"]}


def _of_report(entry: dict, case: dict, cell: dict) -> Comparison:
    phase, decisive = _reported_failure(cell, case["env"])
    return Comparison(
        cell=cell["id"],
        python=entry["python"],
        requirements=tuple(entry["requirements"]),
        env=case["env"],
        by_hand=case["first_failure"],
        by_harness=phase,
        fragments=tuple(case[key] for key in ("decisive", "cause") if key in case),
        decisive=decisive or "",
    )


def _reported_failure(cell: dict, env: str) -> tuple[str, str | None]:
    """Return the first phase of a case that did not pass, and its decisive line."""
    for step in ("resolve", "install"):
        if cell["phases"][step] != "passed":
            return step, cell["decisive"]
    case = next(one for one in cell["cases"] if one["env"] == env)
    first = next((phase for phase in PROBED if case["phases"].get(phase, "passed") not in {"passed", "skipped"}), None)
    return (first.value, case["decisive"]) if first else (NONE, None)


def sum_up(compared: Sequence[Comparison]) -> str:
    """Return the counts as a sentence."""
    agreeing = sum(one.agrees for one in compared)
    red = [one for one in compared if one.by_hand != NONE]
    return (
        f"{agreeing} of {len(compared)} cases agree in their first failing phase ({len(red)} of them fail somewhere); "
        f"{sum(one.wrong_works for one in compared)} say `works` wrongly; "
        f"{sum(one.line_agrees for one in red if one.agrees)} of {sum(one.agrees for one in red)} agreeing failures "
        "have the decisive line that was seen by hand."
    )


def render(compared: Sequence[Comparison], command: str) -> str:
    """Return the table of agreement as Markdown."""
    lines = [
        f"| {'' if one.agrees else '**differs**'} | {one.python} | `{' '.join(one.requirements)}` | {one.env} "
        f"| {one.by_hand} | {one.by_harness} | {_cell(one.decisive)} |"
        for one in compared
    ]
    return "\n".join([
        "# The harness against what was measured by hand",
        "",
        sum_up(compared),
        "",
        f"Made by `{command}` on {store.now()[:10]} from [measured.toml](measured.toml) and the reports `typed-*`.",
        "",
        "| | python | requirements | environment | by hand | harness | decisive line |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *lines,
        "",
    ])  # fmt: skip


def _cell(text: str) -> str:
    return code_cell(text[:160])


def main() -> int:
    """Compare all, and write the table."""
    compared = list(reported())
    text = render(compared, "python tests/real/agreement.py")
    (HERE / "agreement.md").write_text(text)
    print(text)
    return 0 if good(compared) else 1


def good(compared: Sequence[Comparison]) -> bool:
    """Return whether the reports agree often enough, and none says `works` wrongly."""
    agreed = sum(one.agrees for one in compared) / len(compared)
    return agreed >= GOAL and not any(one.wrong_works for one in compared)


if __name__ == "__main__":
    sys.exit(main())
