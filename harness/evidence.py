"""What was written of the failures of a cell, and the known ones among them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from harness import misleading, signatures, verdict
from harness.hostile_data import json_object
from harness.model import FAILING, CaseRecord, CellRecord, CheckRecord, Phase, PhaseRecord, Step, Verdict
from harness.reporttypes import UNTOLD
from harness.signatures import Around, Diagnosis, Evidence, Signature, diagnose
from harness.standalone import silent

KILLED = re.compile(r"\bkilled by (SIG[A-Z]+)")
DRAWN = ("api", "vendor", "renderer", "version", "device")
LONGEST_TEXT = 300

WRITTEN = frozenset({"traceback", "stacks", "reason"})
"""Keys of a reply under which a cell's own words stand."""

SUITE_STEPS = {f"{Phase.SUITE}.{step}": step for step in (Phase.RESOLVE, Phase.INSTALL)}
"""Checks of a suite that could not be run, with the step that failed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Knowledge:
    """What failures are compared with, read where there are any.

    `silent` are the signatures of silent issues, for results that failed in nothing; all are looked through where it is
    None. `logs` gives the texts, none of them long, that are kept at a path as records hold it, by their names;
    `locked` the lines `name==version` of a lock.
    """

    signatures: Callable[[], tuple[Signature, ...]] = tuple
    logs: Callable[[str], Mapping[str, str]] = lambda _: {}
    locked: Callable[[str], tuple[str, ...]] = lambda _: ()
    silent: Callable[[], tuple[Signature, ...]] | None = None


NOTHING_KNOWN = Knowledge()


def diagnosed(record: CellRecord, judged: verdict.Judgement, known: Knowledge) -> tuple[Diagnosis, ...]:
    """Return the known failures that fit a red cell: what a misleading check has shown, then the deepest cause."""
    if judged.verdict in UNTOLD or judged.verdict is Verdict.WORKS:
        return ()
    told = _lines(record) if judged.verdict is Verdict.MISLEADS else {}
    shown = shown_silent(lurking(record, known), [exercised(record, case) for case in record.cases], told)
    return together(shown, diagnose(known.signatures(), tuple(failures(record, known.logs)), _around(record, known)))


def suite_diagnosed(record: CellRecord, known: Knowledge) -> tuple[Diagnosis, ...]:
    """Return the known failures that keep the environment of the suite from being made, the deepest cause first."""
    suite = verdict.suite_phase(record)
    if suite is None or not verdict.suite_not_run(suite):
        return ()
    steps = [check for check in suite.checks if check.check in SUITE_STEPS]
    logs = known.logs(suite.evidence) if suite.evidence else {}
    found = [gathered(SUITE_STEPS[step.check], [step.decisive], logs.values()) for step in steps]
    return diagnose(known.signatures(), found, _around(record, known))


def _around(record: CellRecord, known: Knowledge) -> Around:
    locked = known.locked(record.lock) if record.lock and record.installed is None else ()
    return Around(
        installed=record.installed,
        requirements=(*record.cell.question.requirements, *record.cell.question.constraints, *locked),
        python=record.python or record.cell.python,
    )


def together(shown: tuple[Diagnosis, ...], told: Iterable[Diagnosis]) -> tuple[Diagnosis, ...]:
    """Return what misleading checks have shown, and then what failures tell, each known failure once."""
    ids = {one.signature.id for one in shown}
    return (*shown, *(one for one in told if one.signature.id not in ids))


def _lines(record: CellRecord) -> dict[str, str | None]:
    """Return the misleading checks that failed, each with its line in the first case."""
    phases = [phase for case in record.cases for phase in verdict.case_phases(record, case)]
    shown = [check for phase in phases for check in misleading.shown(phase.checks)]
    return {check.check: check.decisive for check in reversed(shown)}


# --- silent issues ---------------------------------------------------------------------------------------------


def looked_up(record: CellRecord, judged: verdict.Judgement, known: Knowledge) -> verdict.Judgement:
    """Return a judgement with the silent issues that fit a case of the cell and are neither shown nor refuted."""
    lurks = lurking(record, known)
    names = (name for case in record.cases for name in silent.open_issues(lurks, exercised(record, case)))
    return replace(judged, unverified=tuple(dict.fromkeys((*judged.unverified, *names))))


def lurking(record: CellRecord, known: Knowledge) -> tuple[Signature, ...]:
    """Return the silent issues whose packages a cell has."""
    if record.installed is None:
        return ()
    around = Around(installed=record.installed, python=record.python or record.cell.python)
    return signatures.lurking((known.silent or known.signatures)(), around)


def exercised(record: CellRecord, case: CaseRecord) -> silent.Exercised:
    """Return a case of a record as silent issues see it."""
    phases = verdict.case_phases(record, case)
    return silent.Exercised(
        env=case.env,
        api=case.api,
        phases={phase.phase: phase.outcome for phase in phases},
        checks={check.check: check.outcome for phase in phases for check in phase.checks},
        opengl=any(drawn_by(check) for phase in phases for check in phase.checks),
    )


def drawn_by(check: CheckRecord) -> dict[str, str]:
    """Return what a check says of the OpenGL context that drew for it; a cell may have written anything there."""
    told = check.facts.get("gl")
    return {name: str(told[name])[:LONGEST_TEXT] for name in DRAWN if name in told} if isinstance(told, dict) else {}


def shown_silent(
    lurks: Iterable[Signature], cases: Iterable[silent.Exercised], told: Mapping[str, str | None]
) -> tuple[Diagnosis, ...]:
    """Return the silent issues that misleading checks have shown in cases; `told` are those that failed, with lines."""
    found = {one.id: one for case in cases for one in silent.shown_issues(lurks, case, told)}
    return tuple(
        Diagnosis(signature=one, phase=Phase(one.check.partition(".")[0]), seen=told[one.check] or "", told=True)
        for one in found.values()
    )


def causes(found: Mapping[str, bool]) -> tuple[str, ...]:
    """Of the known failures that fit, by id whether they mask others, those that count: masks only among themselves."""
    return tuple(name for name, masks in found.items() if not masks) or tuple(found)


def names(found: Sequence[Diagnosis]) -> tuple[str, ...]:
    """Return the ids by which an expectation may name the known failures that count, former ones among them."""
    counting = causes({str(one.signature.id): one.signature.masks for one in found})
    former = (old for one in found if one.signature.id in counting for old in one.signature.formerly)
    return (*counting, *map(str, former))


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
        entry = json_object(line)
        if entry and entry.get("outcome") != "passed" and _about(entry, phase):
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
