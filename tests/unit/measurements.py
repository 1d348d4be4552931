"""All that was measured and is committed, in one form: reports, combinations measured by hand, certificates, judges."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
from packaging.utils import canonicalize_name

from harness.judging import known_failures
from harness.model import Outcome, Phase, Verdict
from harness.model.report_types import CaseEntry, CellEntry
from harness.model.vocabulary import parsed_requirement, required_name
from harness.packages import locks
from harness.reports import document
from harness.running.signatures import shipped_signatures
from harness.standalone.failures.counting import select_counting, stated_in
from harness.standalone.failures.matching import Around, Evidence, diagnose

ROOT = Path(__file__).parents[2]
WELL = frozenset({Outcome.PASSED, Outcome.SKIPPED})


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One case of one combination. `versions` are those that were installed, else those asked for.

    `question` are the lines that were asked for, `group` makes those comparable that differ in one package. `causes`
    are the known failures that count, deepest first. `works` is whether all of it passed, `passed` whether at least the
    failure that was looked for did not occur. `reason` is that of the expectation.
    """

    source: str
    group: tuple[str, ...]
    question: tuple[str, ...]
    versions: Mapping[str, str] = field(hash=False)
    python: str | None
    causes: tuple[str, ...]
    works: bool
    passed: bool
    reason: str = ""

    def beside(self, name: str) -> tuple[str, ...]:
        """Return the key that two measurements share if they differ only in this package."""
        return (*self.group, *(line for line in self.question if required_name(line) != name))


@cache
def everything() -> tuple[Measurement, ...]:
    """Return all measurements."""
    return (*of_reports(), *of_hand(), *of_certificates(), *of_judges())


# --- reports ---------------------------------------------------------------------------------------------------


def of_reports() -> Iterator[Measurement]:
    """Yield the cases of all committed cells."""
    for path in sorted((ROOT / "reports").glob("*/report.json")):
        report = document.read(path.read_bytes(), str(path))
        for cell in report.cells:
            if cell.verdict not in {Verdict.UNAVAILABLE, Verdict.NOT_RUN, Verdict.INCONCLUSIVE}:
                yield from (_of_case(path.parent, cell, case) for case in cell.cases)


def _of_case(folder: Path, cell: CellEntry, case: CaseEntry) -> Measurement:
    early = any(cell.phases.get(phase) not in WELL for phase in (Phase.RESOLVE, Phase.INSTALL))
    ended = {outcome for phase, outcome in case.phases.items() if phase is not Phase.BEHAVE}
    works = not early and Outcome.PASSED in ended and ended <= WELL
    lines = _lines(case)
    others = {line for other in cell.cases if other.case != case.case for line in _lines(other)}
    mine = [one for one in cell.diagnoses if one.seen in lines]
    mine = mine or [one for one in cell.diagnoses if one.seen not in others]
    counted = known_failures.select_counting(msgspec.structs.replace(cell, diagnoses=tuple(mine)))
    causes = tuple(one.signature for one in counted)
    variables = tuple(f"{name}={value}" for name, value in sorted({**cell.environment, **cell.supplied}.items()))
    brought = sorted(map(str, cell.brought or ()))
    bundled = [] if cell.change is None else [json.dumps(cell.change.change, sort_keys=True)]
    return Measurement(
        source=f"{cell.id}: {case.case}",
        group=(case.case, case.api, *variables, *brought, *bundled),
        question=tuple(sorted(cell.requirements)),
        versions=cell.installed or _locked(folder / cell.lock if cell.lock else None) or pins(cell.requirements),
        python=cell.python,
        causes=() if works else causes,
        works=works,
        passed=works,
        reason=cell.expectation.reason if cell.expectation else "",
    )


def _lines(case: CaseEntry) -> set[str | None]:
    """Return the lines that say why a case ended as it did."""
    return {case.decisive, *case.reasons.values(), *case.masked.values()}


def _locked(path: Path | None) -> dict[str, str]:
    if path is None or not path.is_file():
        return {}
    return {name: version for name, (version, _) in locks.read_pins(path.read_text(encoding="utf-8")).items()}


def pins(lines: tuple[str, ...]) -> dict[str, str]:
    """Return the packages of which lines ask for one version."""
    versions = {}
    for line in lines:
        exact = [each.version for each in parsed_requirement(line).specifier if each.operator == "=="]
        if len(exact) == 1 and "*" not in exact[0]:
            versions[str(canonicalize_name(parsed_requirement(line).name))] = exact[0]
    return versions


# --- by hand ---------------------------------------------------------------------------------------------------


def of_hand() -> Iterator[Measurement]:
    """Yield the cases of `tests/real/measured.toml`, which were measured without the harness."""
    signatures = shipped_signatures.load_all()
    text = (ROOT / "tests" / "real" / "measured.toml").read_text(encoding="utf-8")
    for number, combination in enumerate(tomllib.loads(text)["combination"], start=1):
        lines = tuple(sorted(combination["requirements"]))
        versions = {**pins(lines), **combination.get("installed", {})}
        for case in combination["cases"]:
            works = case["first_failure"] == "none"
            around = Around(
                requirements=tuple(f"{name}=={it}" for name, it in versions.items()), python=combination["python"]
            )
            seen = Evidence(phase=None if works else Phase(case["first_failure"]), reasons=(case.get("decisive", ""),))
            diagnoses = () if works else diagnose(signatures, [seen], around)
            yield Measurement(
                source=f"measured.toml, combination {number}: {case['env']}",
                group=(case["env"].replace(":", "-").replace("/", "-"), case["api"]),
                question=lines,
                versions=versions,
                python=combination["python"],
                causes=tuple(str(each.signature.id) for each in select_counting(diagnoses, stated_in(seen.reasons))),
                works=works,
                passed=works,
            )


# --- certificates ----------------------------------------------------------------------------------------------


def of_certificates() -> Iterator[Measurement]:
    """Yield the runs of all certificates along the releases of a package."""
    for path in sorted((ROOT / "benchmarks" / "certificates").glob("*/bisect.json")):
        certificate = json.loads(path.read_text(encoding="utf-8"))
        if not certificate["axis"].startswith("--"):
            yield from _of_certificate(path, certificate)


def _of_certificate(path: Path, certificate: Mapping[str, Any]) -> Iterator[Measurement]:
    beside = {**_locked(path.parent / "bad.lock.txt"), **_locked(path.parent / "good.lock.txt")}
    for run in certificate["runs"]:
        if run["verdict"] not in {"unresolvable", "uninstallable"}:
            yield Measurement(
                source=f"{path.parent.name}, run {run['number']}",
                group=(path.parent.name,),
                question=(),
                versions={**beside, certificate["axis"]: run["candidate"]},
                python=run["python"],
                causes=tuple(run["causes"]),
                works=run["why"] == "whole" and run["verdict"] == "works",
                passed=run["answer"] == "good",
            )


# --- judges ----------------------------------------------------------------------------------------------------


def of_judges() -> Iterator[Measurement]:
    """Yield the failing combinations of `benchmarks/judged.toml`, with the causes that were read from their logs."""
    truths = tomllib.loads((ROOT / "benchmarks" / "judged-truth.toml").read_text(encoding="utf-8"))["truth"]
    combinations = tomllib.loads((ROOT / "benchmarks" / "judged.toml").read_text(encoding="utf-8"))["axes"]["what"]
    for truth in truths:
        python, _, name = truth["cell"].partition("_")
        combination = combinations.get(name) or combinations.get(f"{name}-{python}")
        if combination and truth["named"]:
            lines = tuple(sorted(combination["requirements"]))
            yield Measurement(
                source=f"judged-truth.toml: {truth['cell']}",
                group=tuple(case.get("env", "") for case in combination["cases"]),
                question=lines,
                versions=pins(lines),
                python=python.removeprefix("py"),
                causes=tuple(truth["named"]),
                works=False,
                passed=False,
            )
