"""The host's side of the cell protocol: replies are hostile data."""

from __future__ import annotations

import json
import sys
from functools import reduce
from pathlib import Path
from typing import Any

import pytest

from harness.model import (
    Case,
    CheckReply,
    Finding,
    Level,
    Observation,
    Outcome,
    Phase,
    ProbeReply,
    ProbeRequest,
    Raised,
    replace,
)
from harness.probes import wire

HELLO = {"kind": "hello", "python": "3.9.1", "implementation": "CPython", "executable": "/python"}
START = {"kind": "start", "check": "single.loop"}
PASSED = {
    "kind": "check",
    "check": "single.loop",
    "outcome": "passed",
    "seconds": 1.5,
    "raised": None,
    "observed": None,
    "workers": [],
    "facts": {"trajectory": ["ab"]},
}
RAISED = {"type": "ValueError", "message": "wrong", "traceback": "Traceback ...", "blame": "library"}
OUTSIDE = {"code": "space.outside", "at": 3, "got": None, "promised": "Discrete(2)", "data": {"call": "step()"}}
SEEN = Observation(check="single.space", code="space.outside", at=3, promised="Discrete(2)", data={"call": "step()"})
WORDS = "step() returned an observation outside its space Discrete(2)"
DEEP = reduce(lambda inner, _: [inner], range(20), [0])
END = {"kind": "end", "modules": ["bootstrap.py"], "versions": {"numpy": "2.0.0"}}
FACTS = {"python": "3.9.1", "implementation": "CPython", "executable": "/python"}


def lines(*records: dict[str, Any], pid: int = 7) -> list[bytes]:
    """Return records as a cell writes them, numbered."""
    return [json.dumps({"seq": number, "pid": pid, **record}).encode() + b"\n" for number, record in enumerate(records)]


def test_a_whole_reply() -> None:
    """Everything a probe tells arrives."""
    finding = {"kind": "finding", "check": "single.space", "level": "warning", "observed": OUTSIDE}
    frame = {"kind": "frame", "check": "render.rgb_array", "which": "first", "path": "a-1.npy"}
    assert wire.read_reply(lines(HELLO, START, finding, frame, PASSED, END)) == ProbeReply(
        checks=(CheckReply(check="single.loop", outcome=Outcome.PASSED, seconds=1.5, facts={"trajectory": ["ab"]}),),
        findings=(Finding(check="single.space", level=Level.WARNING, text=WORDS, observed=SEEN),),
        frames=(("render.rgb_array", "a-1.npy"),),
        facts={**FACTS, "versions": {"numpy": "2.0.0"}},
        modules=("bootstrap.py",),
        complete=True,
        during=("single.loop",),
    )


def test_observations_arrive_with_their_data() -> None:
    """Code and data arrive beside the words that are made of them: of findings, skips, violations, and of workers."""
    finding = {"kind": "finding", "check": "single.space", "level": "note", "observed": OUTSIDE}
    skipped = {**PASSED, "outcome": "skipped", "observed": OUTSIDE}
    reply = wire.read_reply(lines(HELLO, START, finding, skipped))
    assert [(one.text, one.observed) for one in reply.findings] == [(WORDS, SEEN)]
    seen = replace(SEEN, check="single.loop")
    assert [(one.reason, one.observed, one.raised) for one in reply.checks] == [(WORDS, seen, None)]
    failed = {**PASSED, "outcome": "failed", "observed": OUTSIDE}
    (check,) = wire.read_reply(lines(HELLO, START, failed)).checks
    violation = Raised(type="ContractViolation", message=WORDS, traceback="", blame="library")
    assert (check.reason, check.observed, check.raised) == (None, seen, violation)
    worker = _worker({"kind": "raised", "raised": None, "observed": OUTSIDE}, pid=11)
    (check,) = wire.read_reply(_vector((11, 0)), {"worker-11.jsonl": worker}).checks
    seen = replace(SEEN, check="vector.async.fork")
    assert [(one.raised, one.observed) for one in check.workers] == [(violation, seen)]


def test_unknown_observations_are_shown_as_they_came() -> None:
    """An unknown code, or data that are missing, are shown as they came."""
    strange = [{**OUTSIDE, "code": "no.code"}, {**OUTSIDE, "data": {}}]
    findings = [{"kind": "finding", "check": "x", "level": "note", "observed": one} for one in strange]
    reply = wire.read_reply(lines(HELLO, *findings))
    assert [one.text for one in reply.findings] == [
        'no.code: {"call": "step()", "promised": "Discrete(2)"}',
        'space.outside: {"promised": "Discrete(2)"}',
    ]


def test_nothing() -> None:
    """An empty reply is one without checks, incomplete, without problems."""
    assert wire.read_reply([]) == ProbeReply(checks=(), findings=(), frames=(), facts={}, modules=(), complete=False)


def test_death_in_a_check() -> None:
    """A check that was started and never ended has no outcome."""
    reply = wire.read_reply(lines(HELLO, START))
    assert reply.checks == (CheckReply(check="single.loop", outcome=None),)
    assert (reply.complete, reply.problems) == (False, ())


def test_an_exception() -> None:
    """An exception that a check raised arrives whole."""
    failed = {**PASSED, "outcome": "failed", "raised": RAISED}
    reply = wire.read_reply(lines(HELLO, START, failed))
    assert reply.checks[0].raised == Raised(
        type="ValueError", message="wrong", traceback="Traceback ...", blame="library"
    )


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        (b"\n", "not a record: "),
        (b"[]\n", "not a record: Expected `object`, got `array`"),
        (b"\xff\n", "not a record: "),
        (b'{"kind": "start"', "cut short"),
        (b"[" * 100_000 + b"\n", "not a record: "),
        (lines({**PASSED, "facts": "DEEP"})[0].replace(b'"DEEP"', b'{"a":' * 50_000 + b"}" * 50_000), "not a record: "),
        (b'"' + b"x" * (1 << 20) + b'"\n', "longer than 1048576 bytes"),
        (lines({**START, "kind": "other"})[0], "not a record: Invalid value 'other' - at `$.kind`"),
        (lines({**START, "more": 1})[0], "not a record: Object contains unknown field `more`"),
        (lines({**START, "check": "x" * 101})[0], "not a record: Expected `str` of length <= 100 - at `$.check`"),
        (lines({**PASSED, "seconds": float("nan")})[0], "not a record: JSON is malformed: invalid character"),
        (lines({**PASSED, "facts": {"a": float("inf")}})[0], "not a record: JSON is malformed: invalid character"),
        (lines({**PASSED, "facts": "BIG"})[0].replace(b'"BIG"', b'{"a": 1e999}'), "not a record: Number out of range"),
        (lines({**PASSED, "seconds": -1})[0], "not a record: Expected `float` >= 0.0 - at `$.seconds`"),
        (lines({**PASSED, "observed": {**OUTSIDE, "data": 3}})[0], "not a record: Expected `object`, got `int` - at"),
        (lines({**PASSED, "observed": {**OUTSIDE, "code": "x" * 101}})[0], "not a record: Expected `str` of length"),
        (lines({**PASSED, "observed": {**OUTSIDE, "at": "soon"}})[0], "not a record: Expected `int | null`"),
        (lines({**PASSED, "observed": {**OUTSIDE, "got": "x" * 100_001}})[0], "what it observed is longer than 100000"),
        (lines({**PASSED, "observed": {**OUTSIDE, "got": DEEP}})[0], "what it observed is nested too deeply"),
        (lines({**PASSED, "outcome": "crashed"})[0], "not a record: Invalid enum value 'crashed' - at `$.outcome`"),
        (
            lines({"kind": "frame", "check": "r", "which": "first", "path": "../a.npy"})[0],
            "not a record: Expected `str` matching regex",
        ),
        (lines({**START, "seq": 1}, pid=8)[0], "written by process 8, not by 7"),
        (lines({**START, "seq": 0})[0], "record 0 comes again, or too late"),
        (lines({**HELLO, "seq": 1})[0], "a second hello"),
        (lines({**PASSED, "seq": 1})[0], "single.loop ends without having been started"),
    ],
)
def test_refused(line: bytes, problem: str) -> None:
    """An invalid record is left out and reported with its line number; the records before it stay."""
    reply = wire.read_reply([*lines(HELLO), line])
    assert len(reply.problems) == 1
    assert reply.problems[0].startswith(f"reply line 2: {problem}")
    assert (reply.checks, reply.frames, reply.facts) == ((), (), FACTS)


def test_order() -> None:
    """Nothing counts before hello or after the last line, no check starts or ends twice, gaps are named."""
    records = lines(START, HELLO, START, START, PASSED, PASSED, {**END, "seq": 9}, {**START, "seq": 10, "check": "x.y"})
    reply = wire.read_reply(records)
    assert reply.problems == (
        "reply line 1: comes before hello",
        "reply line 4: single.loop starts again",
        "reply line 6: single.loop ends without having been started",
        "reply line 7: 3 record(s) before it are missing",
        "reply line 8: comes after the last line",
    )
    assert [check.outcome for check in reply.checks] == [Outcome.PASSED]
    assert reply.complete


def test_problems_are_bounded() -> None:
    """A flood of rubbish is told in twenty lines, and reading it ends."""
    reply = wire.read_reply(b"rubbish\n" for _ in range(10**9))
    assert len(reply.problems) == 20


def _worker(*records: dict[str, Any], pid: int) -> bytes:
    return b"".join(lines(*({"check": "vector.async.fork", **record} for record in records), pid=pid))


REACHED = [{"kind": "reached", "stage": stage} for stage in ("start", "constructor", "constructed", "reset", "step")]


def _vector(*ends: tuple[int, int | None], ended: bool = True) -> list[bytes]:
    seen = [{"pid": pid, "exit_code": code} for pid, code in ends]
    check = {**PASSED, "check": "vector.async.fork", "outcome": "failed", "raised": RAISED, "workers": seen}
    start = {**START, "check": "vector.async.fork"}
    return lines(HELLO, start, check) if ended else lines(HELLO, start)


def test_workers() -> None:
    """Files of workers join the exit codes that their parent saw; a worker without files has its exit code alone."""
    files = {
        "worker-11.jsonl": _worker(*REACHED, {"kind": "raised", "raised": RAISED, "observed": None}, pid=11),
        "worker-12.jsonl": _worker(*REACHED[:2], pid=12),
        "worker-12.txt": b"Fatal Python error: Segmentation fault\n",
        "worker-12.npy": b"no file of ours",
    }
    reply = wire.read_reply(_vector((11, 0), (12, -11), (13, 1)), files)
    first, second, third = reply.checks[0].workers
    assert (first.pid, first.raised and first.raised.message, first.exit_code, first.reached) == (
        11,
        "wrong",
        0,
        "step",
    )
    assert (second.pid, second.exit_code, second.reached) == (12, -11, "constructor")
    assert second.stacks == "Fatal Python error: Segmentation fault\n"
    assert (third.pid, third.exit_code, third.reached) == (13, 1, None)
    assert reply.problems == ()


def test_workers_outlive_their_parent() -> None:
    """If the parent hung or died, the files of its workers are still read."""
    reply = wire.read_reply(_vector(ended=False), {"worker-11.jsonl": _worker(*REACHED[:2], pid=11)})
    assert [(worker.pid, worker.reached, worker.exit_code) for worker in reply.checks[0].workers] == [
        (11, "constructor", None)
    ]


def test_workers_not_believed() -> None:
    """A worker its parent does not know, of a check that was not started, or under another's name is refused."""
    files = {
        "worker-11.jsonl": _worker(*REACHED, pid=11),
        "worker-12.jsonl": _worker(*REACHED, pid=99),
        "worker-14.jsonl": b"".join(lines({**REACHED[0], "check": "vector.other"}, pid=14)),
        "worker-15.jsonl": _worker(REACHED[0], pid=15)[:-1],
    }
    reply = wire.read_reply(_vector((10, 0)), files)
    assert [worker.pid for worker in reply.checks[0].workers] == [10]
    assert reply.problems == (
        *(f"worker-12.jsonl line {n}: written by process 99, not by 12" for n in range(1, 6)),
        "worker-15.jsonl line 1: cut short",
        "worker 11: its parent does not know it",
        "worker 14: tells of vector.other, which was not started",
    )


def test_request() -> None:
    """A request is plain JSON with everything the cell needs."""
    case = Case(id="c", env="Ant-v5", api="gymnasium", kwargs={"a": [1.5, None]}, timeouts={Phase.SINGLE: 3.0})
    followers = {"single.loop": ("single.state",)}
    request = ProbeRequest(
        case=case, checks=("single.loop",), folder="/f", limits={"single.loop": 3.0}, followers=followers
    )
    told = json.loads(wire.request_to_json(request))
    assert told == {
        "case": {
            "id": "c",
            "env": "Ant-v5",
            "api": "gymnasium",
            "kwargs": {"a": [1.5, None]},
            "checks": [],
            "required": [],
            "imports": [],
            "packages": [],
            "providers": [],
            "beside": [],
            "timeouts": {"single": 3.0},
            "picture": None,
            "bank": None,
            "policy": None,
            "steps": 100,
            "seed": 7,
            "memory_mb": 6000,
        },
        "checks": ["single.loop"],
        "folder": "/f",
        "limits": {"single.loop": 3.0},
        "num_envs": 2,
        "vector_steps": 20,
        "followers": {"single.loop": ["single.state"]},
    }


def test_a_fact_for_later_that_lies_is_a_problem() -> None:
    """It is left out of its check, which is read all the same."""
    record = {**PASSED, "facts": {"trajectory": ["ab"], "values": {"steps": "many"}}}
    reply = wire.read_reply(lines(HELLO, START, record, END))
    assert [(check.outcome, check.facts) for check in reply.checks] == [(Outcome.PASSED, {"trajectory": ["ab"]})]
    assert reply.problems == ("reply line 3: its fact values is left out: Expected `int`, got `str` - at `$.steps`",)


def test_last_words_are_those_of_the_cell() -> None:
    """The host looks for the very line that a probe prints."""
    folder = Path(sys.modules["harness"].__file__ or "").parent / "incell"
    assert f'LAST_WORDS = "{wire.LAST_WORDS}"' in (folder / "cell_records.py").read_text()
