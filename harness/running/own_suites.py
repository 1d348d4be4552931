"""Run the subject's own pytest suite beside a cell: in an environment of its own, on a clean copy of the source.

The environment holds the cell's packages at the cell's versions and the other packages that the tests need, so that the
cell itself stays pure. The tests import the package as it was installed: its modules are removed from the copy.
"""

from __future__ import annotations

import re
import shutil
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.judging.runs.suite import CHECK, SOURCE
from harness.machine import display, process
from harness.machine.files.guarded_files import Folder
from harness.machine.files.scratch_folders import scratch_folder
from harness.machine.store import now
from harness.model import (
    CheckRecord,
    Interpreter,
    Lock,
    Outcome,
    Phase,
    PhaseRecord,
    Question,
    Step,
    Subject,
    Suite,
    replace,
)
from harness.model.errors import CouldNotTell
from harness.model.hostile_data import Unreadable
from harness.model.vocabulary import required_name
from harness.packages import package_under_test
from harness.packages.package_under_test import TESTS, SubjectWheel
from harness.probes import launch
from harness.probes.evidence import JUNIT, LOG, MODULES, Host, ProbeRun, Request, RunEnd
from harness.probes.measure import end_of
from harness.probes.vault import Vault, keep_files
from harness.standalone.failures.lines import normalise, shorten_line

DOOR = launch.INCELL / "bootstrap_suite.py"
PYTEST = "pytest"
MOST_REPORT = 32 << 20
HOST = re.compile(r' hostname="[^"]*"')
"""What pytest's report tells of this machine."""

# --- its packages ----------------------------------------------------------------------------------------------


def question(
    cell_question: Question, lock: Lock, subject: Subject, package: SubjectWheel, interpreter: Interpreter
) -> Question:
    """Return the question to resolve for a suite: the cell's question, the needs of the tests, every pin of the cell.

    Raises BadInput for an extra or a group that the subject does not have, or a requirement that is the subject.
    """
    suite = subject.suite or Suite()
    package_under_test.refuse_naming(package.tested.name, suite.requirements, "`suite.extras`")
    lines = (
        *package_under_test.list_requirements(package, interpreter, suite.extras, suite.groups),
        *suite.requirements,
    )
    tools = () if PYTEST in {required_name(line) for line in lines} else (PYTEST,)
    pins = (f"{name}=={version}" for name, version in lock.versions.items())
    return replace(
        cell_question,
        requirements=tuple(dict.fromkeys((*cell_question.requirements, *lines, *tools))),
        constraints=(*cell_question.constraints, *pins),
        resolution="highest",
    )


def describe_version_changes(lock: Lock, other: Lock) -> str | None:
    """Return a sentence on packages that the tests' lock has at other versions than the cell's; None for none."""
    versions = other.versions
    names = [name for name, version in lock.versions.items() if versions.get(name) != version]
    changes = [f"{name} {versions.get(name, 'gone')} instead of {lock.versions[name]}" for name in names]
    return f"the tests ask for {', '.join(changes)}" if changes else None


def not_run(decisive: str, step: Step) -> PhaseRecord:
    """Return the record of a suite whose environment cannot be made, for the reason that this step gives.

    It is `not_reached` where packages are at fault: the cell keeps the verdict of its cases.
    """
    blameless = {Outcome.UNAVAILABLE, Outcome.INFRA}
    outcome = step.outcome if step.outcome in blameless else Outcome.NOT_REACHED
    if step.phase is Phase.RESOLVE and step.outcome is Outcome.TIMED_OUT:
        outcome = Outcome.INFRA
    check = CheckRecord(check=f"suite.{step.phase}", outcome=step.outcome, decisive=step.decisive)
    return PhaseRecord(
        phase=Phase.SUITE,
        outcome=outcome,
        decisive=shorten_line(decisive),
        checks=(check,),
        evidence=step.log,
        reused=step.reused,
    )


# --- running it ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, slots=True)
class Bench:
    """Everything that a run of a suite needs; `places` maps this machine's folders to their names in evidence."""

    subject: Subject
    package: SubjectWheel
    site: launch.Site
    vault: Vault
    host: Host
    places: Mapping[str, str]

    @property
    def suite(self) -> Suite:
        """Return the suite's settings."""
        return self.subject.suite or Suite()

    def measure(self, request: Request, key: str) -> str:
        """Run the suite, keep what it showed as an answer to a key, and return the run's name."""
        with scratch_folder() as scratch, Folder(scratch) as left:
            try:
                source = package_under_test.copy_source(self.subject, scratch / "source")
            except CouldNotTell as error:
                host = replace(self.host, source=str(error))
                # Kept as a run, too: judging makes infra of `source`, which the next run measures again.
                return self._store_run(request, key, RunEnd(), host, {})
            remove_modules(source, self.package)
            end, host, texts = self._ran(request.limits[CHECK], scratch, source, left)
        return self._store_run(request, key, end, host, texts)

    def _ran(self, seconds: float, scratch: Path, source: Path, left: Folder) -> tuple[RunEnd, Host, dict[str, bytes]]:
        site = self.site
        with launch.set_up(site, scratch, CHECK, self.package.modules) as place:
            ran, lost, shown = _shown(_command(self, seconds, place, source), scratch)
        completed = launch.run_watched(place, ran)
        environments = {str(one): "$ENV" for one in (*site.folders, place.folder)}
        places = {**self.places, str(source): SOURCE, str(scratch): "$SCRATCH", **environments, **shown}

        def clean(text: str) -> str:
            return normalise(text, places)

        texts = {name: HOST.sub("", _text(left, name)) for name in (LOG, JUNIT, MODULES)}
        end = end_of(completed, clean, lost=lost)
        # Only a failure is excused by an environment that was changed, and looking through its files takes time.
        stood = completed.exit_code == 0 or site.stands()
        cleaned = {name: clean(text).encode() for name, text in texts.items() if text}
        return end, replace(self.host, stood=stood), cleaned

    def _store_run(self, request: Request, key: str, end: RunEnd, host: Host, texts: Mapping[str, bytes]) -> str:
        run = ProbeRun(
            request=request,
            program={CHECK: launch.file_hash(DOOR)},
            end=end,
            host=host,
            files=keep_files(self.vault, texts),
            measured=now(),
        )
        return self.vault.put(run, key)


def _command(bench: Bench, seconds: float, place: launch.Workplace, source: Path) -> process.Command:
    scratch = place.scratch
    arguments = (
        "-s",
        str(DOOR),
        str(scratch / MODULES),
        ",".join(bench.package.modules),
        *bench.suite.arguments,
        "--color=no",
        "-rfE",
        f"--rootdir={source}",
        f"--junitxml={scratch / JUNIT}",
    )
    limits = process.Limits(seconds=seconds, memory_mb=bench.suite.memory_mb)
    python = place.folder / bench.site.python.relative_to(bench.site.folder)
    path = ":".join([str(python.parent), bench.site.variables.get("PATH", "")])
    return place.command(arguments, limits, source, PATH=path, VIRTUAL_ENV=str(place.folder))


def _shown(command: process.Command, scratch: Path) -> tuple[process.Completed, str | None, Mapping[str, str]]:
    """Run a command at its display, if it has one.

    Return how the command ended, how the display ended (None if it lasted), and the names that evidence uses for the
    display.
    """
    try:
        with display.open_display(command, scratch / "display") as seen:
            return process.run(seen.command), seen.lost(), seen.places
    except display.NoDisplayError as error:
        return process.not_started(command, str(error)), None, {}


def remove_modules(source: Path, package: SubjectWheel) -> None:
    """Remove the installed modules from the copy, so that the tests cannot import them there."""
    for base in {source, source / "src", source / "lib", *_holding(source, package.path)}:
        for module in package.modules:
            if (base / module).is_dir():
                shutil.rmtree(base / module)
            (base / f"{module}.py").unlink(missing_ok=True)


def _holding(source: Path, wheel: Path) -> list[Path]:
    """Return the folders of the copy that hold most of the wheel's modules unchanged, wherever these are kept."""
    with zipfile.ZipFile(wheel) as archive:
        # A zip lists size and CRC of its files: nothing is unpacked. Empty files match anywhere, and so prove nothing.
        packed = {
            info.filename: (info.file_size, info.CRC)
            for info in archive.infolist()
            if info.filename.endswith(".py") and info.file_size and not TESTS & {*info.filename.split("/")}
        }
    counts: Counter[Path] = Counter()
    for path in source.rglob("*.py"):
        parts = path.relative_to(source).parts
        if not path.is_symlink() and path.is_file() and not TESTS & {*parts}:
            content = path.read_bytes()
            mark = (len(content), zlib.crc32(content))
            counts.update(
                source.joinpath(*parts[:at]) for at in range(len(parts)) if packed.get("/".join(parts[at:])) == mark
            )
    return [base for base, count in counts.items() if 2 * count > len(packed)]


def _text(left: Folder, name: str) -> str:
    """Return the text of a file that a cell wrote; empty if it cannot be read or is too long."""
    try:
        content = left.head(name, MOST_REPORT + 1)
    except Unreadable:
        return ""
    return content.decode("utf-8", "replace") if len(content) <= MOST_REPORT else ""
