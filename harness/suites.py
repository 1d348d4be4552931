"""The subject's own pytest suite, run beside a cell: in an environment of its own, on a clean copy of the source.

The environment holds the cell's packages at the cell's versions and what the tests need besides, so that the cell
itself stays pure. The package is met as it was installed: what it is made of is taken out of the copy.
"""

from __future__ import annotations

import re
import shutil
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from secrets import token_hex

from harness import bytecode, display, launch, normalise, process, pytestsays, sources, subjects
from harness.errors import CouldNotTell
from harness.guarded_files import Folder
from harness.hostile_data import Unreadable
from harness.judging.check import Ending
from harness.model import (
    FAILING,
    CheckRecord,
    Finding,
    Interpreter,
    Level,
    Lock,
    Outcome,
    Phase,
    PhaseRecord,
    Question,
    Step,
    Subject,
    Suite,
)
from harness.pytestsays import Report
from harness.scratch_folders import scratch_folder
from harness.store import Store, now, own_folders, write_atomic
from harness.subjects import TESTS, Ready
from harness.vocabulary import required_name

CHECK = "suite.pytest"
DOOR = launch.INCELL / "bootstrap_suite.py"
PYTEST = "pytest"
MOST_REPORT = 32 << 20
HOST = re.compile(r' hostname="[^"]*"')
"""What pytest's report tells of this machine."""

RUNS_TO_CONFIRM = 3


# --- its packages ----------------------------------------------------------------------------------------------


def question(asked: Question, lock: Lock, subject: Subject, known: Ready, interpreter: Interpreter) -> Question:
    """What is to be resolved for a suite: the cell's question, what the tests need, and every pin of the cell.

    Raises BadInput for an extra or a group that the subject does not have, or a requirement that is the subject.
    """
    suite = subject.suite or Suite()
    subjects.refuse_naming(known.tested.name, suite.requirements, "`suite.extras`")
    lines = (*subjects.wanted(known, interpreter, suite.extras, suite.groups), *suite.requirements)
    tools = () if PYTEST in {required_name(line) for line in lines} else (PYTEST,)
    pins = (f"{name}=={version}" for name, version in lock.versions.items())
    return replace(
        asked,
        requirements=tuple(dict.fromkeys((*asked.requirements, *lines, *tools))),
        constraints=(*asked.constraints, *pins),
        resolution="highest",
    )


def moved(lock: Lock, other: Lock) -> str | None:
    """Which packages of the cell the tests' lock holds at other versions, in words; None where all stand."""
    found = other.versions
    names = [name for name, version in lock.versions.items() if found.get(name) != version]
    told = [f"{name} {found.get(name, 'gone')} instead of {lock.versions[name]}" for name in names]
    return f"the tests ask for {', '.join(told)}" if told else None


def not_run(decisive: str, step: Step) -> PhaseRecord:
    """Return the record of a suite whose environment cannot be made, for the reason that this step gives.

    It is `not_reached` where packages are at fault: the cell keeps the verdict of its cases.
    """
    kept = {Outcome.UNAVAILABLE, Outcome.INFRA}
    outcome = step.outcome if step.outcome in kept else Outcome.NOT_REACHED
    if step.phase is Phase.RESOLVE and step.outcome is Outcome.TIMED_OUT:
        outcome = Outcome.INFRA
    check = CheckRecord(check=f"suite.{step.phase}", outcome=step.outcome, decisive=step.decisive)
    return PhaseRecord(
        phase=Phase.SUITE,
        outcome=outcome,
        decisive=normalise.bounded(decisive),
        checks=(check,),
        evidence=step.log,
        reused=step.reused,
    )


def judging() -> str:
    """Identify what turns a run into an outcome: one judged in another way is measured again."""
    return sources.digest(__name__)


# --- running it ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, slots=True)
class Bench:
    """All that a run of a suite takes. `name` is that of its evidence, `places` this machine's folders."""

    subject: Subject
    known: Ready
    site: launch.Site
    store: Store
    name: str
    places: Mapping[str, str]
    verify: bool = False
    notify: Callable[[str], None] = lambda _: None

    @property
    def suite(self) -> Suite:
        """How it is to be run."""
        return self.subject.suite or Suite()


@dataclass(frozen=True, kw_only=True, slots=True)
class _Ran:
    """How one run ended: what pytest reported, and how its process did."""

    outcome: Outcome
    decisive: str | None
    seconds: float
    evidence: str
    tests: Mapping[str, int] = field(default_factory=dict)
    bad: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()


def measure(bench: Bench) -> PhaseRecord:
    """Run the suite: again with twice the time where that ran out, and where `verify` confirms a failure."""
    ran, attempts = _run(bench, bench.suite.seconds), 1
    if ran.outcome is Outcome.TIMED_OUT:
        ran, attempts = _run(bench, 2 * bench.suite.seconds), 2
    elif bench.verify and ran.outcome in FAILING:
        again = [_run(bench, 2 * bench.suite.seconds) for _ in range(RUNS_TO_CONFIRM - 1)]
        passed = sum(one.outcome is Outcome.PASSED for one in again)
        attempts = RUNS_TO_CONFIRM
        if passed:
            told = f"passed {passed} of {RUNS_TO_CONFIRM} runs; else: {ran.decisive}"
            ran = replace(ran, outcome=Outcome.FLAKY, decisive=told)
    check = CheckRecord(
        check=CHECK,
        outcome=ran.outcome,
        seconds=ran.seconds,
        decisive=ran.decisive,
        facts={"tests": dict(ran.tests), "failed": list(ran.bad)},
    )
    return PhaseRecord(
        phase=Phase.SUITE,
        outcome=ran.outcome,
        seconds=ran.seconds,
        decisive=ran.decisive,
        checks=(check,),
        findings=ran.findings,
        evidence=ran.evidence,
        attempts=attempts,
        measured=now(),
    )


def _run(bench: Bench, seconds: float) -> _Ran:
    bench.notify(Phase.SUITE)
    with scratch_folder() as scratch, Folder(scratch) as left:
        try:
            source = subjects.copied(bench.subject, scratch / "source")
        except CouldNotTell as error:
            return _Ran(outcome=Outcome.INFRA, decisive=str(error), seconds=0.0, evidence="")
        without(source, bench.known)
        site, places = bench.site, {**bench.places, str(source): "$SUBJECT", str(scratch): "$SCRATCH"}
        launch.furnish(site, scratch / "home")
        folder, sealed = launch.entered(site, scratch)
        with site.code(folder, CHECK, bench.known.modules) as code:
            place = _Place(scratch, source, folder, sealed, code)
            ran, shown = _shown(_command(bench, seconds, place), scratch)
        completed = launch.watched(site, folder, ran)
        places |= {**{str(one): "$ENV" for one in (*site.folders, folder)}, **shown}

        def clean(text: str) -> str:
            return normalise.normalise(text, places)

        text = clean(_text(left, completed.log.name))
        report = HOST.sub("", _text(left, "junit.xml"))
        evidence = bench.store.evidence(f"{bench.name}-{token_hex(4)}")
        write_atomic(evidence / "log.txt", text.encode())
        write_atomic(evidence / "junit.xml", clean(report).encode())
        told = Report.read(report)
        ending = _ending(completed, bench.suite, seconds)
        outcome, decisive = _foreign(_text(left, "modules.txt"), source) or pytestsays.outcome(told, ending, text)
        if outcome in FAILING and not site.stands():
            outcome, decisive = Outcome.INFRA, launch.TAKEN_AWAY
        return _Ran(
            outcome=outcome,
            decisive=normalise.bounded(clean(decisive)) if decisive else None,
            seconds=round(completed.seconds, 3),
            evidence=bench.store.relative(evidence),
            tests=told.tests,
            bad=told.bad,
            findings=(*_findings(completed), *([_empty(decisive)] if outcome is Outcome.SKIPPED else [])),
        )


@dataclass(frozen=True, slots=True)
class _Place:
    """The folders of a run: its scratch folder, the copy of the source, and the environment as it sees it."""

    scratch: Path
    source: Path
    folder: Path
    sealed: tuple[Path, ...]
    code: bytecode.Lent


def _command(bench: Bench, seconds: float, at: _Place) -> process.Command:
    site, scratch, folder = bench.site, at.scratch, at.folder
    python = folder / site.python.relative_to(site.folder)
    path = ":".join([str(python.parent), site.variables.get("PATH", "")])
    return process.Command(
        argv=(
            str(python),
            "-s",
            str(DOOR),
            str(scratch / "modules.txt"),
            ",".join(bench.known.modules),
            *bench.suite.arguments,
            "--color=no",
            "-rfE",
            f"--rootdir={at.source}",
            f"--junitxml={scratch / 'junit.xml'}",
        ),
        cwd=at.source,
        env={**site.cached(scratch / "home", at.code), "PATH": path, "VIRTUAL_ENV": str(folder)},
        limits=process.Limits(seconds=seconds, memory_mb=bench.suite.memory_mb),
        log=scratch / "log.txt",
        profile=process.Profile.CELL,
        home=scratch / "home",
        sealed=at.sealed,
        shielded=own_folders(),
        writable=(scratch, *at.code.writable),
    )


def _shown(command: process.Command, scratch: Path) -> tuple[process.Completed, Mapping[str, str]]:
    """Run it at its display, if it has one: how it ended, and what evidence calls the display.

    What a display that died has made of it says nothing.
    """
    try:
        with display.shown(command, scratch / "display") as seen:
            ran, lost = process.run(seen.command), seen.lost()
    except display.NoDisplayError as error:
        return process.unstarted(command, str(error)), {}
    return replace(ran, killed=lost) if lost and ran.exit_code != 0 else ran, seen.places


def without(source: Path, known: Ready) -> None:
    """Take what was installed out of the copy, so that it cannot be met there."""
    for base in {source, source / "src", source / "lib", *_holding(source, known.path)}:
        for module in known.modules:
            if (base / module).is_dir():
                shutil.rmtree(base / module)
            (base / f"{module}.py").unlink(missing_ok=True)


def _holding(source: Path, wheel: Path) -> list[Path]:
    """Folders of the copy that hold most of the wheel's modules as they are in it, wherever the project keeps them."""
    with zipfile.ZipFile(wheel) as archive:
        packed = {
            info.filename: (info.file_size, info.CRC)
            for info in archive.infolist()
            if info.filename.endswith(".py") and info.file_size and not TESTS & {*info.filename.split("/")}
        }
    found: Counter[Path] = Counter()
    for path in source.rglob("*.py"):
        parts = path.relative_to(source).parts
        if not path.is_symlink() and path.is_file() and not TESTS & {*parts}:
            content = path.read_bytes()
            mark = (len(content), zlib.crc32(content))
            found.update(
                source.joinpath(*parts[:at]) for at in range(len(parts)) if packed.get("/".join(parts[at:])) == mark
            )
    return [base for base, count in found.items() if 2 * count > len(packed)]


def _foreign(told: str, source: Path) -> tuple[Outcome, str] | None:
    """Whether a module of the subject was imported from the copy after all: then something else was tested."""
    for line in told.splitlines():
        name, _, path = line.partition("\t")
        if path and Path(path).is_relative_to(source):
            where = Path(path).relative_to(source)
            return Outcome.INFRA, f"the tests import {name} from {where} of the source, not as it is installed"
    return None


def _ending(done: process.Completed, suite: Suite, seconds: float) -> Ending:
    short = f"needs more than the {suite.memory_mb} MB that the suite may have; `suite.memory_mb` raises that"
    return Ending(
        exit_code=done.exit_code,
        signal=done.signal,
        overran=seconds if done.timed_out else None,
        trouble=None if done.timed_out else done.killed or (short if done.out_of_memory else None),
    )


def _empty(decisive: str | None) -> Finding:
    """A suite that says nothing is not passed over in silence."""
    return Finding(check="suite.empty", level=Level.WARNING, text=decisive or "no test ran")


def _findings(completed: process.Completed) -> Iterator[Finding]:
    if completed.written:
        text = f"wrote into its own environment (kept from other runs): {', '.join(completed.written[:5])}"
        yield Finding(check="suite.written", level=Level.WARNING, text=text)
    if completed.stray:
        text = f"left {completed.stray} process(es) behind at its end"
        yield Finding(check="suite.stray", level=Level.WARNING, text=text)


def _text(left: Folder, name: str) -> str:
    """A file that a cell wrote, as far as it is read at all; one that is too long is not."""
    try:
        content = left.head(name, MOST_REPORT + 1)
    except Unreadable:
        return ""
    return content.decode("utf-8", "replace") if len(content) <= MOST_REPORT else ""
