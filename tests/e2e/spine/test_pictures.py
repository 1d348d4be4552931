"""Pictures that are not blank but wrong, and the display that windows need."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commandline import CommandResult, Desk, DeskRun

from harness.machine import display

VIOLATION = "ContractViolation: render() returned "
UNUSABLE = {
    "Floats-v0": VIOLATION + "dtype float32, not uint8",
    "Flat-v0": VIOLATION + "shape (32, 48), not (height, width, 3)",
    "Nothing-v0": VIOLATION + "a NoneType, not an array",
}
WRONG = {
    "UpsideDown-v0": [
        ("render.upside_down", "what is #5a96dc lies below what is #3c7828: the picture is upside down"),
    ],
    "WrongColours-v0": [
        ("render.picture", "nothing in the picture has the colour #5a96dc"),
        ("render.picture", "something in the picture has the colour #dc965a, which a right one never has"),
    ],
    "Constant-v0": [
        (
            "render.constant",
            "the picture never changes: the same over 45 steps while the observations change, and after a reset",
        )
    ],
    "AtResets-v0": [
        (
            "render.stale",
            "the picture stays the same over 45 steps while the observations change, and changes at a reset",
        )
    ],
    "Behind-v0": [
        (
            "render.stale",
            "render() draws an earlier state: asked again, without a step, it draws another picture",
        )
    ],
    "Sky-v0": [],
    "Still-v0": [],
}


@pytest.fixture(scope="session")
def pictures(once: Callable[[str, Callable[[Desk], CommandResult]], DeskRun]) -> DeskRun:
    """Return a run of every wrong picture, and of a window on a display."""
    text = (Path(__file__).parent / "pictures.toml").read_text(encoding="utf-8")
    return once("pictures", lambda desk: desk.run("run", desk.matrix("pictures", text), "--json", "-j", "2"))


def _cases(measured: DeskRun) -> dict[str, dict[str, Any]]:
    cell = measured.ran.cells("drawn")["pictures"]
    return {case["env"].partition(":")[2]: case for case in cell["cases"]}


@pytest.mark.parametrize("env", UNUSABLE)
def test_a_picture_that_cannot_be_used_fails(pictures: DeskRun, env: str) -> None:
    """A picture that is no array, or of another shape or type, fails: a loop that takes pictures stops there."""
    case = _cases(pictures)[env]

    assert (case["checks"]["render.rgb_array"], case["decisive"]) == ("failed", UNUSABLE[env])


@pytest.mark.parametrize("env", WRONG)
def test_a_wrong_picture_is_a_warning(pictures: DeskRun, env: str) -> None:
    """A picture that is wrong but not blank is a warning of its own kind; a right picture has none."""
    found = pictures.ran.cells("drawn")["pictures"]["findings"]
    case = _cases(pictures)[env]

    told = [(one["check"], one["text"]) for one in found if case["case"] in one["cases"]]
    assert told == WRONG[env]
    assert case["checks"]["render.rgb_array"] == "passed"


def test_a_warning_that_is_required_not_to_be_there(pictures: DeskRun) -> None:
    """A matrix that requires pictures to change as the environment moves has a red cell for constant ones."""
    cell = pictures.ran.cells("drawn")["refused"]

    assert (cell["phases"]["render"], cell["decisive"].partition(":")[0]) == ("failed", "render.constant")


def test_a_window_has_a_display(pictures: DeskRun) -> None:
    """A lock that holds pyglet gets our own display; the result records its use, but not its number."""
    if display.program() is None:
        pytest.skip("missing library: xvfb")
    cell = pictures.ran.cells("drawn")["window"]

    assert (cell["verdict"], cell["supplied"]["DISPLAY"]) == ("works", "virtual")
    assert "DISPLAY" not in pictures.ran.cells("drawn")["pictures"]["supplied"]


def test_a_display_that_is_lacking(pictures: DeskRun, desk: Desk) -> None:
    """Without Xvfb drawing in windows is unavailable, with the package that brings Xvfb; the rest works."""
    (desk.folder / "bin").mkdir()
    unshare = shutil.which("unshare")
    if unshare:
        (desk.folder / "bin/unshare").symlink_to(unshare)
    matrix = pictures.desk.folder / "pictures.toml"
    variables = {"PATH": str(desk.folder / "bin"), "DISPLAY": "", "HARNESS_CACHE": str(desk.cache)}

    cell = desk.run("run", matrix, "-k", "*window*", "--json", **variables).cells("drawn")["window"]

    assert (cell["verdict"], cell["unverified"]) == ("works", ["render"])
    assert cell["cases"][0]["decisive"] == (
        "no X display here (no Xvfb): install Debian's xvfb and libgl1-mesa-dri, or run where DISPLAY names an X "
        'server (pyglet.NoSuchDisplayException: Cannot connect to "None")'
    )
    assert "DISPLAY" not in cell["supplied"]
