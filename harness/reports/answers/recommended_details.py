"""Write everything that `recommend --all` adds to its short answer: all combinations, all traps, with their cells."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from typing import Any

from harness.model import CASE_PHASES
from harness.model.report_types import format_count
from harness.reports.answers import recommended_text as text
from harness.reports.answers.recommended import Partly, Recommended
from harness.reports.answers.recommending import Combination
from harness.reports.answers.traps import Red
from harness.reports.install_texts import install_commands


def lines(answer: Recommended, machines: Mapping[str, Any], width: int, tool: str) -> list[str]:
    """Return the whole answer, after the short one, as wrapped lines."""
    paragraphs = [*_combinations(answer, machines, tool), *_doubtful(answer, tool), *_partly(answer, tool)]
    paragraphs += [*_nearby(answer, tool), *_traps(answer), "", "next", *_next(answer)]
    return [row for paragraph in paragraphs for row in text.wrap_line(paragraph, width)]


def _combinations(answer: Recommended, machines: Mapping[str, Any], tool: str) -> Iterator[str]:
    if answer.measured:
        yield ""
        yield "combinations that work"
    for combination in answer.measured:
        yield f"  {install_commands.command(combination, tool)}"
        yield from (f"    {line}" for line in _details(combination, machines))
    if answer.weighed and answer.weighed.behaves:
        yield ""
        yield "behaviour"
    for each in answer.weighed.behaves if answer.weighed else ():
        yield f"  {text.behaviour_words(each)}: {text.unbroken('simmatrix', 'show', each.cell)}"


def _details(combination: Combination, machines: Mapping[str, Any]) -> Iterator[str]:
    passed = ", ".join(phase for phase in CASE_PHASES if combination.phases.get(phase) == "passed")
    yield f"passed {passed} in {', '.join(combination.environments)}"
    if combination.unverified:
        yield f"not verified: {', '.join(combination.unverified)}"
    where = "; ".join(text.machine_words(name, machines) for name in combination.machines)
    yield f"measured {combination.measured[:10]} on Python {', '.join(combination.pythons)}; {where}"
    if combination.repaired:
        patched = ", ".join(combination.repaired)
        yield f"{patched} needs a patched wheel, which no index has: --lock-out FILE writes it, too"
    if combination.brought:
        yield f"needs {', '.join(combination.brought)}, which no index has"
    if combination.builds:
        yield f"builds of another index: {text.versions_words(combination.builds)}"
    yield f"lock {format_count(combination.lock.count('=='), 'package')}, sha256 {combination.lock_sha256[:16]}"
    yield from (f"{name} {' or '.join(held)}" for name, held in combination.beside.items())
    yield from (f"simmatrix show {cell}" for cell in combination.cells)


def _doubtful(answer: Recommended, tool: str) -> Iterator[str]:
    if answer.doubtful:
        yield ""
        yield "in doubt"
    for combination in answer.doubtful:
        yield f"  {install_commands.command(combination, tool)}"
        yield from (f"    {line}" for line in text.doubt(combination))


def _partly(answer: Recommended, tool: str) -> Iterator[str]:
    if answer.partly:
        yield ""
        yield "works in part"
    for part in answer.partly:
        yield from (f"  {line}" for line in _part(part, tool))


def _part(part: Partly, tool: str) -> Iterator[str]:
    total = len(part.works) + len(part.fails)
    yield f"{install_commands.command(part.combination, tool)}; {len(part.works)} of {total} tasks work"
    yield f"  works: {', '.join(part.works)}"
    how = "misleads" if part.verdict == "misleads" else "fails"
    yield from (f"  {how}: {name}: {why}" for name, why in part.fails.items())
    yield f"  simmatrix show {part.combination.cell}"


def _nearby(answer: Recommended, tool: str) -> Iterator[str]:
    for guess in answer.inferred:
        yield ""
        yield f"inferred, not measured: {text.versions_words(guess.versions)} on Python {guess.python}"
        yield f"  {guess.why}"
        yield from (f"  simmatrix show {cell}" for cell in guess.from_cells)
    if answer.nearby:
        yield ""
        yield f"{answer.nearby.where}, these work:"
        yield from (f"  {install_commands.command(one, tool)}" for one in answer.nearby.combinations)


def _traps(answer: Recommended) -> Iterator[str]:
    if answer.red:
        yield ""
        yield "traps"
    for trap in answer.red:
        yield from (f"  {line}" for line in _trap(trap, answer))


def _trap(trap: Red, answer: Recommended) -> Iterator[str]:
    yield text.describe_trap(trap)
    if trap.reason:
        yield f"  {trap.reason}{f' ({trap.link})' if trap.link else ''}"
    yield from (f"  do: {do}" for do in [text.advice(trap, answer)] if do)
    yield from (f"  simmatrix known {name}" for name in trap.causes)
    yield from (f"  simmatrix show {cell}" for cell in trap.cells)


def _next(answer: Recommended) -> Iterator[str]:
    if answer.measured:
        words = ["simmatrix", "recommend", *answer.asked]
        words += ["--python", answer.python] if answer.python else []
        words += ["--needs", ",".join(answer.needs)] if answer.needs else []
        words += ["--env", answer.env] if answer.env else []
        yield f"  {shlex.join([*words, '--lock-out', 'requirements.txt'])}"
    elif answer.apart:
        yield f"  {text.try_command(answer.apart.requirements, answer.apart.python, answer.env)}"
    else:
        yield f"  {answer.next}"
