"""Write the answer of `try`: which packages were run, which phases passed, and what to type next."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence

from harness.judging.assess import Assessed
from harness.judging.counted_phases import reason
from harness.judging.exercised import ONLY_IMPORT, OWN, exercised_packages, idle, import_fact, missing_arguments
from harness.matrix import overlay_recipes
from harness.matrix.signatures import Signature
from harness.model import CaseRecord, CellRecord, Outcome, Phase, Verdict
from harness.model.report_types import first_few, word
from harness.model.vocabulary import FAMILY, SELF, required_name
from harness.reports.tables import tables
from harness.standalone.failures.remedies import in_words
from harness.standalone.failures.silent import silent_ids

MOST_NAMES = 8
MOST_IDS = 3


def answer(judged: Assessed) -> str:
    """Return one line if it works; else also the line that says why not, and the next command to type.

    The first words name the packages that were run.
    """
    record = judged.record
    if judged.verdict is Verdict.UNAVAILABLE:
        return f"unavailable: {judged.decisive}"
    if judged.verdict is Verdict.NOT_RUN and record.installed is not None:
        return "\n".join(_not_run(judged))
    names = _versions(record, _select_packages(judged)) if record.installed is not None else ""
    line = f"{word(judged.verdict)}: {f'{names}: ' if names else ''}{_describe_phases(judged)}"
    if judged.verdict is Verdict.WORKS:
        return line
    cause_lines = (line for one in judged.diagnoses[:1] for line in _describe_failure(one.signature))
    why = (judged.decisive or "no line of the output explains it", *cause_lines)
    missed = idle(record)
    other = (f"of {' and '.join(missed)} nothing was run",) if missed else ()
    return "\n".join((line, *why, *other, f"next: simmatrix show {shlex.quote(record.cell.id)}"))


# --- what was not run ------------------------------------------------------------------------------------------


def _not_run(judged: Assessed) -> Iterable[str]:
    record = judged.record
    missed = idle(record)
    if missed:
        ran = [name for name in record.cell.asked if name not in missed]
        also = f"; {_versions(record, ran)}: " if ran else "; "
        yield f"not run: {judged.decisive}{also}{_describe_phases(judged)}"
        yield f"next: {_write_command(record, missed)}"
        return
    where = f" on Python {record.python}" if record.python else ""
    tested = f": {judged.decisive}" if judged.decisive and judged.decisive != ONLY_IMPORT else ""
    names = _versions(record, _select_packages(judged)) or "nothing"
    yield f"not run: {names} was only imported{where}{tested}; no environment was run"
    if missing_arguments(record):
        yield f"next: {OWN}"
        return
    offers: dict[str, list[str]] = {}
    for case in record.cases:
        for library, ids in dict(import_fact(case, "registers") or {}).items():
            offers.setdefault(str(library), []).extend(map(str, ids))
    if not offers:
        yield f"no environment of it is registered with {' or '.join(FAMILY)}"
        yield f"next: name one with --env ID, or its API with --api; {OWN}"
        return
    for library, ids in offers.items():
        yield f"it registers with {library}: {first_few(ids, MOST_IDS)}"
    library, ids = next(iter(offers.items()))
    needed = () if library in (record.installed or {}) else (library,)
    yield f"next: {_write_command(record, needed, ids[0], all_of_it=True)}"


def _write_command(record: CellRecord, names: Sequence[str], env: str | None = None, *, all_of_it: bool = False) -> str:
    """Return the command that tries these packages, alone or with everything that was asked for."""
    requirements = record.cell.question.requirements
    texts = [text for text in requirements if all_of_it or required_name(text) in names]
    words = ["simmatrix", "try", *texts, *(name for name in names if name not in map(required_name, texts))]
    return shlex.join([*words, "--python", record.cell.python, *(["--env", env] if env else [])])


# --- what was run ----------------------------------------------------------------------------------------------


def _select_packages(judged: Assessed) -> list[str]:
    """Return the packages for the first words: those asked for that were run; all of them if nothing was run."""
    record = judged.record
    names = list(record.cell.asked) or list(dict.fromkeys(map(required_name, record.cell.question.requirements)))
    ran = exercised_packages(record)
    return [name for name in names if name in ran] if ran and judged.verdict is not Verdict.NOT_RUN else names


def _versions(record: CellRecord, names: Sequence[str]) -> str:
    installed = record.installed or {}
    parts = [f"{name} {installed[name]}" if name in installed else name for name in names[:MOST_NAMES] if name != SELF]
    return ", ".join(parts) + (f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else "")


def _describe_failure(failure: Signature) -> Iterable[str]:
    """Yield cause, remedy and a reference of a known failure; a mask is shown as hiding the cause."""
    yield f"{'hides why' if failure.masks else 'cause'}: {failure.cause}"
    yield f"remedy: {in_words(failure.remedy.plain)}"
    yield from (f"see: {reference}" for reference in failure.references[:1])


def _describe_phases(judged: Assessed) -> str:
    """Name the phases that passed, never more than these, and their tasks; then the failed phase, and notes."""
    record = judged.record
    passed = {case.case: tuple(p.phase for p in case.phases if p.outcome is Outcome.PASSED) for case in record.cases}
    parts = []
    for phases in dict.fromkeys(names for names in passed.values() if names):
        shown = [_name(case) for case in record.cases if passed[case.case] == phases]
        parts.append(f"{', '.join(phases)} of {' and '.join(shown)}")
    if judged.verdict is Verdict.MISLEADS:
        wrong = [case for case in judged.cases if case.misleads]
        shown = [f"{' and '.join(case.misleads)} of {_name(case.record)}" for case in wrong]
        parts.append(f"not as specified: {', '.join(shown)}")
    elif judged.phase and judged.verdict is not Verdict.WORKS:
        ended = judged.phases[judged.phase]
        ends = ((case, phase) for case in record.cases for phase in case.phases)
        failed = [_name(case) for case, one in ends if (one.phase, one.outcome) == (judged.phase, ended)]
        outcome = "could not be told" if ended is Outcome.INFRA else word(ended)
        parts.append(f"{judged.phase} {outcome}" + (f" of {' and '.join(failed)}" if failed else ""))
    where = f" on Python {record.python}" if record.python else ""
    tried = "; ".join(parts or ["nothing was tried"]) + where
    mended = [f"repaired: {overlay_recipes.describe_edits(one)}" for one in record.repairs]
    drawn = any(phase.phase is Phase.RENDER and phase.frames for case in record.cases for phase in case.phases)
    needed = tables.settings(record.supplied, record.installed or {}) if drawn else ()
    settings = [f"drawn with {', '.join(needed)} (set this in your shell as well)"] if needed else []
    reasons = {p.phase: p.decisive for case in reversed(record.cases) for p in reversed(case.phases) if p.decisive}
    open_ends = [Phase(name) for name in judged.unverified if name in {*Phase}]
    unverified = (f"{phase} not verified: {reasons.get(phase, 'it was not reached')}" for phase in open_ends)
    notes = [*_registered_by(record), *_undrawn(record), *_skipped(record)]
    doubts = (f"a known issue without an error is not excluded: {name}" for name in silent_ids(judged.unverified))
    return "; ".join([tried, *notes, *settings, *mended, *unverified, *doubts])


def _registered_by(record: CellRecord) -> Iterable[str]:
    """Yield the import that was needed to register an environment."""
    modules = (import_fact(case, "registered_by") for case in record.cases)
    for name in filter(None, dict.fromkeys(modules)):
        module, _, function = str(name).partition(":")
        yield f"registered by `{f'{module}.{function}()' if function else f'import {module}'}`"


def _undrawn(record: CellRecord) -> Iterable[str]:
    """Yield a note if environments were run and no check that renders was asked for."""
    checks = [check for case in record.cell.cases if case.env for check in case.checks]
    if checks and not any(check.startswith(f"{Phase.RENDER}.") for check in checks):
        yield "render was not tried, since nothing that draws was asked for"


def _skipped(record: CellRecord) -> Iterable[str]:
    """Yield each phase that does not apply to an environment, with the reason."""
    phases = (phase for case in record.cases for phase in case.phases if phase.outcome is Outcome.SKIPPED)
    reasons = {phase.phase: reason(phase) for phase in phases if phase.phase in {Phase.VECTOR, Phase.RENDER}}
    yield from (f"{name} does not apply: {why}" for name, why in reasons.items() if why)


def _name(case: CaseRecord) -> str:
    return case.env or case.case.removeprefix("import-")
