"""Gather the texts of the failures of a cell: the lines that say why, and beside them logs and replies."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from harness.judging.counted_phases import find_observation
from harness.matrix.signatures import Sighting
from harness.model import FAILING, CellRecord, Phase, PhaseRecord, Step
from harness.model.words import in_words
from harness.probes.wire import plain_records
from harness.standalone.failures.matching import Evidence

KILLED = re.compile(r"\bkilled by (SIG[A-Z]+)")

WRITTEN = frozenset({"traceback", "stacks"})
"""Keys of a reply under which a cell's own words stand."""

SUITE_STEPS = {f"{Phase.SUITE}.{step}": step for step in (Phase.RESOLVE, Phase.INSTALL)}
"""Checks of a suite that could not be run, with the step that failed."""

Logs = Callable[[str], Mapping[str, str]]
"""From a path as records or documents hold it to the texts that are kept there, by their names."""


def failures(record: CellRecord, cases: Iterable[Sequence[PhaseRecord]], logs: Logs) -> Iterator[Evidence]:
    """Yield the evidence of each phase that failed, in every case; `cases` are their phases as they count."""
    for step in (record.resolve, record.install):
        if step and step.outcome in FAILING:
            yield _of_step(step, logs)
    phases = [phase for case in cases for phase in case]
    for phase in (*phases, *([record.suite] if record.suite else [])):
        if phase.outcome in FAILING:
            yield _of_phase(phase, logs)


def suite_failures(suite: PhaseRecord, logs: Logs) -> Iterator[Evidence]:
    """Yield the evidence of the steps by which the environment of a suite could not be made."""
    texts = logs(suite.evidence) if suite.evidence else {}
    for check in suite.checks:
        if check.check in SUITE_STEPS:
            yield build_evidence(SUITE_STEPS[check.check], [check.decisive], texts.values())


def _of_step(step: Step, logs: Logs) -> Evidence:
    finding_texts = [found.text for found in step.findings]
    return build_evidence(step.phase, [step.decisive], [*finding_texts, *(logs(step.log) if step.log else {}).values()])


def _of_phase(phase: PhaseRecord, logs: Logs) -> Evidence:
    failed = [check for check in phase.checks if check.outcome in FAILING]
    reasons = [phase.decisive, *(line for check in failed for line in (check.decisive, check.masked_by))]
    finding_texts = [found.text for found in phase.findings]
    log_texts = extract_texts(logs(phase.evidence) if phase.evidence else {}, phase.phase)
    return build_evidence(phase.phase, reasons, [*finding_texts, *log_texts])._replace(
        observed=tuple(_sightings(phase, reasons))
    )


def build_evidence(phase: Phase, reasons: Iterable[str | None], logs: Iterable[str]) -> Evidence:
    """Return the evidence of a phase: the lines that say why, each once, all else, and the signal that killed."""
    lines = tuple(dict.fromkeys(line for line in reasons if line))
    killed = next((hit[1] for line in lines if (hit := KILLED.search(line))), None)
    return Evidence(phase=phase, reasons=lines, logs=tuple(logs), signal=killed)


def _sightings(phase: PhaseRecord, reasons: Iterable[str | None]) -> Iterator[Sighting]:
    """Yield the cell's observations of a phase: those behind the lines that say why, then those of its findings."""
    for line in dict.fromkeys(reasons):
        seen = find_observation(phase, line)
        if line and seen:
            yield Sighting(observed=seen, line=line, is_reason=True)
    for finding in phase.findings:
        if finding.observed:
            yield Sighting(observed=finding.observed, line=finding.text, is_reason=False)


# --- what a probe left -----------------------------------------------------------------------------------------


def extract_texts(texts: Mapping[str, str], phase: Phase) -> Iterator[str]:
    """Yield the texts that a probe left: all of its logs, and from its replies those about failures of this phase."""
    for name, text in texts.items():
        is_reply = name.endswith(".jsonl")
        yield from [] if is_reply else [text]
        for entry in plain_records(text) if is_reply else ():
            about_phase = str(entry.get("check", phase)).partition(".")[0] == phase  # or it names none
            if entry.get("outcome") != "passed" and about_phase:
                yield from _find_cell_texts(entry)
                # Findings bring their sentences in the record, so only those of checks are made here.
                observed = in_words(entry.get("observed")) if entry.get("kind") == "check" else None
                yield from [observed] if observed else []


def _find_cell_texts(plain: Any) -> Iterator[str]:
    if isinstance(plain, dict):
        for key, value in plain.items():
            if key in WRITTEN and isinstance(value, str):
                yield value
            else:
                yield from _find_cell_texts(value)
    elif isinstance(plain, list):
        for value in plain:
            yield from _find_cell_texts(value)
