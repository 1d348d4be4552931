"""Causes that a line tells by itself: installers, builds, GPUs, Vulkan, saved objects, missing files."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from harness.standalone.causes import derived_causes
from harness.standalone.causes.scene import Pattern
from harness.standalone.explain.api_history import load_shipped
from harness.standalone.explain.explain_text import Facts, explain_text
from harness.standalone.failures.matching import compile_once

LINES = tomllib.loads((Path(__file__).parent / "derived_lines.toml").read_text(encoding="utf-8"))


def explained(text: str, **here: Any) -> dict[str, Any] | None:
    """Return the most likely cause of a text as its documents have it; None where nothing is derived."""
    cause = explain_text(text, (), Facts(**here)).cause
    return None if cause is None else dict(cause.signature.plain)


@pytest.mark.parametrize("case", LINES["cause"], ids=lambda case: case["line"][:40])
def test_a_line_tells_its_cause(case: dict[str, str]) -> None:
    """The cause is about this package or file, and its text or remedy names what helps."""
    plain = explained(case["line"])
    assert plain is not None
    assert plain["id"] == f"derived:{case['subject']}"
    assert case["words"] in f"{plain['cause']} {plain['remedy']}"


@pytest.mark.parametrize(
    ("line", "python"),
    [
        ("AttributeError: module 'inspect' has no attribute 'getargspec'. Did you mean: 'getargs'?", "<3.11"),
        ("ImportError: cannot import name 'Self' from 'typing' (/usr/lib/python3.10/typing.py)", ">=3.11"),
        ("ModuleNotFoundError: No module named 'imp'", "<3.12"),
        ("AttributeError: 'Thread' object has no attribute 'isAlive'", "<3.9"),
    ],
)
def test_the_library_of_python_has_a_history(line: str, python: str) -> None:
    """Names that came or went with a version of Python lead to it."""
    plain = explained(line, history=load_shipped)
    assert plain is not None
    assert (plain["id"], plain["remedy"]["python"]) == ("derived:python", python)


@pytest.mark.parametrize("line", ["ModuleNotFoundError: No module named 'parser'", "No module named 'utils'"])
def test_a_module_that_users_have_too_accuses_no_python(line: str) -> None:
    """Python had a module `parser` until 3.9, and many projects have one of their own."""
    assert explained(line, history=load_shipped) is None


@pytest.mark.parametrize("case", LINES["own"], ids=lambda case: case["line"][:40])
def test_a_mistake_of_the_users_own_accuses_no_package(case: dict[str, str]) -> None:
    """Nothing ties such a line to a package."""
    assert explained(case["line"]) is None


@pytest.mark.parametrize(
    "text",
    [
        "Release notes: fixed \"AttributeError: 'OrderEnforcing' object has no attribute 'gravity'\".",
        "me: I got \"ModuleNotFoundError: No module named 'mujoco_py'\" yesterday\nthanks, it works now",
        "# Troubleshooting\nIf you see `ImportError: libGL.so.1: cannot open shared object file`, install libgl1.",
    ],
)
def test_a_text_that_only_mentions_a_failure_shows_none(text: str) -> None:
    """Notes, talk and help speak of failures that are over, or that may come."""
    explanation = explain_text(text, ())
    assert not explanation.failure.failed
    assert explanation.causes == ()


def test_a_line_that_begins_with_the_error_is_a_failure() -> None:
    """Somebody asks, and says what did not help."""
    text = "ImportError: libGL.so.1: cannot open shared object file\nI thought this was fixed in the last release"
    assert explained(text) is not None


@pytest.mark.parametrize("line", ["EOFError", "KeyError: 3", "mujoco.FatalError: gladLoadGL error", "pygame not found"])
def test_a_line_that_names_an_exception_is_a_failure(line: str) -> None:
    """Whatever it is called, and though nothing is known of it."""
    assert explain_text(line, ()).failure.failed


def test_a_conflict_names_a_release_that_allows_what_is_there() -> None:
    """Only a release that bounds the package counts: one that no longer requires it allows nothing."""
    line = "stable-baselines3 1.6.2 requires gym==0.21, but you have gym 0.23.1 which is incompatible."
    assert "2.9" not in str(explained(line))


def test_the_environment_at_hand_decides() -> None:
    """A package that is not installed there is not accused, nor a gymnasium that still forwards attributes."""
    line = "AttributeError: 'OrderEnforcing' object has no attribute 'gravity'"
    assert explained(line, installed={"gymnasium": "0.29.1"}) is None
    assert explained(line, installed={"gym": "0.26.2"}) is None
    assert explained(line, installed={"gymnasium": "1.2.3"}) is not None


def patterns() -> list[Pattern]:
    """Return the patterns of all rules."""
    modules = sorted({rule.__module__ for rule, _ in derived_causes.RULES})
    return [value for name in modules for value in vars(sys.modules[name]).values() if isinstance(value, Pattern)]


def test_the_literals_of_a_pattern_are_in_whatever_it_finds() -> None:
    """A text without them is not searched, so that a literal too many would hide a cause."""
    lines = [case["line"] for kind in LINES.values() for case in kind]
    assert len(patterns()) > 50
    for pattern in patterns():
        for line in lines:
            whole = compile_once(pattern.expression).search(line) is not None
            assert whole == (pattern.search(line) is not None), (line, pattern.expression)


def test_a_conflict_names_the_override_that_was_measured() -> None:
    """Others run the release that the requirement excludes; uv has a way to install it."""
    line = "ERROR: gym 0.18.0 has requirement Pillow<=7.2.0, but you'll have pillow 8.1.0 which is incompatible."
    pair = {"asker": "gym", "version": "0.18.0", "package": "pillow", "held": "9.5.0", "cell": "classic/py3.10"}
    others = [{**pair, "asker": "other-package"}, {**pair, "package": "numpy"}]
    notes = [text for _, _, text in explain_text(line, (), Facts(measured={"overrides": [pair, *others]})).findings]
    assert [note for note in notes if "classic/py3.10" in note and "pillow==9.5.0" in note]
    assert not explain_text(line, (), Facts(measured={"overrides": others})).findings


def test_of_many_requirements_the_two_that_exclude_each_other_are_named() -> None:
    """pip lists all that ask for a package; most of them agree."""
    text = """The conflict is caused by:
    The user requested numpy==2.2.5
    robosuite 1.5.2 depends on numpy>=1.13.3
    mink 0.0.5 depends on numpy<2.0.0
"""
    plain = explained(text)
    assert plain is not None
    assert plain["cause"] == "mink 0.0.5 requires numpy<2.0.0, and your command requires numpy==2.2.5"
    assert plain["remedy"] == {"requirements": ["numpy<2.0.0"], "text": "Or install another release of mink."}
