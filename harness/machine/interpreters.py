"""Find the Pythons of this machine, and the interpreter for a request such as `3.11`, `host` or a path.

`findpython` names the candidates (PATH, pyenv's and asdf's versions whatever their shims say, uv's and rye's folders)
without starting one. Each candidate is asked once what it is; the answers are kept in the cache folder and hold until
the file changes, so that a later call starts no process.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import sys
import threading
from pathlib import Path

import msgspec
from msgspec import Struct
from packaging.version import InvalidVersion, Version

from harness.machine import python_discovery
from harness.machine.files import guarded_files
from harness.machine.process import Command, Limits, Profile, run
from harness.machine.store import cache_folder, write_atomic
from harness.model import Interpreter, decoding

OLDEST = Version("3.7")
"""The in-cell side speaks Python 3.7 to 3.14; an older interpreter is as good as absent."""

_ASKING = threading.RLock()
_REQUEST = re.compile(r"(?P<name>[a-z]*)[@-]?(?P<number>\d[\da-z.]*?)(?P<threads>t?)")
_MANAGED = re.compile(r"(?:cpython|pypy)-\d+\.\d+\.\w+(?:\+\w+)?-linux-\w+-(?:gnu\w*|musl\w*)")
"""How uv names the folders of Pythons that run wherever they are put."""
_NAMED = re.compile(r"python(\d+\.\d+)[a-z]?")
_MARK = "simmatrix-facts "
_ASK = f"""
import json, platform, sys, sysconfig
value = sysconfig.get_config_var
print({_MARK!r} + json.dumps({{
    "version": platform.python_version(), "build": sys.version, "name": sys.implementation.name,
    "executable": sys.executable, "prefix": sys.prefix, "base_prefix": sys.base_prefix,
    "abi": str(value("SOABI")) + getattr(sys, "abiflags", ""), "platform": sysconfig.get_platform(),
    "free_threaded": bool(value("Py_GIL_DISABLED")), "debug": bool(value("Py_DEBUG"))}}))
"""


class Facts(Struct, frozen=True, kw_only=True):
    """The facts that an interpreter reports about itself."""

    version: str
    build: str
    name: str
    executable: str
    prefix: str
    base_prefix: str
    abi: str
    platform: str
    free_threaded: bool
    debug: bool

    @property
    def implementation(self) -> str:
        """Return `cpython` or `pypy`; a build that takes other wheels has a suffix (`cpython+freethreaded`)."""
        suffixes = ("+freethreaded" * self.free_threaded, "+debug" * self.debug)
        return self.name + "".join(suffixes)


class _CacheEntry(Struct, frozen=True, kw_only=True):
    """Cached facts: they hold for the file of this size and time of change (nanoseconds)."""

    size: int
    changed: int
    facts: Facts


def find(request: str) -> Interpreter | None:
    """Return the interpreter for `3.11` (its newest patch here), `3.11.7`, `3.13t`, `pypy3.10`, `host` or a path.

    `host` is the base of the Python that runs the harness; of a path into a virtual environment it is the base too.
    """
    if request == "host":
        return _at(Path(sys.executable))
    if _is_path(request):
        path = Path(request).expanduser()
        return _at(path / "bin" / "python" if path.is_dir() else path)
    implementation, version = _parse(request)
    if version is None:
        return None
    minor = ".".join(map(str, version.release[:2])) if len(version.release) > 1 else None
    there = (one for one in available(minor) if one.implementation == implementation)
    fitting = [one for one in there if _fits(version, one.version)]
    return max(fitting, key=lambda interpreter: Version(interpreter.version), default=None)


@functools.cache
def available(minor: str | None = None) -> tuple[Interpreter, ...]:
    """Return every Python from 3.7 on that answers here, each base interpreter once, in the order of discovery.

    With a minor (`3.11`), Pythons whose names show another minor are left out and never started.
    """
    paths = (path for path in _candidates() if _may_be(path, minor))
    by_path = {interpreter.path: interpreter for path in paths if (interpreter := _at(path)) is not None}
    return tuple(one for one in by_path.values() if Version(one.version) >= OLDEST)


def look_again() -> None:
    """Forget the Pythons found so far, after one was added."""
    available.cache_clear()
    _candidates.cache_clear()


def forget() -> None:
    """Forget all that this process knows of Pythons, refused downloads among it, as a new process would."""
    look_again()
    _load_cache.cache_clear()
    _install.cache_clear()


def active_version() -> str | None:
    """Return the Python version of the user's environment: `$VIRTUAL_ENV`, `$CONDA_PREFIX` or `./.venv`."""
    for prefix in (os.environ.get("VIRTUAL_ENV"), os.environ.get("CONDA_PREFIX"), ".venv"):
        if prefix and (facts := _facts(Path(prefix).absolute() / "bin" / "python")) is not None:
            return facts.version
    return None


def obtain(request: str, *, offline: bool = False) -> Interpreter | None:
    """Find an interpreter as `find` does; else let uv download it into the cache folder, where that is allowed."""
    interpreter = find(request)
    if interpreter is not None or offline or not _downloadable(request):
        return interpreter
    with _ASKING:
        if _install(request):
            look_again()
    return find(request)


def hint(request: str) -> str:
    """Return the sentence for a cell whose interpreter cannot be had."""
    if _is_path(request):
        return f"there is no Python at {request}; name an executable, or a version such as 3.11"
    version = _parse(request)[1]
    if version is None:
        return f"'{request}' names no Python; write a version such as 3.11 or 3.11.7, host, or a path"
    if _too_old(version):
        return f"python {request} is older than {OLDEST}, the oldest that can be tried"
    why = "uv could not download it" if _downloadable(request) else "uv may not download it"
    return (
        f"python {request} is not on this machine and {why}; "
        f"install it with `uv python install {request}` or pyenv, then run again"
    )


def managed_folder() -> Path:
    """Return the folder into which uv downloads Pythons for the harness; make it if need be."""
    folder = cache_folder() / "pythons"
    folder.mkdir(exist_ok=True)
    return folder


def relocatable(interpreter: Interpreter) -> Path | None:
    """Return the folder of a Python that uv downloaded, which runs wherever it is put; None if it was built here."""
    folder = Path(interpreter.path).parent.parent
    return folder if _MANAGED.fullmatch(folder.name) else None


def _is_path(request: str) -> bool:
    return os.sep in request or request.startswith("~")


def _parse(request: str) -> tuple[str, Version | None]:
    """Return implementation and version of `3.11`, `3.13t`, `pypy3.10`; no version if it cannot be read."""
    match = _REQUEST.fullmatch(request)
    if match is None:
        return "", None
    name = match["name"].replace("cpython", "python").replace("python", "") or "cpython"
    try:
        return name + "+freethreaded" * bool(match["threads"]), Version(match["number"])
    except InvalidVersion:
        return "", None


def _too_old(version: Version) -> bool:
    return version.major < OLDEST.major or (len(version.release) > 1 and version < OLDEST)


def _fits(request: Version, version: str) -> bool:
    """Return whether the version has the parts that were asked for; a patch or a pre-release is asked for exactly."""
    there = Version(version)
    if len(request.release) > 2 or request.is_prerelease:
        return there == request
    return there.release[: len(request.release)] == request.release


def _may_be(path: Path, minor: str | None) -> bool:
    """Return whether a name such as `python3.11` allows this minor, and one that can be tried at all."""
    named = _NAMED.fullmatch(path.name)
    return named is None or (Version(named[1]) >= OLDEST and minor in {None, named[1]})


@functools.cache
def _candidates() -> tuple[Path, ...]:
    return python_discovery.candidates(managed_folder())


def _at(path: Path) -> Interpreter | None:
    """Return the base interpreter behind an executable: itself, or that of a virtual environment or a wrapper."""
    facts = _facts(path)
    if facts is None:
        return None
    base = _base(facts)
    if base != path:
        facts = _facts(base)
        if facts is None:
            return None
    parts = (str(base), facts.build, facts.abi, facts.platform)
    identity = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]
    version = facts.version.removesuffix("+")  # a build from a checkout calls itself 3.14.0+
    return Interpreter(path=str(base), version=version, implementation=facts.implementation, identity=identity)


def _base(facts: Facts) -> Path:
    """Return one path for all names of an interpreter (`python`, `python3.7m`), so that it has one identity."""
    minor = ".".join(facts.version.split(".")[:2])
    stem = "python" if facts.name == "cpython" else facts.name
    common = Path(facts.base_prefix, "bin", f"{stem}{minor}{'t' * facts.free_threaded}")
    alone = facts.debug or not common.exists()  # a debug build shares its prefix with the common one
    return Path(facts.executable if alone else common).resolve()


def _facts(path: Path) -> Facts | None:
    """Return the facts of an executable, from the cache if the file is unchanged; None if it does not answer."""
    try:
        status = path.stat()
    except OSError:
        return None
    with _path_locks.setdefault(path, threading.Lock()):  # other Pythons may be asked meanwhile
        with _ASKING:
            entries = _load_cache()
        entry = entries.get(str(path))
        if entry is not None and (entry.size, entry.changed) == (status.st_size, status.st_mtime_ns):
            return entry.facts
        facts = _ask(path)
        if facts is not None:
            with _ASKING:
                entries[str(path)] = _CacheEntry(size=status.st_size, changed=status.st_mtime_ns, facts=facts)
                write_atomic(_known_file(), msgspec.json.encode(entries))
        return facts


_path_locks: dict[Path, threading.Lock] = {}


def _ask(path: Path) -> Facts | None:
    folder = cache_folder() / "interpreters"
    folder.mkdir(exist_ok=True)
    log = folder / f"{hashlib.sha256(str(path).encode()).hexdigest()[:16]}-{os.getpid()}.log"
    argv = (str(path), "-I", "-c", _ASK)
    try:
        run(_command(argv, folder, log, seconds=30))
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    finally:
        log.unlink(missing_ok=True)
    # A `.pth` file or a `sitecustomize` may print, too, so the answer stands on a line with a mark.
    answers = (line.removeprefix(_MARK) for line in lines if line.startswith(_MARK))
    try:
        return decoding.decoder(Facts).decode(next(answers, ""))
    except msgspec.DecodeError:
        return None


def _command(argv: tuple[str, ...], folder: Path, log: Path, *, seconds: float, **variables: str) -> Command:
    return Command(
        argv=argv,
        cwd=folder,
        env={**os.environ, **variables},
        limits=Limits(seconds=seconds),
        log=log,
        profile=Profile.HOST,
    )


def _known_file() -> Path:
    return cache_folder() / "interpreters.json"


@functools.cache
def _load_cache() -> dict[str, _CacheEntry]:
    return guarded_files.load(_known_file(), dict[str, _CacheEntry]) or {}


def _downloadable(request: str) -> bool:
    """Return whether uv may be asked: a version is meant, and neither downloads nor the network are forbidden to it."""
    allowed = os.environ.get("UV_PYTHON_DOWNLOADS", "").lower() not in {"never", "false", "0"}
    online = os.environ.get("UV_OFFLINE", "").lower() not in {"1", "true"}
    version = None if request == "host" or _is_path(request) else _parse(request)[1]
    return allowed and online and version is not None and not _too_old(version)


@functools.cache
def _install(request: str) -> bool:
    """Let uv download it; asked once per process, since a refusal takes seconds."""
    from uv import find_uv_bin  # noqa: PLC0415  (not needed by most commands)

    folder = managed_folder()
    argv = (find_uv_bin(), "python", "install", "--no-bin", request)
    log = folder / f"install-{request}-{os.getpid()}.log"
    try:
        command = _command(argv, folder, log, seconds=900, UV_PYTHON_INSTALL_DIR=str(folder), UV_NO_PROGRESS="1")
        return run(command).exit_code == 0
    finally:
        log.unlink(missing_ok=True)
