"""Start commands under the supervisor as tests do, and find their processes."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from harness.machine import process
from harness.machine.process import Command, Completed, Limits, Profile

CHECKOUT = Path(process.__file__).parents[2]
KINDS = ("pid+overlay", "subreaper")

Build = Callable[..., Command]


def missing(sandbox: str) -> bool:
    """Tell whether this machine refuses a sandbox."""
    return sandbox != "subreaper" and not process.can_seal(sandbox)


@pytest.fixture(params=KINDS)
def sandbox(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the name of a sandbox: each test that uses it runs with namespaces and without."""
    name: str = request.param
    if missing(name):
        pytest.skip(f"unavailable: {name}")
    monkeypatch.setenv(process.FORCED, name)
    return name


@pytest.fixture
def marker() -> Iterator[str]:
    """Yield a word for an argv, by which processes are found; all of them must be gone after the test."""
    word = f"marker-{uuid.uuid4().hex}"
    yield word
    assert gone(word)


@pytest.fixture
def python(tmp_path: Path) -> Build:
    """Return a function that makes a command which runs Python code in a cell's sandbox."""

    def build(code: str, *words: str, **settings: Any) -> Command:
        home = tmp_path / "home"
        home.mkdir(exist_ok=True)
        limits = {name: settings.pop(name) for name in ("seconds", "memory_mb", "output_kb") if name in settings}
        given: dict[str, Any] = {
            "argv": (sys.executable, "-I", "-S", "-c", code, *words),
            "cwd": tmp_path,
            "env": {"PATH": os.defpath},
            "limits": Limits(**{"seconds": 30.0, **limits}),
            "log": tmp_path / "log",
            "profile": Profile.CELL,
            "home": home,
        }
        return Command(**(given | settings))

    return build


def find_processes(word: str) -> list[int]:
    """Return the ids of living processes with a word in their argv."""
    pids = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if word.encode() in (folder / "cmdline").read_bytes():
                pids.append(int(folder.name))
        except OSError:
            continue
    return pids


def eventually(condition: Callable[[], object]) -> bool:
    """Wait for a condition, ten seconds at most."""
    for _ in range(500):
        if condition():
            return True
        time.sleep(0.02)
    return False


def gone(word: str) -> bool:
    """Tell whether no process with the word is left, after the little while a kill may take."""
    return eventually(lambda: not find_processes(word))


def ending(done: Completed) -> tuple[int | None, int | None, bool, bool, str | None]:
    """Return the values by which two ends of a process can be told apart."""
    return done.exit_code, done.signal, done.timed_out, done.out_of_memory, done.killed


DAEMON = """
import os, sys, time
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        os.execv(sys.executable, [sys.executable, "-I", "-S", "-c", "import time; time.sleep(600)", sys.argv[1]])
    os._exit(0)
os.wait()
"""


def readable_python(folder: Path) -> str:
    """Return an interpreter that every user may run, with the package beside the script."""
    folder.chmod(0o755)
    shutil.copytree(CHECKOUT / "harness", folder / "harness", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "work").mkdir()
    shutil.chown(folder / "work", 65534, 65534)
    folder.chmod(0o777)
    for candidate in (sys.executable, "/usr/bin/python3", "/usr/local/bin/python3"):
        check = "import os, sys; sys.exit(sys.version_info < (3, 11) or not os.access(sys.executable, os.X_OK))"
        words = ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", candidate, "-c", check)
        if subprocess.run(words, capture_output=True, check=False).returncode == 0:
            return candidate
    pytest.skip("unavailable: Python 3.11 that an unprivileged user may run")
