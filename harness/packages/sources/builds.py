"""Build wheels of sdists, each once: in an environment of resolved build requirements, under the supervisor.

The store `wheels/KEY/` is keyed by all that decides a wheel: the sdist's hash, the build environment (which is itself
keyed by interpreter and wheels) and the build variables. `wheels/requests/` remembers which key a request led to, so
that a second one resolves nothing.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol
from warnings import simplefilter

from packaging.utils import InvalidWheelFilename, canonicalize_name, parse_wheel_filename
from packaging.version import Version

from harness.machine import process, this_machine
from harness.machine.files import guarded_files
from harness.machine.files.file_locks import exclusive, mark_used
from harness.machine.files.scratch_folders import remove_folder
from harness.machine.store import cache_folder, digest, open_store, sha256_of, write_atomic
from harness.model import Artifact, Interpreter, Outcome, Phase, Pin, Question, Step, replace
from harness.model.errors import BadInput, CouldNotTell
from harness.model.hostile_data import Unreadable, raise_unreadable
from harness.model.machine_trouble import SHOT, machine_trouble
from harness.packages import index, locks, resolver, uv_command
from harness.packages.environments import bytecode
from harness.packages.sources import sdists
from harness.packages.step_failed import StepFailed, install_failed
from harness.standalone.failures.lines import decisive_line, describe_death, normalise, shorten_line

LIMITS = process.Limits(seconds=1800.0)
COMPILER_KILLED = "Killed signal terminated program"
"""The words of gcc where the kernel ended its compiler: for want of memory, if it ended something meanwhile."""

KEY = re.compile(r"[0-9a-f]{32}")
FIXED = {"SOURCE_DATE_EPOCH": "315532800"}
"""The oldest time that a zip file can hold: a build that honours it makes the same wheel twice."""


class Place(Protocol):
    """An environment to build in."""

    @property
    def path(self) -> Path:
        """Return the environment's folder."""

    @property
    def python(self) -> Path:
        """Return the environment's interpreter."""

    @property
    def key(self) -> str:
        """Return the key that names everything the environment depends on."""


Ensure = Callable[..., Place]
"""Makes the environment of a lock (`environments.ensure`, which needs builds itself), or raises StepFailed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Built:
    """A wheel of the store, with the key of its build."""

    path: Path
    sha256: str
    key: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Tree:
    """A source tree that is no sdist: its name, a hash of all its content, and a function that puts it in a folder."""

    name: str
    mark: str
    unpack: Callable[[Path], Path]


@dataclass(frozen=True, kw_only=True, slots=True)
class _Job:
    """One sdist to build, or a source tree that `unpack` puts below a folder.

    `chain` are the packages being built, outermost first, this one last.
    """

    pin: Pin
    interpreter: Interpreter
    question: Question
    ensure: Ensure
    offline: bool
    chain: tuple[str, ...]
    unpack: Callable[[Path], Path] | None = None

    @property
    def title(self) -> str:
        return f"{self.pin.name} {self.pin.version}".rstrip()

    @property
    def request(self) -> str:
        return _request(self.pin, self.interpreter, self.question)

    def failed(self, outcome: Outcome, decisive: str, log: str | None = None) -> StepFailed:
        """Return the error that ends the job with this outcome."""
        return install_failed(outcome, shorten_line(decisive), log)


@dataclass(frozen=True, kw_only=True, slots=True)
class _Bench:
    """The workplace of a job: a scratch folder, the unpacked source, and its `build-system` table."""

    job: _Job
    work: Path
    source: Path
    system: sdists.BuildSystem


class _HookFailed(Exception):
    def __init__(self, completed: process.Completed) -> None:
        super().__init__(completed.log)
        self.completed = completed


def build(
    pin: Pin,
    interpreter: Interpreter,
    question: Question,
    ensure: Ensure,
    *,
    offline: bool = False,
    chain: tuple[str, ...] = (),
) -> Built:
    """Return the wheel of an sdist for this interpreter, made now or before; `ensure` makes the build environments.

    Raises StepFailed: a build that fails is a failed install with the backend's own last word; a network that does is
    infra.
    """
    job = _Job(
        pin=pin, interpreter=interpreter, question=question, ensure=ensure, offline=offline, chain=(*chain, pin.name)
    )
    if pin.name in chain:
        circle = " -> ".join(job.chain)
        raise job.failed(Outcome.FAILED, f"build requirements go in a circle: {circle}")
    return _build_once(job)


def build_tree(
    tree: Tree, interpreter: Interpreter, question: Question, ensure: Ensure, *, offline: bool = False
) -> Built:
    """Return the wheel of a source tree, as `build` does of an sdist; its version is unknown before the build."""
    pin = Pin(name=tree.name, version="", artifact=Artifact(filename="", sha256=tree.mark, source=""), hashes=())
    job = _Job(
        pin=pin,
        interpreter=interpreter,
        question=question,
        ensure=ensure,
        offline=offline,
        chain=(tree.name,),
        unpack=tree.unpack,
    )
    return _build_once(job)


def _build_once(job: _Job) -> Built:
    memory = _memory(job.request)
    with exclusive(memory.with_suffix(".lock")):
        built = recall_wheel(memory)
        if built is None:
            built = _build_job(job)
            write_atomic(memory, built.key.encode())
        return built


def adopt(pin: Pin, interpreter: Interpreter, question: Question, key: str, wheel: Path) -> None:
    """Store a wheel that was built on another machine for this Python as the answer to its request here."""
    memory = _memory(_request(pin, interpreter, question))
    with exclusive(memory.with_suffix(".lock")):
        if recall_wheel(memory) is None:
            write_atomic(cache_folder() / "wheels" / key / wheel.name, wheel.read_bytes())
            write_atomic(memory, key.encode())


def _request(pin: Pin, interpreter: Interpreter, question: Question) -> str:
    """Return a digest of all that a build depends on before its requirements are resolved."""
    inputs = (question.build_constraints, question.build_variables, question.only_binary)
    places = (question.index, question.snapshot)
    return digest("build", pin.artifact.sha256, interpreter.identity, *inputs, *places)


def _memory(request: str) -> Path:
    """Return the file that remembers which key a request led to."""
    return cache_folder() / "wheels" / "requests" / f"{request}.txt"


def recall_wheel(memory: Path) -> Built | None:
    """Return the wheel that a request led to before, if the remembered key and the wheel are whole."""
    try:
        key = guarded_files.text(memory, 100)
    except Unreadable:
        return None
    # The key becomes part of a path: a damaged file must not lead out of the store.
    return load_wheel(key) if KEY.fullmatch(key) else None


def load_wheel(key: str) -> Built | None:
    """Return the wheel of a build if it is in the store; a damaged one is removed, and so built again."""
    folder = cache_folder() / "wheels" / key
    # Before the look, so that `gc` does not take the wheel in between.
    mark_used(folder)
    wheel = next(folder.glob("*.whl"), None)
    if wheel is None:
        return None
    try:
        with raise_unreadable():
            return Built(path=wheel, sha256=_sound(wheel), key=key)
    except Unreadable:
        remove_folder(folder)
        return None


def _sound(wheel: Path) -> str:
    """Return the SHA-256 of a wheel if every file in it is whole. Raises any exception otherwise."""
    if wheel.is_symlink() or not wheel.is_file():
        message = "it is not a regular file"
        raise Unreadable(message)
    mark = sha256_of(wheel)
    # Tried here, since `environments.wheels_of` reads the metadata without a guard.
    sdists.requires_dist(wheel)
    with zipfile.ZipFile(wheel) as archive:
        if broken := archive.testzip():
            raise Unreadable(broken)
    return mark


def _build_job(job: _Job) -> Built:
    with uv_command.scratch() as work:
        try:
            source = job.unpack(work / "source") if job.unpack else _unpacked(job, work)
            system = sdists.build_system(source)
        except CouldNotTell as error:
            raise job.failed(Outcome.INFRA, str(error)) from None
        except sdists.BadSdist as error:
            raise job.failed(Outcome.FAILED, f"{job.title}: {error}") from None
        return _built(_Bench(job=job, work=work, source=source, system=system))


def _unpacked(job: _Job, work: Path) -> Path:
    archive = index.fetch(job.pin.artifact, work / "sdist", job.question.index, offline=job.offline)
    return sdists.unpack(archive, work / "source")


def _built(bench: _Bench) -> Built:
    job = bench.job
    place = _place(job, bench.system.requires)
    more = _call(bench, place, "get_requires_for_build_wheel")
    if more:
        place = _place(job, (*bench.system.requires, *more))
    key = digest("wheel", job.pin.artifact.sha256, place.key, job.question.build_variables)
    built = load_wheel(key)
    if built is None:
        output = bench.work / "wheel"
        output.mkdir()
        _call(bench, place, "build_wheel", str(output))
        _fitting(job, output)
        with suppress(OSError):  # another request may have led to the same build meanwhile
            output.rename(cache_folder() / "wheels" / key)
        built = load_wheel(key)
    if built is None:
        raise job.failed(Outcome.INFRA, f"{job.title}: its wheel could not be put into the cache folder")
    return built


def _place(job: _Job, requires: Sequence[str]) -> Place:
    """Return an environment with the build requirements, resolved under the question's build constraints and cutoff."""
    outer_question = job.question
    question = Question(
        requirements=tuple(requires),
        constraints=outer_question.build_constraints,
        build_constraints=outer_question.build_constraints,
        build_variables=outer_question.build_variables,
        only_binary=outer_question.only_binary,
        index=outer_question.index,
        torch_backend=outer_question.torch_backend,
        snapshot=outer_question.snapshot,
    )
    # `gc` keeps logs of this name as long as the request is remembered.
    folder = open_store().evidence(f"build-{job.request}")
    try:
        lock = resolver.resolve(question, job.interpreter, folder, offline=job.offline)
    except BadInput as error:
        # The package wrote these lines, not the user.
        raise job.failed(Outcome.FAILED, f"{job.title}: its build requirements cannot be read: {error}") from None
    try:
        if isinstance(lock, Step):
            raise StepFailed(lock)
        return job.ensure(lock, job.interpreter, question, offline=job.offline, chain=job.chain)
    except StepFailed as failed:
        decisive = f"{job.title}: its build requirements: {failed.step.decisive}"
        raise StepFailed(replace(failed.step, phase=Phase.INSTALL, decisive=shorten_line(decisive))) from None


def _call(bench: _Bench, place: Place, hook: str, *arguments: str) -> Any:
    """Call one hook of the backend in the build environment, sealed and hidden from the user's settings."""
    from pyproject_hooks import (  # noqa: PLC0415  (not needed by most commands)
        BackendUnavailable,
        BuildBackendHookCaller,
        BuildBackendWarning,
        HookMissing,
        UnsupportedOperation,
    )

    simplefilter("ignore", BuildBackendWarning)  # they are in the log
    job, system = bench.job, bench.system
    log = open_store().evidence(f"build-{job.request}") / f"{hook}.log"

    def run(cmd: Sequence[str], cwd: str | None = None, extra_environ: Mapping[str, str] | None = None) -> None:
        _run(bench, place, log, tuple(cmd), extra_environ or {})

    try:
        caller = BuildBackendHookCaller(
            str(bench.source), system.backend, system.backend_path, run, python_executable=str(place.python)
        )
        return getattr(caller, hook)(*arguments)
    except _HookFailed as failed:
        raise _failure(job, failed.completed, hook) from None
    except (BackendUnavailable, HookMissing, UnsupportedOperation, ValueError) as error:
        reason = decisive_line(getattr(error, "traceback", "")) or str(error)
        raise job.failed(Outcome.FAILED, f"{job.title}: its build backend cannot be used: {reason}") from None


def _run(bench: _Bench, place: Place, log: Path, argv: tuple[str, ...], more: Mapping[str, str]) -> None:
    home = bench.work / "home"
    home.mkdir(exist_ok=True)
    base = this_machine.base_environment()
    path = f"{place.python.parent}:{base['PATH']}"
    given = bench.job.question.build_variables
    # `more` comes last: in it pyproject_hooks names the backend, which no build variable may replace.
    command = process.Command(
        argv=argv,
        cwd=bench.source,
        env={**base, "PATH": path, "VIRTUAL_ENV": str(place.path), **FIXED, **given, **more},
        limits=LIMITS,
        log=log,
        profile=process.Profile.CELL,
        home=home,
        sealed=(place.path,),
        shielded=bytecode.shielded(place.python),
        writable=(bench.work,),
    )
    completed = process.run(command)
    if completed.shot:  # by whatever is short of memory: that may have passed
        completed = process.run(command)
    text = guarded_files.log_text(log)
    hooks = Path(argv[1]).parent  # the script that calls the build backend
    places = {**uv_command.places(), str(place.path): "$ENV", str(bench.work): "$BUILD", str(hooks): "$HOOKS"}
    write_atomic(log, normalise(text, places).encode())
    if completed.exit_code != 0:
        raise _HookFailed(completed)


def _failure(job: _Job, completed: process.Completed, hook: str) -> StepFailed:
    text = guarded_files.log_text(completed.log)
    log = open_store().relative(completed.log)
    if completed.timed_out:
        return job.failed(Outcome.TIMED_OUT, f"{job.title}: {hook} did not end within {LIMITS.seconds:g} s", log)
    if completed.killed or completed.out_of_memory or completed.shot:
        why = completed.killed or (SHOT if completed.shot else f"more than {LIMITS.memory_mb} MB of memory")
        return job.failed(Outcome.INFRA, f"{job.title}: {hook} was ended: {why}", log)
    died = completed.signal and f"{hook}: {describe_death(None, completed.signal, text)}"
    decisive = died or decisive_line(text) or f"{hook} ended with exit code {completed.exit_code}"
    starved = completed.starved and COMPILER_KILLED in text
    trouble = starved or machine_trouble(text, decisive, completed.least_room_mb)
    return job.failed(Outcome.INFRA if trouble else Outcome.FAILED, decisive, log)


def _fitting(job: _Job, folder: Path) -> None:
    """Refuse a build result that is not one wheel of this package, version and Python."""
    files = sorted(path.name for path in folder.iterdir())
    named = f"{job.title}: its build made {', '.join(files) or 'nothing'}"
    try:
        name, version, _, tags = parse_wheel_filename(files[0] if len(files) == 1 else "")
    except InvalidWheelFilename:
        raise job.failed(Outcome.FAILED, f"{named}, which is not one wheel") from None
    foreign = job.pin.version and (name != canonicalize_name(job.pin.name) or version != Version(job.pin.version))
    if foreign:
        raise job.failed(Outcome.FAILED, f"{named}, which is another package or version")
    if not any(tag in locks.tags(job.interpreter) for tag in tags):
        raise job.failed(Outcome.FAILED, f"{named}, which is not for Python {job.interpreter.minor} on this platform")
