"""`simmatrix try REQUIREMENT...`: one combination, answered in one line."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterable, Sequence

from harness import (
    changes,
    document,
    knowledge,
    machine,
    repairs,
    scheduler,
    store,
    tables,
    verdict,
)
from harness.commands import combination, progress, reporting
from harness.commands.run import VERIFYING
from harness.evidence import diagnosed
from harness.model import CaseRecord, CellRecord, Outcome, Phase, Verdict
from harness.reporttypes import UNTOLD, word
from harness.signatures import Diagnosis, Signature
from harness.verdict import Judgement

HELP = "Try one combination of requirements: lock, install, and run environments in it."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `try`."""
    combination.add_arguments(parser)
    parser.add_argument("--fresh", action="store_true", help="resolve and measure again")
    parser.add_argument("--offline", action="store_true", help="use what is in the caches, never the network")
    parser.add_argument("--verify", action="store_true", help=VERIFYING)
    parser.add_argument("--json", action="store_true", help="print the report document, and nothing else, on stdout")


def main(args: argparse.Namespace) -> int:
    """Try it; 0 only for `works`, 1 where it does not, 3 where it cannot be told here."""
    given = combination.read(args)
    opened = store.open_store()
    settings = scheduler.Settings(fresh=args.fresh, offline=args.offline, verify=args.verify)
    with progress.Progress(1, 1, reporting.headline) as board:
        planned = combination.planned(args, given, opened, scheduler.Runner(opened, settings, board))
        (record,) = scheduler.run(planned.cells, opened, settings, board)
    judged = verdict.judge(record)
    if args.json:
        here = machine.facts()
        locate = reporting.seen_from_here(opened.folder)
        facts = {here.id: here.facts}
        used, causes = reporting.probes(planned), knowledge.beside(opened.folder)
        made = document.build([record], [planned], facts, store.now(), locate, used, known=causes)
        sys.stdout.write(document.encode(made).decode())
    else:
        print(answer(record, judged, diagnosed(record, judged, knowledge.beside(opened.folder))))
    return 0 if judged.verdict is Verdict.WORKS else 3 if judged.verdict in UNTOLD else 1


# --- the answer ------------------------------------------------------------------------------------------------


def answer(record: CellRecord, judged: Judgement, found: Sequence[Diagnosis] = ()) -> str:
    """One line for what works; for what does not, the line that says why and the next command to type.

    `found` are the known failures that fit, the deepest cause first.
    """
    if judged.verdict is Verdict.UNAVAILABLE:
        return f"unavailable: {judged.decisive}"
    told = f"{word(judged.verdict)}: {_tried(record, judged)}"
    if judged.verdict is Verdict.WORKS:
        return told
    why = (judged.decisive or "no line says why", *(line for one in found[:1] for line in _known(one.signature)))
    return "\n".join((told, *why, f"next: simmatrix show {shlex.quote(record.cell.id)}"))


def _known(failure: Signature) -> Iterable[str]:
    """Cause and remedy of a known failure, and where more is said; a mask is none, and what it hides is not known."""
    yield f"{'hides why' if failure.masks else 'cause'}: {failure.cause}"
    yield f"remedy: {changes.in_words(failure.remedy.plain)}"
    yield from (f"see: {reference}" for reference in failure.references[:1])


def _tried(record: CellRecord, judged: Judgement) -> str:
    """What was really tried, and of what: never more than that."""
    passed = {case.case: tuple(p.phase for p in case.phases if p.outcome is Outcome.PASSED) for case in record.cases}
    parts = []
    for phases in dict.fromkeys(names for names in passed.values() if names):
        shown = [_name(case) for case in record.cases if passed[case.case] == phases]
        parts.append(f"{', '.join(phases)} of {' and '.join(shown)}")
    if judged.phase and judged.verdict is not Verdict.WORKS:
        failed = [_name(case) for case in record.cases if _ended(case, judged.phase) is judged.phases[judged.phase]]
        ended = judged.phases[judged.phase]
        told = "could not be told" if ended is Outcome.INFRA else word(ended)
        parts.append(f"{judged.phase} {told}" + (f" of {' and '.join(failed)}" if failed else ""))
    where = f" on Python {record.python}" if record.python else ""
    tried = "; ".join(parts or ["nothing was tried"]) + where
    mended = [f"repaired: {repairs.described(one)}" for one in record.repairs]
    drawn = any(phase.phase is Phase.RENDER and phase.frames for case in record.cases for phase in case.phases)
    needed = tables.settings(record.supplied, record.installed or {}) if drawn else ()
    settings = [f"drawn with {', '.join(needed)}, which a user sets, too"] if needed else []
    return "; ".join(
        [
            tried,
            *settings,
            *mended,
            *(f"{name} not verified: {_why(record, Phase(name))}" for name in judged.unverified),
        ]
    )


def _name(case: CaseRecord) -> str:
    return case.env or case.case.removeprefix("import-")


def _ended(case: CaseRecord, phase: Phase) -> Outcome | None:
    return next((record.outcome for record in case.phases if record.phase is phase), None)


def _why(record: CellRecord, phase: Phase) -> str:
    told = (p.decisive for case in record.cases for p in case.phases if p.phase is phase and p.decisive)
    return next(told, "it was not reached")
