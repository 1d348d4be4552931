"""Resolve a question for an interpreter: into a lock, or into the step that says why there is none.

Two things uv does not do for us. Its cache of sdist metadata knows nothing of build constraints, build variables or
the Python that built them, so a resolution that looked into an sdist is made again in a cache of its own. And torch
is a GPU build unless it is asked otherwise: ours is a CPU build, where one can be had, unless the question says
otherwise. Elsewhere it is the index's own build: it is larger by gigabytes, and runs without a GPU, too.
"""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name, parse_wheel_filename
from packaging.version import Version

from harness.machine.store import cache_folder, digest
from harness.model import IndexSettings, Interpreter, Lock, Outcome, Phase, Question, Step, replace
from harness.model.errors import CouldNotTell
from harness.packages import index, index_settings, locks, uv_command, uv_failures

TORCH = ("torch", "torchvision", "torchaudio")
"""Packages whose CPU builds are releases of their own, with a local version (`+cpu`)."""

DEFAULT_PRERELEASE = "if-necessary-or-explicit"
"""What uv does when it is told nothing; newer releases call it `if-necessary` and complain of the old name."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Asking:
    """A question being resolved, with its scratch folder and the folder that keeps its log (`folder`)."""

    question: Question
    interpreter: Interpreter
    scratch: Path
    folder: Path
    offline: bool
    options: tuple[str, ...] = ()

    def narrowed(self, constraints: Iterable[str], options: tuple[str, ...] = ()) -> _Asking:
        """Return the same with more constraints and options."""
        question = replace(self.question, constraints=(*self.question.constraints, *constraints))
        return replace(self, question=question, options=(*self.options, *options))

    def call(self, cache: Path) -> uv_command.Call:
        """Return the settings of the uv command that answers it, with this cache."""
        question = self.question
        return uv_command.Call(
            index=question.index,
            folder=self.scratch,
            cache=cache,
            offline=self.offline,
            variables=question.build_variables,
        )


def resolve(question: Question, interpreter: Interpreter, folder: Path, *, offline: bool = False) -> Lock | Step:
    """Answer a question for an interpreter: all packages, pinned and hashed, with the file that it takes of each.

    `folder` (below the state folder) keeps uv's log and, of a lock, the `pylock.toml`. An index, a network or a disk
    that fails is infra, never a verdict; a build that fails is a failed install. Raises BadInput for a requirement
    that is none.
    """
    started = monotonic()
    with uv_command.scratch() as scratch:
        asking = _Asking(question=question, interpreter=interpreter, scratch=scratch, folder=folder, offline=offline)
        answer = _answer(asking)
        if isinstance(answer, Lock):
            _keep(scratch / "pylock.toml", folder)
            answer = _without_absent(answer, asking)
    return answer if isinstance(answer, Lock) else replace(answer, seconds=monotonic() - started)


def restore(
    requirements: str, question: Question, interpreter: Interpreter, folder: Path, *, offline: bool = False
) -> Lock | Step:
    """Find the files of a committed lock in the indexes of today: the same versions, only files with its hashes.

    Of the question, the index settings, builds and torch backend count. Raises BadInput for a text that is no lock.
    """
    pins = locks.read_pins(requirements)
    # The versions are pinned: a cutoff or a rule on pre-releases could only hide files of the lock.
    exact = replace(
        question,
        requirements=tuple(f"{name}=={version}" for name, (version, _) in pins.items()),
        constraints=(),
        overrides=(),
        absent=(),
        prerelease="allow",
        snapshot=None,
    )
    with uv_command.scratch() as scratch:
        asking = _Asking(
            question=exact,
            interpreter=interpreter,
            scratch=scratch,
            folder=folder,
            offline=offline,
            options=("--no-deps",),
        )
        answer = _answer(asking)
        if isinstance(answer, Step):
            return answer
        _keep(scratch / "pylock.toml", folder)
        try:
            return locks.restore(_pylock(scratch), requirements, interpreter, question.snapshot or "")
        except CouldNotTell as error:
            return Step(phase=Phase.RESOLVE, outcome=Outcome.INFRA, decisive=str(error))


def _answer(asking: _Asking) -> Lock | Step:
    backend = asking.question.torch_backend
    if backend not in {"cpu", "any"}:
        return _attempt(replace(asking, options=(*asking.options, "--torch-backend", backend)))
    # `cpu` is the default of every question: the backend, another index, is asked only after a GPU build came.
    answer = _attempt(asking)
    if backend == "cpu" and isinstance(answer, Lock) and _is_gpu(answer) and not _gpu_asked(asking.question):
        return _cpu_build(answer, asking)
    return answer


def _attempt(asking: _Asking) -> Lock | Step:
    """Ask uv once; if it looked into an sdist, ask again in a cache that belongs to the build inputs."""
    result = _compile(asking, uv_command.shared_cache())
    answer = _read(result, asking)
    has_source = isinstance(answer, Lock) and not all(pin.artifact.is_wheel for pin in answer.pins)
    in_doubt = isinstance(answer, Lock) or answer.outcome is not Outcome.INFRA
    if has_source or (in_doubt and uv_failures.met_source(result.text)):
        answer = _read(_compile(asking, _build_cache(asking)), asking)
    return answer


def _compile(asking: _Asking, cache: Path) -> uv_command.Result:
    output = asking.scratch / "pylock.toml"
    output.unlink(missing_ok=True)
    options = (*_options(asking), "--format", "pylock.toml")
    return uv_command.compile_lock(asking.call(cache), asking.interpreter, options, output)


def _options(asking: _Asking) -> Iterator[str]:
    """Yield the command-line options of a question, and write its lists to files."""
    question = asking.question
    lists = {
        "requirements.in": ("", question.requirements),
        "constraints.txt": ("--constraints", question.constraints),
        "overrides.txt": ("--overrides", question.overrides),
        "build-constraints.txt": ("--build-constraints", question.build_constraints),
    }
    for name, (option, lines) in lists.items():
        path = asking.scratch / name
        path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        if lines or not option:
            yield from (part for part in (option, str(path)) if part)
    yield from (part for name in question.only_binary for part in ("--only-binary", name))
    yield from ("--resolution", question.resolution)
    if question.prerelease != DEFAULT_PRERELEASE:
        yield from ("--prerelease", question.prerelease)
    if question.snapshot:
        yield from ("--exclude-newer", question.snapshot)
    yield from asking.options


def _read(result: uv_command.Result, asking: _Asking) -> Lock | Step:
    log = uv_command.keep_log(result, asking.folder / "uv.log")
    trouble = result.trouble or uv_failures.unreadable(result.text)
    if trouble:
        return Step(phase=Phase.RESOLVE, outcome=Outcome.INFRA, decisive=trouble, log=log)
    if not result.ok:
        return replace(_failure(result, asking), log=log)
    try:
        return locks.read(_pylock(asking.scratch), asking.interpreter, asking.question.snapshot or "")
    except CouldNotTell as error:
        return Step(phase=Phase.RESOLVE, outcome=Outcome.INFRA, decisive=str(error), log=log)


def _failure(result: uv_command.Result, asking: _Asking) -> Step:
    """Return the step for uv's failure. An index that lists no file of a package (a login page, say) is no verdict.

    Nor is a failure offline: uv does not always say that it looked only into its caches.
    """
    step = uv_failures.failure(result.text, Phase.RESOLVE)
    if step.outcome is Outcome.FAILED and asking.offline and _is_remote(asking.question.index):
        decisive = f"offline, what the caches hold does not tell; run without --offline: {step.decisive}"
        return replace(step, outcome=Outcome.INFRA, decisive=decisive)
    name = uv_failures.unlisted_package(result.text)
    if step.outcome is not Outcome.FAILED or name is None or asking.offline:
        return step
    try:
        listed = index.releases(name, asking.question.index)
    except index.UnknownPackage:
        return step
    except CouldNotTell as error:
        return replace(step, outcome=Outcome.INFRA, decisive=str(error))
    message = f"the index answers, but lists no file of {name}; check the index settings of uv and pip"
    return step if listed else replace(step, outcome=Outcome.INFRA, decisive=message)


def _is_remote(settings: IndexSettings) -> bool:
    """Return whether packages are looked for on the network."""
    places = index_settings.combine(settings)
    # `https://` stands for the default index, which uv knows by itself.
    indexes = () if places.no_index else (*places.extra, places.default or "https://")
    return any("://" in place and not place.startswith("file:") for place in (*places.find_links, *indexes))


def _pylock(folder: Path) -> dict[str, Any]:
    return tomllib.loads((folder / "pylock.toml").read_text(encoding="utf-8"))


def _keep(pylock: Path, folder: Path) -> None:
    """Put uv's own file, with addresses, where users look for it; git ignores it."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(pylock, folder / "pylock.toml")


def _build_cache(asking: _Asking) -> Path:
    """Return a cache for the metadata of sdists, one for each set of inputs that they may depend on."""
    question = asking.question
    inputs = (question.build_constraints, question.build_variables, question.index, question.snapshot)
    return cache_folder() / "uv-builds" / digest("metadata", asking.interpreter.identity, *inputs)


# --- torch -----------------------------------------------------------------------------------------------------


def _is_gpu(lock: Lock) -> bool:
    version = lock.versions.get("torch")
    return version is not None and not (Version(version).local or "").startswith("cpu")


def _gpu_asked(question: Question) -> bool:
    """Return whether a requirement itself names a local version that is no CPU build (`torch==2.6.0+cu126`)."""
    lines = (*question.requirements, *question.constraints, *question.overrides)
    return any(re.match(r"torch\b[^#;]*==[^#;]*\+(?!cpu)\w", line) for line in lines)


def _cpu_build(gpu: Lock, asking: _Asking) -> Lock | Step:
    """Resolve anew with a CPU build: from a find-links folder, else from uv's backend, which is another index.

    Where neither has one, return the lock with the index's own build, as a user gets it who asks for `torch`.
    """
    for version in _found_builds(asking):
        answer = _attempt(asking.narrowed([f"torch=={version}"]))
        if isinstance(answer, Lock) or answer.outcome is not Outcome.FAILED:
            return answer
    chosen = {name: version for name, version in gpu.versions.items() if name in TORCH}
    # The cutoff is off for the backend's undated files: their versions are those that were chosen under it.
    undated = (part for name in chosen for part in ("--exclude-newer-package", f"{name}=false"))
    same = [f"{name}=={Version(version).public}" for name, version in chosen.items()]
    answer = _attempt(asking.narrowed(same, ("--torch-backend", "cpu", *undated)))
    if isinstance(answer, Lock) and not _is_gpu(answer):
        return answer
    return _attempt(asking)  # once more, for its files: those of the last attempt are kept


def _found_builds(asking: _Asking) -> list[Version]:
    """Return the CPU builds of torch in find-links folders that fit the interpreter, newest first."""
    supported_tags = locks.tags(asking.interpreter)
    versions = set()
    for folder in map(Path, index_settings.combine(asking.question.index).find_links):
        for path in folder.glob("torch-*+cpu*.whl"):
            _, version, _, tags = parse_wheel_filename(path.name)
            if any(tag in supported_tags for tag in tags):
                versions.add(version)
    return sorted(versions, reverse=True)


# --- packages that are to be absent ----------------------------------------------------------------------------


def _without_absent(lock: Lock, asking: _Asking) -> Lock | Step:
    present = [name for name in map(canonicalize_name, asking.question.absent) if name in lock.versions]
    if not present:
        return lock
    name = present[0]
    askers = _askers(name, asking)
    decisive = f"{name} is to be absent, but {askers} it"
    return Step(phase=Phase.RESOLVE, outcome=Outcome.FAILED, decisive=decisive)


def _askers(name: str, asking: _Asking) -> str:
    """Say who requires a package, from the notes that uv writes behind the lines of a requirements file."""
    if any(_name(line) == name for line in asking.question.requirements):
        return "the requirements name"
    output = asking.scratch / "requirements.txt"
    options = (*_options(asking), "--annotation-style", "line")
    uv_command.compile_lock(asking.call(uv_command.shared_cache()), asking.interpreter, options, output)
    text = output.read_text(encoding="utf-8") if output.exists() else ""
    note = re.search(rf"(?m)^{re.escape(name)}==\S+\s+# via (.+)$", text)
    by = [part.strip() for part in note[1].split(",")] if note else ["another package"]
    return f"{' and '.join(by)} require{'s' if len(by) == 1 else ''}"


def _name(line: str) -> str | None:
    try:
        return canonicalize_name(Requirement(line).name)
    except InvalidRequirement:
        return None
