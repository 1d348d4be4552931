"""A command imports what it needs first: nobody waits for the rest before the first combination is measured."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

LATER = ("numpy", "PIL", "rich", "jinja2", "harness.reports.publishing", "harness.reports.document", "harness.physics")
"""Modules that only a report needs, or a comparison of physics."""

AFTER_STORE = ("harness.running.scheduler", "harness.machine.this_machine", "harness.probes", "harness.judging")
"""Rooms and modules that `run` needs once its store has answered."""

MATRIX = """
requirements = ["gymnasium==1.2.3"]
[axes]
python = ["3.11"]
[[cases]]
env = "CartPole-v1"
api = "gymnasium"
"""


@pytest.mark.parametrize("verb", ["run", "plan"])
def test_a_command_starts_without_what_it_needs_later(verb: str) -> None:
    """The module of a verb imports nothing that is for its end."""
    code = f"import sys, harness.commands.{verb}; print(*sys.modules)"
    done = subprocess.run((sys.executable, "-c", code), capture_output=True, text=True, check=True)
    assert {*done.stdout.split()} & {*LATER} == set()


def test_a_run_asks_its_store_before_it_imports_what_measures(tmp_path: Path) -> None:
    """Input is read and refused without the modules that run cells."""
    matrix = tmp_path / "few.toml"
    matrix.write_text(MATRIX)
    code = """
import os, sys
from harness import __main__
from harness.machine import store
def asked():
    print(*sys.modules, flush=True)
    os._exit(0)
store.open_store = asked
__main__.main(sys.argv[1:])
"""
    done = subprocess.run(
        (sys.executable, "-c", code, "run", str(matrix), "--offline"), capture_output=True, text=True, check=True
    )
    imported = {*done.stdout.split()}
    assert "harness.machine.store" in imported, done.stderr
    assert imported & {*LATER, *AFTER_STORE} == set()
