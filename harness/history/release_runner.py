"""Import the modules of an unpacked release in a Python of this machine, for what only running tells."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from packaging.version import Version

from harness.history import describe_release, release_reader
from harness.machine import process
from harness.machine.store import cache_folder, digest
from harness.model import Interpreter
from harness.model.errors import CouldNotTell

SECONDS = 300.0
"""The time that a command may take: an environment, or the import of one release."""

OLD_NUMPY, NEW_PYTHON = "numpy<1.24", 12
"""The NumPy of old releases, and the first minor version of Python that has no such NumPy."""


def run(folder: Path, modules: Sequence[str], python: Interpreter, helpers: Sequence[str]) -> dict[str, Any] | None:
    """Return what importing modules of an unpacked release tells; None if the interpreter did not come to an end.

    Raises CouldNotTell if an environment with the helpers cannot be made.
    """
    home = _environment(python, helpers, numpy="numpy" not in modules)
    return describe(folder, str(home / "bin" / "python"), modules)


def describe(folder: Path, python: str, modules: Sequence[str]) -> dict[str, Any] | None:
    """Return what importing modules tells in a Python, those of a folder first; None if it did not come to an end."""
    answer = folder.with_name("answer.json")
    program, source = str(describe_release.__file__), str(release_reader.source_root(folder))
    _call(folder, python, "-B", "-W", "ignore", program, str(answer), source, *modules)
    try:
        answers: dict[str, Any] = msgspec.json.decode(answer.read_bytes())
    except (OSError, msgspec.DecodeError):
        return None
    return answers


def _call(folder: Path, *argv: str) -> process.Completed:
    limits = process.Limits(seconds=SECONDS)
    log, profile = folder.with_name("log.txt"), process.Profile.HOST
    return process.run(process.Command(argv=argv, cwd=folder, env=os.environ, limits=limits, log=log, profile=profile))


def _environment(python: Interpreter, helpers: Sequence[str], *, numpy: bool) -> Path:
    """Return an environment that has what releases need to be imported. Raises CouldNotTell."""
    wanted = [*helpers, OLD_NUMPY] if numpy else [name for name in helpers if not name.startswith(("scipy", "imageio"))]
    home = cache_folder() / "history" / f"python-{digest(python.version, wanted)[:16]}" / "home"
    if not (home.parent / "done").exists():
        if Version(python.version).minor >= NEW_PYTHON:
            wanted = [re.split("[<=>]", name)[0] for name in wanted]
        home.parent.mkdir(parents=True, exist_ok=True)
        venv = _call(home.parent, "uv", "venv", "-q", "--clear", "-p", python.path, str(home))
        install = ("uv", "pip", "install", "-q", "--only-binary", ":all:", "-p", str(home / "bin" / "python"))
        if venv.exit_code or _call(home.parent, *install, *wanted).exit_code:
            message = f"no environment could be made with Python {python.version}; see {home.parents[1] / 'log.txt'}"
            raise CouldNotTell(message)
        (home.parent / "done").touch()
    return home
