"""What was written of the failures of a cell, and the known ones among them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from harness import verdict
from harness.model import FAILING, CellRecord, Phase, PhaseRecord, Step, Verdict
from harness.reporttypes import UNTOLD
from harness.signatures import Around, Diagnosis, Evidence, Signature, diagnose

KILLED = re.compile(r"\bkilled by (SIG[A-Z]+)")
WRITTEN = frozenset({"traceback", "stacks", "reason"})
"""Keys of a reply under which a cell's own words stand."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Knowledge:
    """What failures are compared with, read where there are any.

    `logs` gives the texts, none of them long, that are kept at a path as records hold it, by their names.
    """

    signatures: Callable[[], tuple[Signature, ...]] = tuple
    logs: Callable[[str], Mapping[str, str]] = lambda _: {}


NOTHING_KNOWN = Knowledge()


def diagnosed(record: CellRecord, judged: verdict.Judgement, known: Knowledge) -> tuple[Diagnosis, ...]:
    """The known failures that fit a red cell, the deepest cause first."""
    if judged.verdict in UNTOLD or judged.verdict is Verdict.WORKS:
        return ()
    around = Around(
        installed=record.installed,
        requirements=(*record.cell.question.requirements, *record.cell.question.constraints),
        python=record.python or record.cell.python,
    )
    return diagnose(known.signatures(), tuple(failures(record, known.logs)), around)


def causes(found: Mapping[str, bool]) -> tuple[str, ...]:
    """Of the known failures that fit, by id whether they mask others, those that count: masks only among themselves."""
    return tuple(name for name, masks in found.items() if not masks) or tuple(found)


def failures(record: CellRecord, logs: Callable[[str], Mapping[str, str]]) -> Iterator[Evidence]:
    """The evidence of each phase that failed, in every case."""
    for step in (record.resolve, record.install):
        if step and step.outcome in FAILING:
            yield _of_step(step, logs)
    cases = [phase for case in record.cases for phase in verdict.case_phases(record, case)]
    for phase in (*cases, *([record.suite] if record.suite else [])):
        if phase.outcome in FAILING:
            yield _of_phase(phase, logs)


def _of_step(step: Step, logs: Callable[[str], Mapping[str, str]]) -> Evidence:
    said = [found.text for found in step.findings]
    return gathered(step.phase, [step.decisive], [*said, *(logs(step.log) if step.log else {}).values()])


def _of_phase(phase: PhaseRecord, logs: Callable[[str], Mapping[str, str]]) -> Evidence:
    failed = [check for check in phase.checks if check.outcome in FAILING]
    told = [phase.decisive, *(line for check in failed for line in (check.decisive, check.masked_by))]
    said = [found.text for found in phase.findings]
    return gathered(phase.phase, told, [*said, *written(logs(phase.evidence) if phase.evidence else {}, phase.phase)])


def gathered(phase: Phase, told: Iterable[str | None], logs: Iterable[str]) -> Evidence:
    """Evidence of a phase: the lines that say why, each once, all else that was written, and the signal that killed."""
    lines = tuple(dict.fromkeys(line for line in told if line))
    killed = next((found[1] for line in lines if (found := KILLED.search(line))), None)
    return Evidence(phase=phase, told=lines, logs=tuple(logs), signal=killed)


# --- what a probe left -----------------------------------------------------------------------------------------


def written(kept: Mapping[str, str], phase: Phase) -> Iterator[str]:
    """The words of what a probe left, by file: of logs all, of replies those on what failed in this phase."""
    for name, text in kept.items():
        yield from _texts(name, text, phase)


def _texts(name: str, text: str, phase: Phase) -> Iterator[str]:
    """The words of a log; of the records of a reply those on what failed in this phase."""
    if not name.endswith(".jsonl"):
        yield text
        return
    for line in text.splitlines():
        try:
            entry = json.loads(line)
        except ValueError:  # it was cut
            continue
        if isinstance(entry, dict) and entry.get("outcome") != "passed" and _about(entry, phase):
            yield from _words(entry)


def _about(entry: Mapping[str, Any], phase: Phase) -> bool:
    """Whether a record is of this phase, or says of none."""
    return str(entry.get("check", phase)).partition(".")[0] == phase


def _words(plain: Any) -> Iterator[str]:
    if isinstance(plain, dict):
        for key, value in plain.items():
            if key in WRITTEN and isinstance(value, str):
                yield value
            else:
                yield from _words(value)
    elif isinstance(plain, list):
        for value in plain:
            yield from _words(value)
