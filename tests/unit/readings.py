"""Probe runs as they are stored, made for tests out of the real types: a reply in its lines, an end, a host."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Any

import msgspec

from harness.judging.runs.fold import CasePlan, wanted_of
from harness.model import CASE_PHASES, Case
from harness.probes import wire
from harness.probes.evidence import LOG, REPLY, Host, ProbeRun, Reading, Request, RunEnd

PYTHON = "3.11.7"
PASSED, FAILED, SKIPPED, DIED = "passed", "failed", "skipped", None
GOOD = RunEnd(exit_code=0, seconds=3.0)
HERE = Host(python=PYTHON, conditions="here")
PROGRAM = "of-today"


def observed(code: str, **data: str) -> dict[str, Any]:
    """Return an observation as a cell writes it."""
    return {"code": code, "at": None, "got": None, "promised": None, "data": data}


@dataclass(frozen=True, kw_only=True)
class Check:
    """A check of a reply: how it ended, if it did, and what it found on the way."""

    name: str
    outcome: str | None = PASSED
    message: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    findings: tuple[str, ...] = ()
    blame: str = "library"

    def records(self) -> Iterable[dict[str, Any]]:
        """Yield its records as the cell writes them."""
        yield {"kind": "start", "check": self.name}
        for text in self.findings:
            odd = f"{self.name.partition('.')[0]}.odd"
            yield {
                "kind": "finding",
                "check": odd,
                "level": "warning",
                "observed": observed("warned.check_env", text=text),
            }
        if self.outcome is DIED:
            return
        raised = {"type": "RuntimeError", "message": self.message, "traceback": "", "blame": self.blame}
        yield {
            "kind": "check",
            "check": self.name,
            "outcome": self.outcome,
            "seconds": 1.0,
            "raised": raised if self.outcome == FAILED else None,
            "observed": observed("skip.no_state") if self.outcome == SKIPPED else None,
            "workers": [],
            "facts": dict(self.facts),
        }


def followers(check: Check, wanted: Iterable[str]) -> tuple[Check, ...]:
    """Return those of the checks that are to follow others, that follow this one if it passed."""
    return passed(*(one for one in wanted if wire.leader_of(one) == check.name)) if check.outcome == PASSED else ()


def passed(*names: str) -> tuple[Check, ...]:
    """Return checks that passed."""
    return tuple(Check(name=name) for name in names)


def lines(checks: Iterable[Check], *, python: str = PYTHON, last: bool = True) -> bytes:
    """Return the reply of a probe that came to these checks; `last` is whether its last line is there."""
    hello = {"kind": "hello", "python": python, "implementation": "CPython", "executable": "$ENV/bin/python"}
    end = [{"kind": "end", "modules": [], "versions": {}}] if last else []
    records = [hello, *(record for check in checks for record in check.records()), *end]
    numbered = (dict(record, seq=number, pid=4) for number, record in enumerate(records))
    return b"".join(json.dumps(record).encode() + b"\n" for record in numbered)


def reading(
    request: Request,
    checks: Iterable[Check] = (),
    *,
    end: RunEnd = GOOD,
    host: Host = HERE,
    texts: Mapping[str, bytes] | None = None,
    program: Mapping[str, str] | None = None,
) -> Reading:
    """Return the stored run of a request: a process that came to these checks and ended in this way."""
    all_checks = tuple(one for check in checks for one in (check, *followers(check, request.followers)))
    dead = not all_checks or all_checks[-1].outcome is DIED
    written = {REPLY: lines(all_checks, last=not dead)} if all_checks else {}
    written = {**written, LOG: b"", **(texts or {})}
    program_digests = program if program is not None else dict.fromkeys((*request.limits, *request.followers), PROGRAM)
    files = {name: sha256(content).hexdigest() for name, content in written.items()}
    instant = "2026-11-23T12:00:00Z"
    run = ProbeRun(request=request, program=program_digests, end=end, host=host, files=files, measured=instant)
    return Reading(sha256(msgspec.json.encode(run)).hexdigest(), run, written)


CASE = Case(
    id="ant",
    env="Ant-v5",
    api="gymnasium",
    checks=("import.modules", "single.loop", "vector.sync", "vector.async.fork", "render.rgb_array"),
    timeouts={},
)


def plan_case(case: Case = CASE, *, verify: bool = False, program: Mapping[str, str] | None = None) -> CasePlan:
    """Return a question for all of a case, with today's in-cell program unless `program` names another for a check."""
    names = (*case.checks, *wire.followers_of(case.checks), "single.repeat")
    program_digests = {**dict.fromkeys(names, PROGRAM), **(program or {})}
    return CasePlan(case=case, wanted=wanted_of(case.checks, CASE_PHASES[-1]), program=program_digests, verify=verify)
