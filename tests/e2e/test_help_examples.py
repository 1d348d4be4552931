"""The examples of `--help`: those that need no network and no file of a user run as they are printed."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from harness.commands.verb_help import HELP_OF_VERBS

ELSEWHERE = {"simmatrix site --out site"}
"""Commands that another test runs: `test_site.py` builds the whole site."""
COMMANDS = [
    example.command
    for entry in HELP_OF_VERBS.values()
    for example in entry.examples
    if not example.needs and example.command not in ELSEWHERE
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder in which nothing was measured."""
    return tmp_path_factory.mktemp("examples")


def test_some_examples_need_nothing() -> None:
    """Most verbs that only read have one."""
    verbs = {command.split()[1] for command in COMMANDS}
    assert {"explain", "known", "recommend", "show", "plan", "report", "ci", "gc", "schema", "doctor"} <= verbs


@pytest.mark.parametrize("command", COMMANDS)
def test_an_example_works(command: str, folder: Path) -> None:
    """It ends with 0, and prints something or writes the file that it names."""
    words = shlex.split(command)
    own = {"HARNESS_CACHE": str(folder / "cache"), "HTTPS_PROXY": "http://127.0.0.1:9"}
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, **own, "PYTHONPATH": root}
    command_line = [sys.executable, "-m", "harness", *words[1:]]
    ran = subprocess.run(command_line, cwd=folder, env=environment, capture_output=True, text=True, check=False)

    assert ran.returncode == 0, ran.stderr
    assert "Traceback" not in ran.stderr
    written = [folder / words[place + 1] for place, word in enumerate(words) if word in {"--out", "--lock-out"}]
    assert ran.stdout or written
    assert all(path.exists() for path in written), ran.stdout + ran.stderr
