"""Write the answer of `recommend` in words: what to install, why, at most a few traps, and the next command."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from harness.model import CASE_PHASES
from harness.model.report_types import first_few, format_count, word
from harness.model.schema import suggestion
from harness.reports.answers.never_together import Apart, Half
from harness.reports.answers.recommended import Partly, Recommended
from harness.reports.answers.recommending import Combination
from harness.reports.answers.traps import Red
from harness.reports.text import platforms

VIRTUAL = ("DISPLAY", "virtual")
"""As cells have it for which a display was started."""
FEW = 3
SHOWN = 5
LONGEST = 200
"""Characters of a line that says why."""


def lines(
    answer: Recommended, machines: Mapping[str, Any], names: Iterable[str], width: int, *, whole: bool
) -> list[str]:
    """Return the answer as wrapped lines; `whole` leaves nothing out."""
    paragraphs = [*_answer(answer, machines, whole=whole), *_traps(answer, whole=whole), "", "next", *_next(answer)]
    paragraphs = [*_unknown(answer, names), *paragraphs]
    return [line for text in paragraphs for line in wrap_line(text, width)]


def paste(combination: Combination) -> str:
    """Return a line to copy: requirements, with the Python and the variables to set as a comment."""
    shown = {name: value for name, value in combination.settings.items() if (name, value) != VIRTUAL}
    minor = ".".join(combination.python.split(".")[:2])
    notes = [f"Python {minor}", *(f"{name}={value}" for name, value in shown.items())]
    # `virtual` is our own word for a display and nothing that a person could set.
    notes += ["a display"] * (len(shown) < len(combination.settings))
    return f"{shlex.join(combination.requirements)}  # {', '.join(notes)}"


def wrap_line(text: str, width: int) -> list[str]:
    """Wrap a line at spaces; lines meant for copying are never broken."""
    if len(text) <= width or "  # Python" in text or text.lstrip().startswith(("simmatrix ", "uv ")):
        return [text]
    indent = " " * (len(text) - len(text.lstrip()) + 2)
    return textwrap.wrap(text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


# --- what works ------------------------------------------------------------------------------------------------


def _answer(answer: Recommended, machines: Mapping[str, Any], *, whole: bool) -> Iterator[str]:
    if answer.measured:
        first, *others = answer.measured
        yield from _first(first, machines, whole=whole)
        for combination in answer.newer:
            minor = ".".join(combination.python.split(".")[:2])
            versions = _versions(combination.versions)
            yield f"  {versions} works on Python {minor}; on {answer.python} it was never measured:"
            pins = [f"{name}=={version}" for name, version in combination.versions.items()]
            yield f"    {try_command(pins, answer.python)}"
        yield from _others(others, answer.found, machines, whole=whole)
        if answer.doubtful:
            yield ""
            yield "in doubt"
            yield from (f"  {line}" for line in _doubtful(answer.doubtful[: None if whole else 1]))
        return
    if answer.apart:
        yield from _apart(answer.apart)
    elif answer.partly:
        yield "works in part: nothing that was measured passes as a whole"
    elif not answer.installed and not answer.unknown and not answer.doubtful:
        yield "no combination that was measured is known to be good"
    yield from _doubtful(answer.doubtful[: None if whole else FEW])
    for part in answer.partly[: None if whole else 1]:
        yield from _partly(part)
    for guess in answer.inferred:
        yield f"inferred, not measured: {_versions(guess.versions)} on Python {guess.python}"
        yield f"  {guess.why}"
        yield f"  cells {', '.join(guess.from_cells)}"
    if answer.nearby:
        yield f"{answer.nearby.where} there is, measured and found good:"
        yield from (f"  {paste(one)}" for one in answer.nearby.combinations[: None if whole else FEW])


def _first(combination: Combination, machines: Mapping[str, Any], *, whole: bool) -> Iterator[str]:
    """Yield the combination to take, and the evidence for it."""
    yield paste(combination)
    passed = ", ".join(phase for phase in CASE_PHASES if combination.phases.get(phase) == "passed")
    environments = combination.environments
    yield f"  passed {passed} in {first_few(environments, len(environments) if whole else SHOWN)}"
    if combination.unverified:
        yield f"  not verified: {', '.join(combination.unverified)}"
    where = "; ".join(_machine(name, machines) for name in combination.machines)
    yield f"  measured {combination.measured[:10]} on Python {', '.join(combination.pythons)}; {where}"
    if combination.repaired:
        patched = ", ".join(combination.repaired)
        yield f"  {patched} needs a patched wheel, which no index has: --lock-out FILE writes it, too"
    if combination.brought:
        yield f"  needs what no index has: {', '.join(combination.brought)}"
    more = f", and {len(combination.cells) - 1} more" if len(combination.cells) > 1 else ""
    yield f"  simmatrix show {combination.cell}{more and f'  #{more[1:]}'}"
    if whole:
        yield f"  lock {format_count(combination.lock.count('=='), 'package')}, sha256 {combination.lock_sha256[:16]}"
        yield from (f"  {name} {' or '.join(held)}" for name, held in combination.beside.items())


def _others(others: Sequence[Combination], total: int, machines: Mapping[str, Any], *, whole: bool) -> Iterator[str]:
    shown = others if whole else others[:FEW]
    if shown:
        yield ""
        yield "older or other combinations that work"
    for combination in shown:
        yield from (
            [f"  {line}" for line in _first(combination, machines, whole=True)]
            if whole
            else [f"  {paste(combination)}"]
        )
    if total - 1 > len(shown):
        yield f"  and {total - 1 - len(shown)} more: --all"


def _doubtful(combinations: Iterable[Combination]) -> Iterator[str]:
    """Yield combinations that work but that a silent known issue fits."""
    for combination in combinations:
        yield paste(combination)
        yield f"  it ran, but {', '.join(combination.unverified)} fits it, and no check has shown or refuted that"
        yield from (
            f"  simmatrix known {name.removeprefix('silent:')}" for name in combination.unverified if ":" in name
        )
        yield f"  simmatrix show {combination.cell}"


def _partly(part: Partly) -> Iterator[str]:
    total = len(part.works) + len(part.fails)
    yield f"{paste(part.combination)}  # {len(part.works)} of {total} tasks"
    yield f"  works: {', '.join(part.works)}"
    for name, why in part.fails.items():
        how = word(part.verdict) if part.verdict == "misleads" else "fails"
        yield f"  {how}: {name}: {textwrap.shorten(why, LONGEST)}"
    yield f"  simmatrix show {part.combination.cell}"


def _apart(apart: Apart) -> Iterator[str]:
    yield f"never measured together: {', '.join(' with '.join(half.packages) for half in apart.halves)}"
    for half in apart.halves:
        yield f"  {_half(half)}"


def _half(half: Half) -> str:
    if half.combination:
        return f"{' with '.join(half.packages)} alone works: {paste(half.combination)}"
    if half.installed:
        return f"{half.packages[0]} was installed too, never run: {', '.join(half.installed[:SHOWN])}"
    return f"{' with '.join(half.packages)}: nothing measured is good"


def _unknown(answer: Recommended, names: Iterable[str]) -> Iterator[str]:

    for name in answer.unknown:
        yield f"{name}: nothing was measured with it{suggestion(name, names).partition('; valid')[0]}"
    for name, releases in answer.installed.items():
        yield f"{name} was installed with other packages, never run: {first_few(releases, SHOWN)}"


# --- what does not ---------------------------------------------------------------------------------------------


def _traps(answer: Recommended, *, whole: bool) -> Iterator[str]:
    # What fails in the first combination that works in part is listed with it already.
    partly_cells = {part.combination.cell for part in answer.partly[:1]}
    reds = [one for one in answer.red if not partly_cells & {*one.cells}]
    shown = reds if whole else reds[:FEW]
    if shown:
        yield ""
        yield "traps" if answer.measured or answer.partly else "measured, and does not work"
    for trap in shown:
        yield from (f"  {line}" for line in _trap(trap))
    if len(reds) > len(shown):
        yield f"  and {format_count(len(reds) - len(shown), 'more cause')}: --all"


def _trap(trap: Red) -> Iterator[str]:
    versions = "; ".join(_versions(held) for held in trap.versions[:FEW])
    more = f" and {len(trap.versions) - FEW} more" if len(trap.versions) > FEW else ""
    how = " or ".join(word(verdict) for verdict in trap.verdicts)
    where = f" in {trap.phase}" if trap.phase and trap.verdicts != ("unresolvable",) else ""
    deciding = ", ".join(f"{name} {' or '.join(held[:FEW])}" for name, held in (trap.deciding or trap.beside).items())
    deciding = deciding and f", {'with' if trap.deciding else 'measured with'} {deciding}"
    pythons = "" if "Python" in trap.deciding else f" on Python {', '.join(trap.pythons)}"
    yield f"{versions}{more}{deciding}{pythons}: {how}{where}"
    yield from (f"  {textwrap.shorten(text, LONGEST, placeholder=' ...')}" for text in (trap.line, trap.reason) if text)
    yield from (f"  simmatrix known {name}" for name in trap.causes)
    yield f"  simmatrix show {trap.cells[0]}"


# --- small words -----------------------------------------------------------------------------------------------


def _versions(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {version}" for name, version in versions.items())


def _machine(name: str, machines: Mapping[str, Any]) -> str:
    facts = machines.get(name, {})
    gl, gpu = platforms.drawing(facts).get("vendor"), platforms.gpu_models(facts)
    return ", ".join(str(fact) for fact in (facts.get("os"), facts.get("architecture"), gl, gpu) if fact) or name


def try_command(requirements: Iterable[str], python: str | None, env: str | None = None) -> str:
    """Return the command that measures these requirements."""
    words = ["simmatrix", "try", *requirements]
    words += ["--python", python] if python else []
    return shlex.join([*words, *(["--env", env] if env else [])])


def _next(answer: Recommended) -> Iterator[str]:
    if answer.measured:
        words = ["simmatrix", "recommend", *answer.asked]
        words += ["--python", answer.python] if answer.python else []
        words += ["--needs", ",".join(answer.needs)] if answer.needs else []
        words += ["--env", answer.env] if answer.env else []
        yield f"  {shlex.join([*words, '--lock-out', 'requirements.txt'])}"
    elif answer.apart:
        yield f"  {try_command(answer.apart.requirements, answer.apart.python, answer.env)}"
    else:
        yield f"  {answer.next}"
