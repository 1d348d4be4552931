"""Environments: made from wheels only, each a pure function of its key, never changed afterwards.

The key of a wheel that was built here is the key of its build, not its hash: builds are not the same to the byte
twice, and two machines, or one after its cache was emptied, are to agree on what an environment is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from time import monotonic

import msgspec
from packaging.specifiers import InvalidSpecifier, SpecifierSet

from harness.machine import process
from harness.machine.files import guarded_files
from harness.machine.files.file_locks import alone, exclusive, mark_used
from harness.machine.files.scratch_folders import remove_folder
from harness.machine.store import cache_folder, digest, open_store, write_atomic
from harness.model import Artifact, Finding, Interpreter, Level, Lock, Outcome, Phase, Question, replace
from harness.model.hostile_data import Unreadable
from harness.packages import download_notice, locks, uv_command, uv_failures
from harness.packages.environments import first_import, site_packages
from harness.packages.environments.environment_damage import CONFIG, PYTHON, find_damage, foundation, replacing
from harness.packages.sources import builds, sdists
from harness.packages.step_failed import StepFailed, install_failed

STAMP = "stamp.json"


@dataclass(frozen=True, kw_only=True, slots=True)
class Environment:
    """An installed environment, ready for use. `installed` maps package names to versions, from the metadata.

    Its folder is named by its key. A number follows where another process uses an unsuitable one there.
    """

    path: Path
    python: Path
    key: str
    installed: Mapping[str, str]
    reused: bool
    seconds: float
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class Wheel:
    """A wheel to install; `mark` is its hash, or the key of the build that made it."""

    name: str
    version: str
    artifact: Artifact
    mark: str


@dataclass(frozen=True, kw_only=True, slots=True)
class _Stamp:
    """The record of a complete environment, written last. Without it the environment is made anew.

    So is an environment whose stamp has another key or another link mode. `odd` are files that were not as RECORD has
    them in a fresh copy already.
    """

    key: str
    link_mode: str
    installed: dict[str, str]
    hashes: tuple[str, ...]
    findings: tuple[Finding, ...]
    foundation: str = ""
    odd: tuple[str, ...] = ()


def mode() -> str:
    """Return uv's link mode: `hardlink` into its cache, or `copy` where a folder cannot be sealed against writes."""
    return "copy" if process.sandbox_mode() == process.UNSEALED else "hardlink"


def environment_key(interpreter: Interpreter, wheels: Iterable[Wheel], compiled: Iterable[str] = ()) -> str:
    """Return the key of an environment, which depends on the interpreter and on each wheel's name, version and mark.

    `compiled` are the marks of what is compiled in it (`first_import.marks`).
    """
    marks = sorted((one.name, one.version, one.mark) for one in wheels)
    return digest("environment", interpreter.identity, marks, *compiled)


def ensure(
    lock: Lock,
    interpreter: Interpreter,
    question: Question,
    *,
    offline: bool = False,
    thorough: bool = False,
    chain: tuple[str, ...] = (),
) -> Environment:
    """Return the environment of a lock, made now or before; sdists of the lock are built first.

    With `thorough` each file of one that is made is held against its hash, not those of Python code only.

    Raises StepFailed: a package that cannot be built or installed is a failed install; an index, a network or a disk
    that fails is infra. `chain` names the packages whose builds wait for this environment.
    """
    started = monotonic()
    wheels = wheels_of(lock, interpreter, question, offline=offline, chain=chain)
    compiled = first_import.marks({one.name for one in wheels}, question)
    key = environment_key(interpreter, wheels, compiled)
    how = _InstallOptions(offline=offline, thorough=thorough)
    environment = _ensure_environment(key, lambda path: _make(path, wheels, interpreter, question, how))
    return replace(environment, seconds=monotonic() - started, findings=(*_built_here(lock), *environment.findings))


def ensure_layer(base: Environment, wheel: Wheel, interpreter: Interpreter) -> Environment:
    """Return a thin environment that holds one wheel and leads on to the environment below it, which is not touched.

    It is found before what lies below, its data and its scripts lie where an install puts them, and children that are
    started in whatever way find both. Raises StepFailed: a wheel that cannot be installed is a failed install.
    """
    started = monotonic()
    # The name of the folder, not the key below: the layer leads on to this very folder.
    key = digest("on top", base.path.name, wheel.mark)
    nothing, how = Question(requirements=()), _InstallOptions(offline=True, below=base.path)
    environment = _ensure_environment(key, lambda path: _make(path, (wheel,), interpreter, nothing, how))
    return replace(environment, seconds=monotonic() - started)


def _ensure_environment(key: str, make: Callable[[Path], _Stamp]) -> Environment:
    """Return the environment of a key, made now if there is no usable one; it stays as long as this process.

    An unusable one is replaced, unless another process uses it (whose files may be links where ours must be copies):
    then it stays, and ours lies beside it.
    """
    return next(environment for path in _places(key) if (environment := _provided_at(path, make)))


def _provided_at(path: Path, make: Callable[[Path], _Stamp]) -> Environment | None:
    # Before the look: from here on neither `gc` nor another process takes the environment away.
    mark_used(path)
    stamp, reused = _usable(path), True
    if stamp is None:
        with exclusive(path.with_name(f"{path.name}.lock")):
            stamp = _usable(path)  # it may have been made while we waited
            if stamp is None:
                if not _cleared(path):
                    return None
                try:
                    stamp, reused = make(path), False
                except StepFailed:
                    remove_folder(path)
                    raise
    return Environment(
        path=path,
        python=path / "bin" / "python",
        key=_key(path),
        installed=stamp.installed,
        reused=reused,
        seconds=0.0,
        findings=stamp.findings,
    )


def _places(key: str) -> Iterator[Path]:
    """Yield the paths where an environment may lie, the usual one first, without those that were found damaged."""
    folder = cache_folder() / "environments"
    places = (folder / (f"{key}-{number}" if number else key) for number in count())
    return (place for place in places if place not in _left)


def _key(path: Path) -> str:
    return path.name.partition("-")[0]


def _cleared(path: Path) -> bool:
    """Make room for an environment, unless another process uses what stands there, or it is not ours to move."""
    if path.exists():
        with uv_command.scratch() as aside, alone(path) as free, suppress(PermissionError):
            if free:
                path.rename(aside / "old")  # in one step: nobody finds half of it
    return not path.exists()


def is_intact(environment: Environment, *, thorough: bool = False) -> bool:
    """Tell whether an environment is still there, with its files as they were installed."""
    stamp = _usable(environment.path)
    return stamp is not None and not {*find_damage(environment.path, thorough=thorough)} - {*stamp.odd}


def discard(environment: Environment, *, used: bool = False) -> None:
    """Withdraw an environment: the next one with its key is made anew, and current users keep this one.

    With `used`, this process itself uses it: then the next one lies in another folder.
    """
    if used:
        _left.add(environment.path)
    with exclusive(environment.path.with_name(f"{environment.path.name}.lock")):
        (environment.path / STAMP).unlink(missing_ok=True)


_left: set[Path] = set()
"""Environments that this process found damaged while it used them."""


# --- wheels ----------------------------------------------------------------------------------------------------


def wheels_of(
    lock: Lock, interpreter: Interpreter, question: Question, *, offline: bool = False, chain: tuple[str, ...] = ()
) -> tuple[Wheel, ...]:
    """Return the wheels of a lock, after building its sdists. Raises StepFailed."""

    wheels = []
    for pin in lock.pins:
        if pin.artifact.is_wheel:
            wheels.append(Wheel(name=pin.name, version=pin.version, artifact=pin.artifact, mark=pin.artifact.sha256))
            continue
        built = builds.build(pin, interpreter, question, ensure, offline=offline, chain=chain)
        # A build may require something else than the metadata that uv resolved by.
        unmet = locks.unmet(sdists.requires_dist(built.path), lock, interpreter, question.overrides)
        if unmet:
            raise install_failed(Outcome.FAILED, f"{pin.name} {pin.version}, once built, {unmet}")
        artifact = Artifact(filename=built.path.name, sha256=built.sha256, source=str(built.path))
        wheels.append(Wheel(name=pin.name, version=pin.version, artifact=artifact, mark=f"build:{built.key}"))
    return tuple(wheels)


def _built_here(lock: Lock) -> Iterator[Finding]:
    for pin in lock.pins:
        if not pin.artifact.is_wheel:
            text = f"{pin.name} {pin.version} has no wheel for this Python and was built from its sdist"
            yield Finding(check="install.built", level=Level.NOTE, text=text)


def _beyond_python(path: Path, interpreter: Interpreter) -> Iterator[Finding]:
    """Yield a warning for each package that does not support this Python: pip refuses it, uv ignores an upper bound."""
    for package in site_packages.installed_packages(path):
        requires_python = str(package.metadata["Requires-Python"]) if "Requires-Python" in package.metadata else ""
        with suppress(InvalidSpecifier):
            if not SpecifierSet(requires_python).contains(interpreter.version, prereleases=True):
                named = f"{package.name} {package.version}"
                text = (
                    f"{named} requires Python {requires_python}: uv installs it on {interpreter.version}, pip refuses"
                )
                yield Finding(check="install.requires_python", level=Level.WARNING, text=text)


# --- making ----------------------------------------------------------------------------------------------------


def _usable(path: Path) -> _Stamp | None:
    """Return the stamp of an environment if its metadata show it as it was made; else None."""
    stamp = guarded_files.load(path / STAMP, _Stamp)
    # Copies suit every sandbox; hard links lead into uv's cache and suit only one that seals them.
    if stamp is None or stamp.key != _key(path) or stamp.link_mode not in {mode(), "copy"}:
        return None
    stable = foundation(path) if stamp.foundation else ""
    try:
        return stamp if stable == stamp.foundation and stamp.installed == site_packages.versions(path) else None
    except Unreadable:
        return None


@dataclass(frozen=True, kw_only=True, slots=True)
class _InstallOptions:
    """The way to make an environment; `below` is another one that it leads on to."""

    offline: bool
    thorough: bool = False
    below: Path | None = None


def _make(
    path: Path, wheels: tuple[Wheel, ...], interpreter: Interpreter, question: Question, how: _InstallOptions
) -> _Stamp:
    """Make an environment in its final folder, since scripts name their interpreter by path; return its stamp."""
    names = {one.name for one in wheels}
    link_mode = "copy" if first_import.recipes(names) else mode()  # what compiles there may not write through links
    if not how.offline:
        download_notice.announce([one.artifact for one in wheels], _known_hashes(path.parent))
    with uv_command.scratch() as scratch:
        call = uv_command.Call(index=question.index, folder=scratch, offline=how.offline)
        log = open_store().evidence(f"install-{path.name}") / "uv.log"
        fill = partial(_fill, call, path, wheels, interpreter, log, link_mode)
        try:
            fill()
        except StepFailed as failed:
            blamed = {one.name for one in wheels if one.artifact.filename in (failed.step.decisive or "")}
            again = failed.step.outcome is Outcome.FAILED and blamed and not how.offline
            # uv may have kept a wheel that a disk has spoiled since.
            if not again or not uv_command.forget(blamed):
                raise
            remove_folder(path)
            fill()
        odd = find_damage(path, thorough=how.thorough)
        if odd and uv_command.forget({*odd.values()}):
            remove_folder(path)
            fill()  # from fresh downloads: what is odd in them is so in the wheels
            odd = find_damage(path, thorough=True)
    versions = _versions(path)
    _compare(versions, {one.name: site_packages.plain(one.version) for one in wheels})
    warmed = first_import.warm(path, names, question)
    if how.below:
        _lead_on(path, how.below)
    stamp = _Stamp(
        key=_key(path),
        link_mode=link_mode,
        installed=versions,
        hashes=tuple(sorted(one.artifact.sha256 for one in wheels)),
        findings=(*_beyond_python(path, interpreter), *_odd(odd), *warmed),
        foundation=foundation(path) or "",
        odd=tuple(odd),
    )
    write_atomic(path / STAMP, msgspec.json.encode(stamp))
    return stamp


def _versions(path: Path) -> dict[str, str]:
    """Return what is installed in an environment by its metadata. Raises StepFailed if that cannot be read."""
    try:
        return site_packages.versions(path)
    except Unreadable as error:
        decisive = f"after the install the metadata of a package cannot be read: {error}"
        raise install_failed(Outcome.INFRA, decisive) from None


def _lead_on(path: Path, below: Path) -> None:
    """Let an environment import what the environment below it has."""
    (site,), (more,) = (list(site_packages.folders(one)) for one in (path, below))
    # With a bare path instead of `addsitedir` the .pth files of the environment below would not run.
    (site / site_packages.LEADS_ON).write_text(f"import site; site.addsitedir({str(more)!r})\n", encoding="utf-8")


def _fill(
    call: uv_command.Call, path: Path, wheels: tuple[Wheel, ...], interpreter: Interpreter, log: Path, how: str
) -> None:
    result = uv_command.create(call, path, interpreter)
    if not result.ok:
        line = result.trouble or uv_failures.failure(result.text, Phase.INSTALL).decisive
        log_path = uv_command.keep_log(result, log)
        decisive = f"no environment could be made for Python {interpreter.version}: {line}"
        raise install_failed(Outcome.INFRA, decisive, log_path)
    if not wheels:
        return
    before = foundation(path)
    pylock = call.folder / "pylock.toml"
    pylock.write_text(locks.format_pylock((one.name, one.version, one.artifact) for one in wheels), encoding="utf-8")
    settings = call.folder / "uv.toml"
    settings.write_text(locks.format_uv_settings(one.artifact for one in wheels), encoding="utf-8")
    result = uv_command.install(call, path / "bin" / "python", pylock, settings, how)
    if not result.ok:
        log_path = uv_command.keep_log(result, log)
        if result.trouble:
            raise install_failed(Outcome.INFRA, result.trouble, log_path)
        raise StepFailed(replace(uv_failures.failure(result.text, Phase.INSTALL), log=log_path))
    # Where a wheel took away its Python, it would be another environment, or find what the lock has not.
    if before != foundation(path):
        package = replacing(path) or "one of its wheels"  # RECORD need not name the file
        decisive = f"{package} replaces {CONFIG} or {PYTHON}, by which the environment is kept apart from others"
        raise install_failed(Outcome.FAILED, decisive)


def _odd(files: Mapping[str, str]) -> Iterator[Finding]:
    for package in sorted({*files.values()}):
        names = [name for name in files if files[name] == package]
        text = f"{len(names)} file(s) of {package} differ from its RECORD in a fresh download, too: {names[0]}"
        yield Finding(check="install.record", level=Level.NOTE, text=text)


def _compare(versions: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    """Raise StepFailed if an environment differs from its lock: what is missing is our fault, the rest a wheel's."""
    missing = [f"{name} {version}" for name, version in wanted.items() if name not in versions]
    other = [f"{name} {versions[name]}" for name in versions if versions[name] != wanted.get(name)]
    if missing:
        decisive = f"after the install these packages of the lock are not there: {', '.join(missing)}"
        raise install_failed(Outcome.INFRA, decisive)
    if other:
        decisive = f"after the install these packages are not those of the lock: {', '.join(other)}"
        raise install_failed(Outcome.FAILED, decisive)


def _known_hashes(folder: Path) -> frozenset[str]:
    """Return the hashes of wheels that environments here were made of: uv's cache holds these already."""
    stamps = (guarded_files.load(path / STAMP, _Stamp) for path in folder.iterdir()) if folder.exists() else ()
    return frozenset(sha256 for stamp in stamps if stamp for sha256 in stamp.hashes)
