"""Call uv. Only this module knows its binary, its variables, its caches and its commands.

uv sees the index settings of the user and of the matrix and nothing else of the user's: `UV_RESOLUTION`, a `uv.toml`
or a `pyproject.toml` of the working folder would change what is resolved.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from msgspec import Struct, field

from harness.machine import process
from harness.machine.files.file_locks import mark_used
from harness.machine.files.scratch_folders import scratch_folder
from harness.machine.store import cache_folder, state_folder, write_atomic
from harness.model import IndexSettings, Interpreter
from harness.packages import index_settings
from harness.standalone.failures.lines import normalise

DEADLINE = 600.0
"""Seconds for one call of uv; downloads of several GB included."""

PASSED_ON = re.compile(
    r"HOME|PATH|USER|LOGNAME|LANG|LC_\w+|TMPDIR|TZ|XDG_(?:CONFIG_HOME|CONFIG_DIRS|DATA_HOME|RUNTIME_DIR)|NETRC"
    r"|(?:HTTPS?|ALL|NO)_PROXY|(?:https?|all|no)_proxy|SSL_(?:CERT_FILE|CERT_DIR|CLIENT_CERT)|DBUS_SESSION_BUS_ADDRESS"
    r"|UV_(?:KEYRING_PROVIDER|INSECURE_HOST|NATIVE_TLS|SYSTEM_CERTS|HTTP_\w+|REQUEST_TIMEOUT|NO_NETRC|CREDENTIALS_DIR"
    r"|CONCURRENT_\w+)"
)
"""The host's variables that uv keeps: places, logins, proxies, certificates. Everything else could change what a
build that uv starts makes of a package."""


def shared_cache() -> Path:
    """Return uv's cache for everything that does not depend on a build."""
    return cache_folder() / "uv"


class Call(Struct, frozen=True, kw_only=True):
    """The settings of a uv command: package sources, cache, working folder and variables."""

    index: IndexSettings
    folder: Path
    cache: Path = field(default_factory=shared_cache)
    offline: bool = False
    variables: Mapping[str, str] = {}

    @property
    def log(self) -> Path:
        """Return the file that all output of uv goes to."""
        return self.folder / "uv.log"


class Result(Struct, frozen=True, kw_only=True):
    """The result of a uv command: its output (no paths of this machine), and `trouble` if uv did not end by itself."""

    ok: bool
    text: str
    trouble: str | None = None


@contextmanager
def scratch() -> Iterator[Path]:
    """Yield an empty folder on the cache's own disk: uv reads settings from the folder it works in."""
    # Callers rename folders from here into the cache, or out of it, and a rename works on one disk only.
    parent = cache_folder() / "tmp"
    parent.mkdir(exist_ok=True)
    with scratch_folder(parent) as folder:
        yield folder


def compile_lock(call: Call, interpreter: Interpreter, arguments: Iterable[str], output: Path) -> Result:
    """Resolve for an interpreter; uv logs to its output when it looks into an sdist, or cannot read a file."""
    mark_used(call.cache)
    user_index = index_settings.combine(call.index)
    no_index = ("--no-index",) if user_index.no_index else ()
    options = ("--python", interpreter.path, "--no-header", "--output-file", str(output), *no_index)
    # Without this log `uv_failures.met_source` and `uv_failures.unreadable` find nothing.
    variables = {"RUST_LOG": "uv_distribution=debug,uv_resolver=warn"}
    if links := ",".join(_existing(user_index.find_links, call.index)):
        variables["UV_FIND_LINKS"] = links
    return _run(call, ("pip", "compile", *arguments, *options), variables)


def create(call: Call, path: Path, interpreter: Interpreter) -> Result:
    """Make a virtual environment with nothing in it."""
    return _run(call, ("venv", "--python", interpreter.path, "--no-project", str(path)))


def install(call: Call, python: Path, pylock: Path, settings: Path, link_mode: str) -> Result:
    """Install exactly the wheels of a pylock into an environment, with the given uv settings; nothing is built.

    No index is asked for packages; uv is still told of them, since their logins are for the files too.
    """
    mark_used(call.cache)
    options = ("--no-deps", "--no-build", "--preview-features", "pylock", "--link-mode", link_mode)
    return _run(call, ("pip", "install", "--python", str(python), "-r", str(pylock), *options), settings=settings)


def tidy(what: str) -> bool:
    """Let uv `prune` unused entries of its cache, or `clean` it whole; False if it fails, as while another uv works."""
    return _change_cache((what,), patience=10)


def forget(packages: Iterable[str]) -> bool:
    """Remove these packages from uv's cache, so that they are downloaded anew; False if uv fails."""
    # If this fails, an install keeps its damaged files, so another uv is waited for longer than in `tidy`.
    return _change_cache(("clean", *sorted(packages)), patience=60)


def _change_cache(arguments: Iterable[str], *, patience: int) -> bool:
    with scratch() as folder:
        call = Call(index=IndexSettings(), folder=folder, variables={"UV_LOCK_TIMEOUT": str(patience)})
        return _run(call, ("cache", *arguments)).ok


def keep_log(result: Result, log: Path) -> str:
    """Write uv's output to a log; return the log's path below the state folder."""
    write_atomic(log, result.text.encode())
    state = state_folder()
    return log.relative_to(state).as_posix() if log.is_relative_to(state) else log.name


def places() -> dict[str, str]:
    """Return the folders of this machine, each with its name in evidence."""
    return {str(cache_folder()): "$CACHE", str(state_folder()): "$STATE", str(Path.home()): "$HOME"}


def _run(
    call: Call, arguments: Iterable[str], more: Mapping[str, str] | None = None, settings: Path | None = None
) -> Result:
    config = ("--config-file", str(settings)) if settings else ("--no-config",)
    common = (*config, "--quiet", "--no-progress", "--color", "never", *(["--offline"] if call.offline else []))
    completed = process.run(
        process.Command(
            argv=(_binary(), *arguments, *common),
            cwd=call.folder,
            env={**_environment(call), **(more or {})},
            limits=process.Limits(seconds=DEADLINE),
            log=call.log,
            profile=process.Profile.HOST,
        )
    )
    text = normalise(call.log.read_text(encoding="utf-8", errors="replace"), places())
    return Result(ok=completed.exit_code == 0, text=text, trouble=_trouble(completed))


def _trouble(completed: process.Completed) -> str | None:
    """Return why uv did not end by itself; None if it did, which it does with 0, 1 or 2."""
    if completed.timed_out:
        return f"uv did not end within {DEADLINE:g} s; the network may be slow: try again"
    if completed.out_of_memory:
        return "uv ran out of memory"
    if completed.killed:
        return f"uv was ended: {completed.killed}"
    if completed.exit_code not in {0, 1, 2}:
        return f"uv died (exit code {completed.exit_code}, signal {completed.signal})"
    return None


def _environment(call: Call) -> dict[str, str]:
    user_index = index_settings.combine(call.index)
    # uv reads no settings file of the user here: what such files say of trust comes as variables; the shell's own win.
    variables = {**user_index.trust, **{name: value for name, value in os.environ.items() if PASSED_ON.fullmatch(name)}}
    given = {
        "UV_DEFAULT_INDEX": user_index.default,
        "UV_INDEX": " ".join(user_index.extra),
        "UV_INDEX_STRATEGY": user_index.strategy,
        "SSL_CERT_FILE": user_index.certificates,
        "ALL_PROXY": variables.get("ALL_PROXY") or user_index.proxy,
    }
    variables |= {name: value for name, value in given.items() if value}
    # Last, so that no build variable of a matrix moves the cache. Only `interpreters.obtain` may download a Python.
    fixed = {"UV_CACHE_DIR": str(call.cache), "UV_PYTHON_DOWNLOADS": "never"}
    return {**variables, **call.variables, **fixed}


def _existing(links: Iterable[str], index: IndexSettings) -> Iterator[str]:
    """Return the links without absent folders of the user's settings: pip passes those over, uv stops at them."""
    return (link for link in links if "://" in link or link in index.find_links or Path(link).is_dir())


@cache
def _binary() -> str:
    from uv import find_uv_bin  # noqa: PLC0415  (not needed by most commands)

    return str(find_uv_bin())
