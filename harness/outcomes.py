"""How a check ended: what the cell said of it, and what the end of its process adds."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from harness import normalise, wire
from harness.model import CheckRecord, CheckReply, Finding, Level, Outcome, Phase, ProbeReply

NEEDS = {Phase.SINGLE: Phase.IMPORT, Phase.VECTOR: Phase.SINGLE, Phase.RENDER: Phase.SINGLE}
"""The phase without which another says nothing new."""

MACHINE_TROUBLE = re.compile(
    r"No space left on device|Disk quota exceeded|Read-only file system|Cannot allocate memory|Too many open files"
    r"|Temporary failure in name resolution|Name or service not known|Network is unreachable"
)
NO_DISPLAY = re.compile(r"DISPLAY environment variable is missing|[Ff]ailed to open display|[Cc]annot open display")

"""What the operating system says when this machine or its network is short of something, whatever the package.

A file system is read-only by the doing of this machine, or by ours where an environment cannot be sealed otherwise.
"""


@dataclass(frozen=True, kw_only=True, slots=True)
class Ending:
    """How a probe's process ended, as far as it matters to the check that was running then.

    `overran` is the limit in seconds that ended it, `trouble` why the harness ended it for another reason.
    """

    exit_code: int | None = None
    signal: int | None = None
    overran: float | None = None
    trouble: str | None = None
    stacks: str = ""


def phase_of(check: str) -> Phase:
    """The phase that a check belongs to: the part of its name before the dot."""
    return Phase(check.partition(".")[0])


def reachable(phase: Phase, known: Mapping[Phase, Outcome]) -> bool:
    """Whether no phase that this one needs is known to have ended otherwise than well."""
    needed = NEEDS.get(phase)
    while needed:
        if known.get(needed, Outcome.PASSED) is not Outcome.PASSED:
            return False
        needed = NEEDS.get(needed)
    return True


def check_record(reply: CheckReply, ending: Ending, capabilities: frozenset[str]) -> CheckRecord:
    """The record of one check; `capabilities` are this machine's (`egl`, `osmesa`, ...)."""
    outcome, decisive, mask = _outcome(reply, ending, capabilities)
    return CheckRecord(
        check=reply.check,
        outcome=outcome,
        seconds=reply.seconds,
        decisive=decisive,
        masked_by=mask,
        facts=reply.facts,
    )


def found_beside(reply: ProbeReply, ending: Ending) -> Iterator[Finding]:
    """What the end of a probe says besides its checks: of those that can only find, and of Python's own end."""
    known = {check.check: check for check in reply.checks}
    for leader, names in wire.FOLLOWERS.items():
        led = leader in known and known[leader].outcome is Outcome.PASSED
        for name in names if led else ():
            if name not in known:
                yield Finding(check=name, level=Level.WARNING, text="not looked at: the process ended before")
            elif known[name].outcome is None:
                _, decisive, _ = _died(known[name], ending)
                yield Finding(check=name, level=Level.WARNING, text=f"{decisive}")
    if known and not ending.trouble and all(check.outcome for check in known.values()):
        text = _last_gasp(ending)
        if text:
            phase = phase_of(reply.checks[-1].check)
            yield Finding(check=f"{phase}.teardown", level=Level.WARNING, text=text)


def _last_gasp(ending: Ending) -> str | None:
    """How Python ended after its last check, unless well."""
    if ending.overran is not None:
        return f"Python did not end within {ending.overran:g} s of the last check"
    if ending.signal or ending.exit_code:
        return f"after the last check: {normalise.death(ending.exit_code, ending.signal, ending.stacks)}"
    return None


def _outcome(reply: CheckReply, ending: Ending, capabilities: frozenset[str]) -> tuple[Outcome, str | None, str | None]:
    match reply.outcome:
        case Outcome.PASSED:
            return Outcome.PASSED, None, None
        case None:
            return _died(reply, ending)
        case Outcome.FAILED:
            return _failed(reply, capabilities)
        case other:
            return other, reply.reason, None


def _failed(reply: CheckReply, capabilities: frozenset[str]) -> tuple[Outcome, str | None, str | None]:
    decisive, mask = normalise.decisive_of_check(reply)
    told = decisive or ""
    if reply.raised and reply.raised.blame == "harness":
        return Outcome.INFRA, f"a fault of the harness, not of the packages: {told}", mask
    if MACHINE_TROUBLE.search(told):
        return Outcome.INFRA, told, mask
    if phase_of(reply.check) is Phase.RENDER and (lacking := _lacking(reply, told, capabilities)):
        return Outcome.UNAVAILABLE, f"no {lacking} here: {told}", mask
    return Outcome.FAILED, decisive, mask


def _lacking(reply: CheckReply, told: str, capabilities: frozenset[str]) -> str | None:
    """What this machine lacks for rendering, where that can be why it failed."""
    if reply.facts.get("gl") and not capabilities & {"egl", "osmesa"}:
        return "EGL and no OSMesa"
    if NO_DISPLAY.search(told) and "display" not in capabilities:
        return "display"
    return None


def _died(reply: CheckReply, ending: Ending) -> tuple[Outcome, str | None, str | None]:
    """A check that was started and never ended: its process died, or was ended."""
    child, mask = normalise.decisive_of_check(reply)
    if ending.trouble:
        return Outcome.INFRA, ending.trouble, None
    if ending.overran is not None:
        where = normalise.innermost_frame(ending.stacks)
        told = child or f"no end within {ending.overran:g} s" + (f", in {where}" if where else "")
        return Outcome.TIMED_OUT, told, mask
    return Outcome.CRASHED, child or normalise.death(ending.exit_code, ending.signal, ending.stacks), mask
