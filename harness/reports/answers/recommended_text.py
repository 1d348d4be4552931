"""Write the answer of `recommend` in words: a command to paste, three lines why, and at most three traps."""

from __future__ import annotations

import re
import shlex
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from harness.model.report_types import first_few, format_count, word
from harness.reports.answers.never_together import Half
from harness.reports.answers.recommended import Partly, Recommended
from harness.reports.answers.recommending import Combination
from harness.reports.answers.traps import Red
from harness.reports.answers.weighing import Neighbour, Weighed
from harness.reports.install_texts import install_commands
from harness.standalone.keys import SIMULATORS, weight

FEW = 3
SHOWN = 5
ROWS = 3
"""Rows of a terminal that a trap may take."""

SPACE = "\xa0"
"""Stands between the words of a command, where no line may be broken."""


def lines(
    answer: Recommended, machines: Mapping[str, Any], names: Iterable[str], width: int, tool: str, *, whole: bool
) -> list[str]:
    """Return the short answer as wrapped lines: the command, why, and traps; with `whole` the rest follows."""
    reasons = [*_unknown(answer, names), *_why(answer, machines, tool)]
    others = list(_other_blocks(answer, width))
    selected = select_traps(answer)[: max(FEW - len(others), 0)]
    traps = [*others, *(_trap_block(trap, answer, width) for trap in selected)]
    more = count_rest(answer, len(selected))
    return [
        first_line(answer, tool),
        *(["why"] if reasons else []),
        *(row for text in reasons[:FEW] for row in wrap_line(f"  {text}", width)),
        *(["traps"] if traps else []),
        *(row for block in traps[:FEW] for row in block),
        *([f"and {more}: --all"] if more and not whole else []),
    ]


def first_line(answer: Recommended, tool: str) -> str:
    """Return the answer as a command to paste: the one that installs, or the one that measures."""
    if answer.measured:
        return install_commands.command(answer.measured[0], tool)
    if answer.partly and not answer.apart:
        part = answer.partly[0]
        total = len(part.works) + len(part.fails)
        return f"{install_commands.command(part.combination, tool)}; {len(part.works)} of {total} tasks work"
    if answer.doubtful:
        return f"{install_commands.command(answer.doubtful[0], tool)}; in doubt"
    if answer.apart:
        command = try_command(answer.apart.requirements, answer.apart.python, answer.env)
        return f"{command}  # never measured together"
    return f"{answer.next}  # {'nothing that was measured works' if answer.red else 'never measured'}"


def wrap_line(text: str, width: int) -> list[str]:
    """Wrap a line at spaces; lines meant for copying are never broken, nor are the commands of a sentence."""
    return [row.replace(SPACE, " ") for row in _wrap(text, width)]


def _wrap(text: str, width: int) -> list[str]:
    """Wrap a line, with its commands still held together."""
    command = text.lstrip().startswith(("simmatrix ", "uv ")) or "  # Python" in text or " " not in text.strip(" ")
    if len(text) <= width or command:
        return [text]
    indent = " " * (len(text) - len(text.lstrip(" ")) + 2)
    return textwrap.wrap(text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def unbroken(*words: str) -> str:
    """Return a command that is not broken where its line is wrapped."""
    return SPACE.join(words)


def count_rest(answer: Recommended, shown: int) -> str:
    """Return in words what the short answer leaves out, which shows so many traps; empty if that is nothing."""
    others = answer.found - 1 if answer.found else 0
    causes = len(answer.red) - shown
    words = [
        format_count(others, "other combination") + " that work" + "s" * (others == 1) if others else "",
        format_count(causes, "more trap") if causes > 0 else "",
    ]
    return " and ".join(filter(None, words))


# --- why -------------------------------------------------------------------------------------------------------


def _why(answer: Recommended, machines: Mapping[str, Any], tool: str) -> Iterator[str]:
    if answer.measured and answer.weighed:
        first = answer.measured[0]
        yield weighed_words(answer.weighed, first, answer)
        yield from list(_second(answer))[:1]
        yield evidence(first, machines)
        return
    for combination in answer.doubtful[:1]:
        yield from doubt(combination)
    if answer.apart:
        yield from (half(one) for one in answer.apart.halves)
        return
    for part in answer.partly[:1]:
        yield f"works: {', '.join(part.works)}; nothing that was measured passes as a whole"
        yield evidence(part.combination, machines)
    for guess in answer.inferred[:1]:
        yield f"inferred, not measured: {versions_words(guess.versions)} on Python {guess.python}"
        yield guess.why
    if answer.nearby:
        yield f"{answer.nearby.where}: {install_commands.command(answer.nearby.combinations[0], tool)}"


def weighed_words(weighed: Weighed, first: Combination, answer: Recommended) -> str:
    """Return in one sentence what was weighed for a combination."""
    python = answer.python
    on = f" on Python {python}" if python else ""
    which = answer.env or format_count(weighed.tasks, "task")
    tasks = f"{which} passed {', '.join(weighed.passed)}" if weighed.tasks and weighed.passed else ""
    if weighed.works == 1:
        rank = f"the only combination measured to work{on}"
    else:
        rank = f"newest of {weighed.works} that work{on}"
        if weighed.newer:
            rank = f"newest of {weighed.works} that work{on}, but for {versions_words(weighed.newer)} ({weighed.why})"
    where = "" if python else f" on Python {', '.join(weighed.pythons)}"
    return f"{rank}: {tasks}{where}" if tasks else f"{rank}{where}"


def _second(answer: Recommended) -> Iterator[str]:
    """Yield further reasons, the one that tells most first."""
    weighed, first = answer.weighed, answer.measured[0]
    if first.unverified:
        yield f"not verified: {', '.join(first.unverified)}"
    if weighed and weighed.behaves:
        yield "; ".join(map(behaviour_words, weighed.behaves))
    if weighed and weighed.thorough:
        most = weighed.thorough
        where = f"Python {', '.join(most.pythons)}"
        yield f"most tasks: {versions_words(most.versions)}, {most.tasks} on {where}"


def behaviour_words(neighbour: Neighbour) -> str:
    """Return how a release behaves next to the one before it."""
    beside = {name: version for name, version in neighbour.beside.items() if name in SIMULATORS}
    where = f" (with {versions_words(beside)})" if beside else ""
    how = f"as {neighbour.before} in {neighbour.same} of {format_count(neighbour.tasks, 'task')}"
    return f"{neighbour.package} {neighbour.version} behaves {how}{where}"


def evidence(combination: Combination, machines: Mapping[str, Any]) -> str:
    """Return when and where a combination was measured, and the command that opens it."""
    opened = unbroken("simmatrix", "show", combination.cell)
    builds = [f"{name} as {version}" for name, version in combination.builds.items() if name in combination.versions]
    which = f" with {', '.join(builds)}" if builds else ""
    where = machine_words(combination.machine, machines)
    lock = f"lock: {unbroken('--lock-out', 'FILE')}"
    return f"measured {combination.measured[:10]}{which} on {where}; {lock}; {opened}"


def doubt(combination: Combination) -> Iterator[str]:
    """Yield why a combination that ran may be wrong."""
    names = [name.removeprefix("silent:") for name in combination.unverified if ":" in name]
    opened = "; ".join(unbroken("simmatrix", "known", name) for name in names)
    yield f"it ran, but a known issue that raises nothing fits it: {opened}"
    yield f"measured {combination.measured[:10]}: {unbroken('simmatrix', 'show', combination.cell)}"


def half(part: Half) -> str:
    """Return what was measured of one part of the packages."""
    names = " with ".join(part.packages)
    if part.combination:
        shown = " ".join(part.combination.requirements)
        opened = unbroken("simmatrix", "show", part.combination.cell)
        return f"{names} alone works: {shown} on Python {install_commands.minor(part.combination)}: {opened}"
    if part.installed:
        return f"{part.packages[0]} was installed too, never run: {', '.join(part.installed[:SHOWN])}"
    return f"{names}: nothing measured is good"


def _unknown(answer: Recommended, names: Iterable[str]) -> Iterator[str]:
    for name in answer.unknown:
        from harness.model.schema import suggestion  # noqa: PLC0415 - start-up

        yield f"{name}: nothing was measured with it{suggestion(name, names).partition('; valid')[0]}"
    for name, releases in answer.installed.items():
        yield f"{name} was installed with other packages, never run: {first_few(releases, SHOWN)}"


# --- traps -----------------------------------------------------------------------------------------------------


def select_traps(answer: Recommended) -> list[Red]:
    """Return the traps to show, each known issue once, without failures of the combination that works in part."""
    listed = {part.combination.cell for part in answer.partly[:1]}
    shown: set[str] = set()
    selected = []
    for trap in answer.red:
        if not (listed & {*trap.cells} or (trap.causes and shown.issuperset(trap.causes))):
            selected.append(trap)
            shown.update(trap.causes)
    return selected


def _other_blocks(answer: Recommended, width: int) -> Iterator[list[str]]:
    """Yield what else one can run into: a newer combination of another Python, one in doubt, tasks that fail."""
    for combination in answer.newer:
        minor = install_commands.minor(combination)
        works = f"{versions_words(combination.versions)} works on Python {minor}"
        if answer.newer_unfit:
            opened = unbroken("simmatrix", "show", combination.cell)
            yield _block(f"{works}; {answer.newer_unfit}", f"use Python {minor}", opened, width)
            continue
        pins = [f"{name}=={version}" for name, version in combination.versions.items()]
        command = try_command(pins, answer.python).replace(" ", SPACE)
        yield _block(f"{works}, and was never measured as a whole on {answer.python}", "", command, width)
    if answer.measured:
        for combination in answer.doubtful[:1]:
            why, opened = doubt(combination)
            yield _block(f"{versions_words(combination.versions)}: {why}", "", opened, width)
    for part in [] if answer.apart else answer.partly[:1]:
        yield from _failing_tasks(part, width)


def _failing_tasks(part: Partly, width: int) -> Iterator[list[str]]:
    how = "misleads" if part.verdict == "misleads" else "fails"
    opened = unbroken("simmatrix", "show", part.combination.cell)
    for name, why in part.fails.items():
        yield _block(f"{how}: {name}: {why}", "", opened, width)


def _trap_block(trap: Red, answer: Recommended, width: int) -> list[str]:
    """Return a trap in a few rows; what is not known of it stands where it is not cut."""
    do, opened = advice(trap, answer), opener(trap)
    if _fits(do, opened, width):
        return _block(describe_trap(trap), do, opened, width)
    return _block(describe_trap(trap), shorten(do, width - len("    do: ")), opened, width)


def _fits(do: str, opened: str, width: int) -> bool:
    return not do or len(f"    do: {do}; {opened}") <= width


def _block(text: str, do: str, opened: str, width: int) -> list[str]:
    """Return a trap in a few rows: what fails, then what to do and the command that opens it, both shortened."""
    together = f"    {f'do: {do}; ' if do else ''}{opened}"
    # Where both do not fit, each has a row of its own, and the failure is cut to one.
    actions = [together] if _fits(do, opened, width) else ["    " + shorten(f"do: {do}", width - 4), f"    {opened}"]
    rows = _wrap(f"  {text}", width)
    most = ROWS - len(actions)
    if len(rows) > most:
        last = shorten(" ".join(rows[most - 1 :]), width - 4)
        rows = [*rows[: most - 1], f"{' ' * (4 if most > 1 else 2)}{last}"]
    return [row.replace(SPACE, " ") for row in (*rows, *actions)]


def shorten(text: str, width: int) -> str:
    """Return a text cut at a space where it is too long; no command of it is cut."""
    rows = textwrap.wrap(
        re.sub("[ \\n]+", " ", text), max(width, 10), max_lines=1, placeholder=" ...", break_on_hyphens=False
    )
    return rows[0] if rows else ""


def describe_trap(trap: Red) -> str:
    """Return what fails: versions, what decides, the tasks, and the line that says why."""
    more = f" and {len(trap.versions) - 1} more" if len(trap.versions) > 1 else ""
    named = _decisive(trap) or ({} if trap.elsewhere else trap.beside)
    first = sorted(named, key=lambda name: -weight(name))[:FEW]
    deciding = [f"{name} {' or '.join(named[name][:FEW])}" for name in first]
    what = f"{versions_words(trap.versions[0])}{more}" + (f" with {', '.join(deciding)}" if deciding else "")
    what += "" if "Python" in trap.deciding else f" on Python {', '.join(trap.pythons[:FEW])}"
    how = " or ".join(word(verdict) for verdict in trap.verdicts)
    tasks = first_few(trap.tasks, 2) if trap.phase not in {"resolve", "install"} else ""
    if tasks and trap.elsewhere and not trap.deciding:
        # These very versions work with other tasks.
        what, how = f"{tasks} with {what}", "fails" if len(trap.tasks) == 1 else "fail"
    elif tasks:
        how = f"{how} in {tasks}"
    return f"{what}: {how}{f': {trap.line}' if trap.line else ''}"


def _decisive(trap: Red) -> Mapping[str, tuple[str, ...]]:
    """Return what decides; of absent packages those that the remedy names, where it names one."""
    absent = {name for name, values in trap.deciding.items() if values == ("absent",)}
    named = {name for name in absent if re.search(rf"\b{re.escape(name)}\b", trap.remedy or "")}
    return {name: values for name, values in trap.deciding.items() if not named or name not in absent - named}


def advice(trap: Red, answer: Recommended) -> str:
    """Return what to do about a trap; empty if nothing is known to help."""
    change = ", ".join(f"{name} {value}" for name, value in trap.instead.items())
    if trap.remedy:
        python = "use " if trap.remedy.startswith("Python") else ""
        return python + (trap.remedy if python else trap.remedy[0].lower() + trap.remedy[1:])
    # The answer itself is what works, where something does.
    return f"take {change}" if change else "take the versions above" if answer.measured and not trap.elsewhere else ""


def opener(trap: Red) -> str:
    """Return the command that opens a trap: its known issue, else its cell."""
    return unbroken("simmatrix", *(("known", trap.causes[0]) if trap.causes else ("show", trap.cells[0])))


# --- small words -----------------------------------------------------------------------------------------------


def versions_words(versions: Mapping[str, str]) -> str:
    """Return packages and their versions as text."""
    return ", ".join(f"{name} {version}" for name, version in versions.items())


def machine_words(name: str, machines: Mapping[str, Any]) -> str:
    """Return a machine in a few words."""
    facts = machines.get(name, {})
    words = [str(fact).replace(" GNU/Linux", "") for fact in (facts.get("os"), facts.get("architecture")) if fact]
    return ", ".join(words) or name


def try_command(requirements: Iterable[str], python: str | None, env: str | None = None) -> str:
    """Return the command that measures these requirements."""
    words = ["simmatrix", "try", *requirements]
    words += ["--python", python] if python else []
    return shlex.join([*words, *(["--env", env] if env else [])])
