"""A command imports what it needs first: nobody waits for the rest before the first combination is measured."""

from __future__ import annotations

import subprocess
import sys

import pytest

LATER = ("numpy", "PIL", "rich", "jinja2", "harness.reports.publishing", "harness.reports.document", "harness.physics")
"""Modules that only a report needs, or a comparison of physics."""


@pytest.mark.parametrize("verb", ["run", "plan"])
def test_a_command_starts_without_what_it_needs_later(verb: str) -> None:
    """The module of a verb imports nothing that is for its end."""
    code = f"import sys, harness.commands.{verb}; print(*sys.modules)"
    done = subprocess.run((sys.executable, "-c", code), capture_output=True, text=True, check=True)
    assert {*done.stdout.split()} & {*LATER} == set()
