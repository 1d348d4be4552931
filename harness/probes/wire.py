"""Host side of the cell protocol: a request goes in as JSON, a reply comes out as JSON lines, read as hostile data.

The host writes `request_to_json(request)` to a file and starts `python -s .../incell/bootstrap.py FILE` with the cell's
interpreter. In `request.folder`, which exists and is empty, the probe leaves:

- `reply.jsonl`: one record a line, in one write, by the probe's own process. Each has `kind`, `seq` (0, 1, 2, ...) and
  `pid`. Kinds: `hello` first; for each check `start`, then `finding` and `frame` as they come, then `check` (findings
  on warnings and teardown follow it); `end` last, written when the interpreter exits. A check that was started and
  never ended has the outcome None. Some checks (`FOLLOWERS`) follow a passed `single.loop` or `render.rgb_array` in the
  same process without being asked for: they have `start` and `check` records, too. Those that can only find have made
  findings of their exceptions already; only their death or hang is left to the host.
  What is our own to say stands there as `observed`: a code, for which `model/words.toml` has the words, and data;
  findings are all told so, and why a check was skipped, or failed without an exception of a library.
- `NAME.npy`: frames, named by `frame` records.
- `stacks.txt`: faulthandler's: on a fatal signal, and when nine tenths of a check's limit are spent.
- `worker-PID.jsonl`, `worker-PID.txt`: the same from each worker of a vector environment: stages `reached`, the first
  exception `raised`, stacks. They outlive a parent that hangs or dies. Pass the content of these files to `read_reply`.

After a failed `import.*` or `single.*` the probe tries nothing more. `single.repeat` only gives the trajectory, for a
second process to be compared with the one that `single.loop` has among its facts (`trajectory`, a digest for each
step; `values`, see `probes/facts.py`). The facts of `render.rgb_array` hold `pictures`, see there; `loaded`, the
top-level modules that were there at its end, whatever the outcome; and `gl`: `api`, `vendor`, `renderer`, `version`,
`device` of the context that was current after the first frame.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import Meta, Struct

from harness.model import (
    Case,
    CheckReply,
    Finding,
    Level,
    Observation,
    Outcome,
    ProbeReply,
    ProbeRequest,
    Raised,
    WorkerRecord,
    decoding,
    replace,
)
from harness.model.hostile_data import Unreadable, json_object, raise_unreadable, shallow
from harness.model.words import VIOLATION, sentence
from harness.probes.facts import drop_mistyped

LONGEST_LINE = 1 << 20
MOST_LINES = 20_000
MOST_PROBLEMS = 20
LONGEST_STACKS = 60_000
LONGEST_OBSERVED, DEEPEST_OBSERVED = 100_000, 12
"""Bytes of an observation as JSON, and its levels."""

FOLLOWERS: Mapping[str, tuple[str, ...]] = {
    "render.rgb_array": ("render.camera", "render.unclosed"),
    "single.loop": (
        "single.repeat.fresh",
        "single.repeat.same",
        "single.state",
        "single.check_env",
        "single.start_pose",
        "single.contact",
        "single.solver",
        "single.arrays",
    ),
}
"""Checks that follow another without being asked for, by the check that they follow.

Those of `vocabulary.MISLEADING` compare the case with its own specification; the others can only find.
"""

LAST_WORDS = "simmatrix: the last line of the reply is written"
"""What a probe prints after the last line of its reply: what follows was printed while Python took itself apart."""

WORKER_FILE = re.compile(r"worker-(\d{1,9})\.(jsonl|txt)")

Name = Annotated[str, Meta(min_length=1, max_length=100)]
Line = Annotated[str, Meta(max_length=4_000)]
Text = Annotated[str, Meta(max_length=100_000)]


def request(
    case: Case, limits: Mapping[str, float], folder: Path, followers: Iterable[str] | None = None
) -> ProbeRequest:
    """Return the request of these checks, each with its seconds. A check that follows another may take as long.

    `followers` are the checks that are to follow if one passes; all that can if none are named.
    """
    wanted = set(followers_of(limits) if followers is None else followers)
    led = {check: tuple(one for one in FOLLOWERS.get(check, ()) if one in wanted) for check in limits}
    allowed = {**limits, **{name: limits[check] for check, names in led.items() for name in names}}
    return ProbeRequest(case=case, checks=tuple(limits), folder=str(folder), limits=allowed, followers=led)


def request_to_json(request: ProbeRequest) -> str:
    """Return the request as the cell reads it, with the checks that follow those asked for."""
    return json.dumps(msgspec.to_builtins(request, str_keys=True), indent=1)


def followers_of(checks: Iterable[str]) -> tuple[str, ...]:
    """Return the checks that follow these where they pass."""
    return tuple(led for check in checks for led in FOLLOWERS.get(check, ()))


def leader_of(check: str) -> str:
    """Return the check that another one follows, else itself."""
    return next((leader for leader, led in FOLLOWERS.items() if check in led), check)


# --- the records -----------------------------------------------------------------------------------------------


class _Record(Struct, tag_field="kind", forbid_unknown_fields=True, frozen=True, kw_only=True):
    seq: int
    pid: int


class _Raised(Struct, forbid_unknown_fields=True, frozen=True):
    type: Annotated[str, Meta(max_length=1_000)]
    message: Text
    traceback: Text
    blame: Literal["library", "harness"]

    def to_raised(self) -> Raised:
        return Raised(type=self.type, message=self.message, traceback=self.traceback, blame=self.blame)


class _Observed(Struct, forbid_unknown_fields=True, frozen=True):
    code: Name
    at: int | None
    got: Any
    promised: Any
    data: dict[Name, Any]

    def of(self, check: str) -> Observation:
        return Observation(
            check=check, code=self.code, at=self.at, got=self.got, promised=self.promised, data=self.data
        )

    @property
    def refusal(self) -> str | None:
        if not shallow([self.got, self.promised, self.data], DEEPEST_OBSERVED):
            return "what it observed is nested too deeply"
        size = len(msgspec.json.encode(self))
        return f"what it observed is longer than {LONGEST_OBSERVED} bytes" if size > LONGEST_OBSERVED else None


def _violation(observed: Observation) -> Raised:
    """Return the cell's observation as the exception that its check raised, in words."""
    return Raised(type=VIOLATION, message=sentence(observed), traceback="", blame="library")


class _WorkerEnd(Struct, forbid_unknown_fields=True, frozen=True):
    pid: int
    exit_code: int | None


class _Hello(_Record, tag="hello", frozen=True, kw_only=True):
    python: Name
    implementation: Name
    executable: Line


class _Start(_Record, tag="start", frozen=True, kw_only=True):
    check: Name


class _Check(_Record, tag="check", frozen=True, kw_only=True):
    check: Name
    outcome: Literal["passed", "failed", "skipped"]
    seconds: Annotated[float, Meta(ge=0)]
    raised: _Raised | None
    observed: _Observed | None
    workers: Annotated[tuple[_WorkerEnd, ...], Meta(max_length=1_000)]
    facts: dict[str, Any]


class _Finding(_Record, tag="finding", frozen=True, kw_only=True):
    check: Name
    level: Level
    observed: _Observed


class _Frame(_Record, tag="frame", frozen=True, kw_only=True):
    check: Name
    which: Literal["first", "last"]
    path: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_][A-Za-z0-9._-]{0,90}\.npy$")]


class _End(_Record, tag="end", frozen=True, kw_only=True):
    modules: tuple[Name, ...]
    versions: dict[Name, Name]


class _Reached(_Record, tag="reached", frozen=True, kw_only=True):
    check: Name
    stage: Literal["start", "constructor", "constructed", "reset", "step"]


class _WorkerRaised(_Record, tag="raised", frozen=True, kw_only=True):
    check: Name
    raised: _Raised | None
    observed: _Observed | None


_ReplyRecord: TypeAlias = _Hello | _Start | _Check | _Finding | _Frame | _End
_WorkerRecord: TypeAlias = _Reached | _WorkerRaised


# --- reading ---------------------------------------------------------------------------------------------------


def read_reply(lines: Iterable[bytes], files: Mapping[str, bytes] = MappingProxyType({})) -> ProbeReply:
    """Read `reply.jsonl`; `files` are the `worker-*` files beside it, by name.

    What cannot be believed is left out and listed among the problems.
    """
    reading = _Reading()
    sequence = _Sequence(kind=_ReplyRecord, name="reply")
    sequence.read(islice(lines, MOST_LINES), reading.use)
    workers, problems = read_workers(files)
    problems = (*sequence.problems, *problems, *reading.add_workers(workers))
    return ProbeReply(
        checks=tuple(reading.checks.values()),
        findings=tuple(reading.findings),
        frames=tuple(reading.frames),
        during=tuple(reading.during),
        facts=reading.facts,
        modules=reading.modules,
        complete=reading.complete,
        problems=problems[:MOST_PROBLEMS],
    )


def plain_records(text: str) -> Iterator[dict[str, Any]]:
    """Yield the records of a reply, or of a worker's file, as plain objects. Lines that are none are skipped."""
    yield from filter(None, map(json_object, text.splitlines()))


def read_workers(files: Mapping[str, bytes]) -> tuple[tuple[tuple[str, WorkerRecord], ...], tuple[str, ...]]:
    """Read the `worker-*` files: pairs of check and worker in order of pid, and problems."""
    workers: list[tuple[str, WorkerRecord]] = []
    problems: list[str] = []
    names = [match for name in files if (match := WORKER_FILE.fullmatch(name)) and match[2] == "jsonl"]
    for match in sorted(names, key=lambda match: int(match[1])):
        diary = _Diary()
        sequence = _Sequence(kind=_WorkerRecord, name=match[0], pid=int(match[1]))
        sequence.read(files[match[0]].splitlines(keepends=True), diary.use)
        problems += sequence.problems
        stacks = files.get(f"worker-{match[1]}.txt", b"")[:LONGEST_STACKS].decode("utf-8", "replace")
        if diary.check:
            workers.append((diary.check, diary.worker(int(match[1]), stacks)))
    return tuple(workers), tuple(problems[:MOST_PROBLEMS])


@dataclass(slots=True, kw_only=True)
class _Sequence:
    """The records of one process, in their order: none of another process, none twice."""

    kind: Any
    name: str
    pid: int | None = None
    next_seq: int = 0
    problems: list[str] = field(default_factory=list)

    def read(self, lines: Iterable[bytes], use: Callable[[Any], str | None]) -> None:
        """Pass every record that can be believed to `use`, which returns the reason if it refuses one."""
        for number, line in enumerate(lines, start=1):
            where = f"{self.name} line {number}"
            record, refusal = self._decoded(line)
            refusal = refusal or self._out_of_place(where, record) or use(record)
            if refusal:
                self._problem(f"{where}: {refusal}")

    def _problem(self, text: str) -> None:
        if len(self.problems) < MOST_PROBLEMS:
            self.problems.append(text)

    def _decoded(self, line: bytes) -> tuple[Any, str | None]:
        if len(line) > LONGEST_LINE:
            return None, f"longer than {LONGEST_LINE} bytes"
        if not line.endswith(b"\n"):
            return None, "cut short"
        try:
            with raise_unreadable():
                record = decoding.decoder(self.kind).decode(line)
        except Unreadable as error:
            return None, f"not a record: {error}"
        if isinstance(record, _Check) and not shallow(record.facts):
            return None, "its facts are nested too deeply"
        observed = getattr(record, "observed", None)
        return record, observed.refusal if observed else None

    def _out_of_place(self, where: str, record: _Record) -> str | None:
        self.pid = record.pid if self.pid is None else self.pid
        if record.pid != self.pid:
            return f"written by process {record.pid}, not by {self.pid}"
        if record.seq < self.next_seq:
            return f"record {record.seq} comes again, or too late"
        if record.seq > self.next_seq:
            self._problem(f"{where}: {record.seq - self.next_seq} record(s) before it are missing")
        self.next_seq = record.seq + 1
        return None


@dataclass(slots=True)
class _Reading:
    """A reply while it is read."""

    checks: dict[str, CheckReply] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    during: list[str | None] = field(default_factory=list)
    frames: list[tuple[str, str]] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    modules: tuple[str, ...] = ()
    complete: bool = False

    def use(self, record: Any) -> str | None:
        """Take one record. Return the reason if it is refused."""
        if self.complete:
            return "comes after the last line"
        if isinstance(record, _Hello) == bool(self.facts):
            return "a second hello" if self.facts else "comes before hello"
        match record:
            case _Hello(python=python, implementation=implementation, executable=executable):
                self.facts = {"python": python, "implementation": implementation, "executable": executable}
            case _Start():
                return self._start(record)
            case _Check():
                return self._check(record)
            case _Finding(check=check, level=level):
                self.during.append(next(reversed(self.checks), None))
                seen = record.observed.of(check)
                self.findings.append(Finding(check=check, level=level, text=sentence(seen), observed=seen))
            case _Frame():
                self.frames.append((record.check, record.path))
            case _End():
                self.modules, self.complete = record.modules, True
                self.facts["versions"] = record.versions
        return None

    def _start(self, record: _Start) -> str | None:
        if record.check in self.checks:
            return f"{record.check} starts again"
        self.checks[record.check] = CheckReply(check=record.check, outcome=None)
        return None

    def _check(self, record: _Check) -> str | None:
        started = self.checks.get(record.check)
        if started is None or started.outcome is not None:
            return f"{record.check} ends without having been started"
        facts, refusal = drop_mistyped(record.facts)
        outcome, seen = Outcome(record.outcome), record.observed.of(record.check) if record.observed else None
        violation = seen if outcome is Outcome.FAILED and not record.raised else None
        raised = record.raised.to_raised() if record.raised else None
        self.checks[record.check] = CheckReply(
            check=record.check,
            outcome=outcome,
            seconds=record.seconds,
            raised=_violation(violation) if violation else raised,
            reason=sentence(seen) if seen and not violation else None,
            observed=seen,
            workers=tuple(WorkerRecord(pid=end.pid, exit_code=end.exit_code) for end in record.workers),
            facts=facts,
        )
        return refusal

    def add_workers(self, workers: Iterable[tuple[str, WorkerRecord]]) -> Iterator[str]:
        """Merge the records of the workers with what their parent saw of them. Yield problems."""
        for check, worker in workers:
            reply = self.checks.get(check)
            if reply is None:
                yield f"worker {worker.pid}: tells of {check}, which was not started"
                continue
            seen = {end.pid: end for end in reply.workers}
            # A parent that died or hung names no worker; then the files of the workers are all there is.
            if reply.outcome is not None and worker.pid not in seen:
                yield f"worker {worker.pid}: its parent does not know it"
                continue
            exit_code = seen[worker.pid].exit_code if worker.pid in seen else None
            seen[worker.pid] = replace(worker, exit_code=exit_code)
            self.checks[check] = replace(reply, workers=tuple(seen.values()))


@dataclass(slots=True)
class _Diary:
    """The records of one worker, while they are read."""

    check: str | None = None
    reached: str | None = None
    raised: Raised | None = None
    observed: Observation | None = None

    def worker(self, pid: int, stacks: str) -> WorkerRecord:
        """Return the record of the worker as far as it is known."""
        return WorkerRecord(
            pid=pid, raised=self.raised, observed=self.observed, reached=self.reached, stacks=stacks or None
        )

    def use(self, record: Any) -> None:
        """Take one record."""
        self.check = self.check or record.check
        match record:
            case _Reached():
                self.reached = record.stage
            case _WorkerRaised():
                if self.raised is None:
                    self.observed = record.observed.of(record.check) if record.observed else None
                    raised = record.raised.to_raised() if record.raised else None
                    self.raised = _violation(self.observed) if self.observed else raised
