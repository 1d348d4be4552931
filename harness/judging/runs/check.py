"""Judge how a check ended, from the reply of the cell and the end of its process."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache

from msgspec import Struct

from harness.judging.runs.decisive_line import decisive_of_check, observed_of_check
from harness.model import FAILING, CheckRecord, CheckReply, Finding, Level, Outcome, Phase, ProbeReply
from harness.model.machine_trouble import FULL, MACHINE_TROUBLE, ROOMY_MB, SHOT
from harness.model.vocabulary import MISLEADING
from harness.probes import wire
from harness.probes.evidence import STACKS, STARTUP_SECONDS, Reading
from harness.probes.facts import plain
from harness.standalone.adapters import adapters
from harness.standalone.failures.lines import SILENT, decisive_line, describe_death, innermost_frame

MOST_STACKS = 200_000
"""Characters of faulthandler's stacks that are looked at."""

TAKEN_AWAY = "the environment was removed or changed while it was used"
"""Why a failure says nothing of packages: the environment no longer stands as it was installed."""

UNMEASURED = "unmeasured."
"""The beginning of codes by which a misleading check says that it shows nothing, and refutes nothing either."""

NEEDS = {
    Phase.SINGLE: Phase.IMPORT,
    **dict.fromkeys((Phase.VECTOR, Phase.RENDER, Phase.BEHAVE, Phase.INTEROP), Phase.SINGLE),
}
"""The phase without which another says nothing new."""

DRAWING = "drawing"
"""The fact of a check that it failed while it drew, or got ready for that: other settings may let it pass."""

WINDOW_CODE = re.compile(r"/pygame/|pygame\.error|\bSDL_|XOpenDisplay|\bDISPLAY\b")
BLANK = "render.blank"

SIGKILLED = re.compile(r"^(worker )?killed by SIGKILL")
SHARED_MEMORY = re.compile(r"/dev/shm|_posixshmem|\bSemLock\b|\bshm_open\b|/multiprocessing/(?:heap|synchronize)\.py")
"""Errors on a machine without /dev/shm: of shared memory, and of the locks and queues of multiprocessing."""

PYGLET_CODE = re.compile(r"/pyglet/")
IGNORED = re.compile(r"^Traceback \(most recent call last\):\n(?:^[ \t].*\n)+\S.*$(?:\n[ \t].*$)*", re.MULTILINE)
"""A traceback; one that Python prints at its end is of an exception that nobody can catch."""

DRAWING_CODE = r"/(?:OpenGL|glfw)/"
"""Files of a traceback in which something was about to draw by OpenGL, in a way of their own or by MUJOCO_GL."""


class Ending(Struct, frozen=True, kw_only=True):
    """The end of a probe's process, as far as it matters to the check that was running then.

    `overran` is the limit in seconds that ended it, `trouble` why the harness ended it for another reason. `full` is
    true if the disk that it wrote to had no room left, `least_room_mb` is the least room seen there. `lost` says how
    the display that it drew on ended. `shares_memory` is true if there was a /dev/shm to write to. `stacks` are its
    last output, and faulthandler's.
    """

    exit_code: int | None = None
    signal: int | None = None
    overran: float | None = None
    trouble: str | None = None
    full: bool = False
    lost: str | None = None
    least_room_mb: int | None = None
    shares_memory: bool = True
    stacks: str = ""

    @property
    def afterwards(self) -> str:
        """Return the output after the last line of the reply."""
        return self.stacks.partition(wire.LAST_WORDS)[2]


def ending_of(reading: Reading) -> Ending:
    """Return the end of a probe run, as it matters to the check that was running then."""
    end, memory = reading.run.end, reading.run.request.memory_mb
    overran = STARTUP_SECONDS if end.timed_out else end.overran
    limit = f"needs more than the {memory} MB that its case allows; `memory_mb` of the case raises that"
    # Past a limit `killed` only repeats that limit; with `out_of_memory` it says that the whole machine had none left.
    trouble = end.killed if overran is None or end.out_of_memory else None
    return Ending(
        exit_code=end.exit_code,
        signal=end.signal,
        overran=overran,
        trouble=trouble or (limit if end.out_of_memory else None),
        full=end.full,
        lost=end.lost,
        least_room_mb=end.least_room_mb,
        shares_memory=reading.run.host.shares_memory,
        stacks=reading.last_lines + reading.text(STACKS)[:MOST_STACKS],
    )


def phase_of(check: str) -> Phase:
    """Return the phase that a check belongs to: the part of its name before the dot."""
    return Phase(check.partition(".")[0])


def reachable(phase: Phase, outcomes: Mapping[Phase, Outcome]) -> bool:
    """Return whether all phases that this one needs passed, or have no outcome yet."""
    needed = NEEDS.get(phase)
    while needed:
        if outcomes.get(needed, Outcome.PASSED) is not Outcome.PASSED:
            return False
        needed = NEEDS.get(needed)
    return True


def check_record(reply: CheckReply, ending: Ending, undrawable: Mapping[str, str]) -> CheckRecord:
    """Return the record of one check. `undrawable` says why OpenGL cannot draw here (`explain_undrawable`)."""
    outcome, decisive, mask = _outcome(reply, ending, undrawable)
    shortage = ending.lost or _shortage(reply, decisive or "", ending) if outcome in FAILING else None
    if shortage:
        outcome, decisive = Outcome.INFRA, shortage
    drawing = {DRAWING: True} if outcome in FAILING and _draws(reply, ending) else {}
    return CheckRecord(
        check=reply.check,
        outcome=outcome,
        seconds=reply.seconds,
        decisive=decisive,
        masked_by=mask,
        facts={**plain(reply.facts), **drawing},
        observed=observed_of_check(reply),
    )


def side_findings(reply: ProbeReply, ending: Ending, followers: Iterable[str]) -> Iterator[Finding]:
    """Yield findings about checks that follow others, and about the end of Python, besides the checks of a probe.

    A misleading check that was not reached is no finding: what it would refute stays unverified.
    """
    replies = {check.check: check for check in reply.checks}
    for name in followers:
        leader = replies.get(wire.leader_of(name))
        if leader is None or leader.outcome is not Outcome.PASSED:
            continue
        if name not in replies and name not in MISLEADING:
            yield Finding(check=name, level=Level.WARNING, text="not looked at: the process ended before")
        elif name in replies and replies[name].outcome is None:
            _, decisive, _ = _judge_death(replies[name], ending)
            yield Finding(check=name, level=Level.WARNING, text=f"{decisive}")
    if replies and not ending.trouble and all(check.outcome for check in replies.values()):
        text = _last_gasp(ending, complete=reply.complete)
        if text:
            phase = phase_of(reply.checks[-1].check)
            yield Finding(check=f"{phase}.teardown", level=Level.WARNING, text=text)


def _last_gasp(ending: Ending, *, complete: bool) -> str | None:
    """Return how Python ended after its last check; None if it ended well."""
    if ending.overran is not None:
        return f"Python did not end within {ending.overran:g} s of the last check"
    if ending.signal or ending.exit_code:
        return f"after the last check: {describe_death(ending.exit_code, ending.signal, ending.stacks)}"
    ignored = IGNORED.search(ending.afterwards)
    if ignored:
        return f"at the end of Python, the environment left open: {decisive_line(ignored[0])}"
    return None if complete else "Python ended before its exit handlers had run"


Ruling = tuple[Outcome, str | None, str | None]
"""An outcome, the decisive line, and what hid it."""


def _outcome(reply: CheckReply, ending: Ending, undrawable: Mapping[str, str]) -> Ruling:
    match reply.outcome:
        case Outcome.PASSED:
            return Outcome.PASSED, None, None
        case None:
            return _judge_death(reply, ending)
        case Outcome.FAILED:
            return _judge_failure(reply, undrawable)
        case Outcome.SKIPPED if reply.check in MISLEADING and _code(reply).startswith(UNMEASURED):
            return Outcome.NOT_REACHED, reply.reason, None
        case other:
            return other, reply.reason, None


def _judge_failure(reply: CheckReply, undrawable: Mapping[str, str]) -> Ruling:
    decisive, mask = decisive_of_check(reply)
    line = decisive or ""
    if reply.raised and reply.raised.blame == "harness":
        return Outcome.INFRA, f"a fault of the harness, not of the packages: {line}", mask
    way = _drawing(reply)
    if way is not None and way in undrawable:
        return Outcome.UNAVAILABLE, f"{undrawable[way]} ({line})", mask
    # An exception without an observation of ours is a failure to measure, and shows nothing of the case.
    if reply.check in MISLEADING and reply.raised and not reply.observed:
        return Outcome.NOT_REACHED, f"could not be measured: {line}", mask
    return Outcome.FAILED, decisive, mask


def was_killed(record: CheckRecord) -> bool:
    """Return whether an unknown sender killed the process of a check, or a worker of it."""
    return record.outcome is Outcome.INFRA and SHOT in (record.decisive or "")


def _shortage(reply: CheckReply, decisive: str, ending: Ending) -> str | None:
    """Return the shortage of this machine, or the kill, that made a check fail or die; None if nothing shows one."""
    killed = SIGKILLED.match(decisive)
    if killed:
        return f"{killed[1] or ''}{SHOT}"
    if ending.full:
        return f"no room left on the disk of TMPDIR: {decisive}"
    text = f"{reply.raised.message}\n{reply.raised.traceback}" if reply.raised else ending.stacks
    if not ending.shares_memory and SHARED_MEMORY.search(text):
        return f"this machine has no /dev/shm that can be written to: {decisive}"
    # Where the process says how it died, a shortage that it printed before is no reason: a SIGSEGV stays one.
    silent = decisive.endswith(SILENT)
    trouble = MACHINE_TROUBLE.search(ending.stacks if silent else decisive)
    if not trouble or (trouble[0] in FULL and _is_false_claim(reply, ending)):
        return None
    return f"{trouble[0]}: {decisive}" if silent else decisive


def _is_false_claim(reply: CheckReply, ending: Ending) -> bool:
    """Return whether a package only claims that a disk is full: none was, and no system call said so."""
    if not reply.raised or reply.workers or (ending.least_room_mb or 0) < ROOMY_MB:
        return False
    # `rrno` finds Python's `[Errno 28]` as well as the `errno 28` of other libraries.
    return not reply.raised.type.endswith(("OSError", "IOError")) and "rrno" not in reply.raised.message


def _code(reply: CheckReply) -> str:
    """Return the code of the cell's observation; empty if there is none."""
    return reply.observed.code if reply.observed else ""


def _drawing(reply: CheckReply) -> str | None:
    """Return the library that failed to draw, or to prepare for it: `pyglet`, or empty for any other.

    None if the check did not fail at drawing.
    """
    traceback = reply.raised.traceback if reply.raised else ""
    facts = reply.facts if phase_of(reply.check) is Phase.RENDER else {}
    loaded = _drawing_modules() & {*facts.get("loaded", ())}
    # pyglet needs a display; where another library is loaded beside it, that one may have drawn.
    if PYGLET_CODE.search(traceback) or loaded == {"pyglet"}:
        return "pyglet"
    return "" if facts.get("gl") or loaded or _drawing_code().search(traceback) else None


@cache
def _drawing_modules() -> frozenset[str]:
    """Return the top-level modules that draw by OpenGL: libraries that do nothing else, and what adapters declare."""
    return frozenset(["OpenGL", "glfw", "pyglet", *(name for each in adapters().values() for name in each.draws)])


@cache
def _drawing_code() -> re.Pattern[str]:
    """Return the pattern of a path in a traceback that comes from drawing by OpenGL."""
    declared = [pattern for each in adapters().values() for pattern in each.drawing_code]
    return re.compile("|".join([DRAWING_CODE, *declared]))


def _draws(reply: CheckReply, ending: Ending) -> bool:
    """Return whether a check failed by drawing: with nothing to see, or in the code of a library that draws."""
    text = f"{reply.raised.message}\n{reply.raised.traceback}" if reply.raised else ending.stacks
    if phase_of(reply.check) is Phase.RENDER and (not reply.raised or _code(reply) == BLANK):
        return True
    return any(code.search(text) for code in (PYGLET_CODE, _drawing_code(), WINDOW_CODE))


def _judge_death(reply: CheckReply, ending: Ending) -> Ruling:
    """Return the outcome of a check that started and never ended: its process died, or was ended."""
    child, mask = decisive_of_check(reply)
    # Trouble stands first: a run that was interrupted may be past its limit as well.
    if ending.trouble:
        return Outcome.INFRA, ending.trouble, None
    if ending.overran is not None:
        where = innermost_frame(ending.stacks)
        line = child or f"no end within {ending.overran:g} s" + (f", in {where}" if where else "")
        return Outcome.TIMED_OUT, line, mask
    return Outcome.CRASHED, child or describe_death(ending.exit_code, ending.signal, ending.stacks), mask
