"""Write a combination as a command to paste, with its Python and variables as a comment."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from harness.reports.answers.recommending import Combination

PIP, UV = "pip", "uv"
VIRTUAL = ("DISPLAY", "virtual")
"""As cells have it for which a display was started."""


def command(combination: Combination, tool: str = PIP) -> str:
    """Return the command that installs a combination, with what else it needs as a comment."""
    if combination.repaired:
        return f"{_lock_command(combination)}  # {', '.join(_notes(combination))}"
    install = f"pip install {shlex.join(combination.requirements)}"
    if tool == UV:
        install = f"uv venv --python {minor(combination)} && uv {install}"
    return f"{install}  # {', '.join(_notes(combination))}"


def _lock_command(combination: Combination) -> str:
    """Return the command that writes a lock and its patched wheels, which no index has."""
    pins = [f"{name}=={version}" for name, version in combination.versions.items()]
    words = ["simmatrix", "recommend", *pins, "--python", minor(combination), "--lock-out", "requirements.txt"]
    return shlex.join(words)


def _notes(combination: Combination) -> Iterator[str]:
    yield f"Python {minor(combination)}"
    yield from (f"{name}={value}" if value else f"{name} unset" for name, value in variables(combination).items())
    if VIRTUAL in combination.settings.items():
        # `virtual` is our own word for a display and nothing that a person could set.
        yield "a display"
    if combination.repaired:
        yield f"{', '.join(combination.repaired)} as a patched wheel"
    if combination.brought:
        yield f"with {', '.join(combination.brought)}, which no index has"


def variables(combination: Combination) -> dict[str, str]:
    """Return the variables that a person has to set."""
    return {name: value for name, value in combination.settings.items() if (name, value) != VIRTUAL}


def minor(combination: Combination) -> str:
    """Return the Python of a combination, such as `3.11`."""
    return ".".join(combination.python.split(".")[:2])
