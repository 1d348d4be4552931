"""Test which EGL device is drawn on: the functions of `rendering` against measurements, and with several devices."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

import harness
from harness.devices.egl_rules import ARGUMENT, Choice, Device, Settings, Stage, choose_device

ROOT = Path(harness.__file__).parent.parent
REPORT = ROOT / "reports/robosuite-egl/report.json"
CELLS = json.loads(REPORT.read_text())["cells"] if REPORT.exists() else []
ABOUT_DEVICES = {
    one["id"].partition("/")[2]: one
    for one in CELLS
    if one["environment"].get("MUJOCO_GL") != "osmesa" and "PYOPENGL_PLATFORM" not in one["environment"]
}
SETTINGS = tomllib.loads((ROOT / "matrices/robosuite-egl.toml").read_text())["axes"]["settings"]
WRONG = "ContractViolation"
SEVERAL = [Device(cuda=1), Device(cuda=0), Device()]
"""Two GPUs that CUDA counts the other way round, and a software device."""


def settings_of(case: dict[str, Any], environment: dict[str, str]) -> tuple[Settings, str]:
    """Return the settings that a case asks for, and the library that draws."""
    found = re.fullmatch(r"device-(\d)", case["case"])
    library = "robosuite" if case["env"].startswith("robosuite:") else case["case"]
    return Settings(
        argument=int(found[1]) if found else None,
        egl=environment.get("MUJOCO_EGL_DEVICE_ID"),
        cuda=environment.get("CUDA_VISIBLE_DEVICES"),
    ), library


@pytest.mark.parametrize("cell", ABOUT_DEVICES or [None], ids=str)
def test_the_rules_predict_every_measured_cell(cell: str | None) -> None:
    """The rules predict the device of each case, or its error and the phase in which it is raised."""
    if cell is None:  # the report is missing, which another test tells
        return
    compare(ABOUT_DEVICES[cell])


def compare(cell: dict[str, Any]) -> None:
    """Compare each case of a cell with its prediction."""
    empty = () if cell["change"] else SETTINGS[cell["axes"]["settings"]].get("empty", ())
    given = {name: value for name, value in cell["environment"].items() if value}
    environment = {**given, **dict.fromkeys(empty, "")}
    for case in cell["cases"]:
        settings, library = settings_of(case, environment)
        installed = cell["installed"]
        release = installed["dm-control" if library == "dm_control" else library]
        choice = choose_device(library, release, settings, [Device()], installed.get("mujoco"))
        assert result_of(case) == expected(choice, library, settings)


def result_of(case: dict[str, Any]) -> tuple[str, str | None]:
    """Return the phase in which a case failed, or the device it drew on, and the line that says why."""
    checks = case["checks"]
    failed = next((check for check, outcome in checks.items() if outcome == "failed"), "")
    got = case.get("told", {}).get("render.device", {}).get("got", {})
    return (failed.partition(".")[0] or f"drew on {got.get('index')}"), case["decisive"]


def expected(choice: Choice, library: str, settings: Settings) -> tuple[str, str | None]:
    """Return the phase or device, and the line, that the rules predict."""
    if choice.error:
        imported = choice.stage is Stage.IMPORT and library != "gymnasium"
        phase = "import" if imported else "single" if choice.stage is Stage.IMPORT else "render"
        return phase, choice.error
    asked = settings.argument if settings.argument is not None else settings.egl
    if not str(asked).strip().isdigit() or int(str(asked)) == choice.device:
        return f"drew on {choice.device}", None
    name = ARGUMENT if settings.argument is not None else "MUJOCO_EGL_DEVICE_ID"
    if choice.device is None:
        return "render", f"{WRONG}: asked for device {asked} by {name}={asked}, drew by osmesa, which knows no devices"
    others = {"MUJOCO_EGL_DEVICE_ID": settings.egl, "CUDA_VISIBLE_DEVICES": settings.cuda}
    right = [
        f"{other}={value}"
        for other, value in others.items()
        if str(choice.device) in str(value).replace(" ", "").split(",")
    ]
    where = f"drew on EGL device {choice.device}, which {' and '.join(right) or 'nothing'} named"
    return "render", f"{WRONG}: asked for device {asked} by {name}={asked}, {where}"


@pytest.mark.parametrize(
    ("library", "release", "settings", "device"),
    [
        ("robosuite", "1.5.2", Settings(), 0),
        ("robosuite", "1.5.2", Settings(argument=2), 2),
        ("robosuite", "1.5.2", Settings(argument=2, cuda="1"), 1),
        ("robosuite", "1.5.2", Settings(argument=0, cuda="1,0"), 0),
        ("robosuite", "1.5.2", Settings(cuda="1,0"), 1),
        ("robosuite", "1.5.2", Settings(argument=1, egl="2", cuda="1,2"), 2),
        ("robosuite", "1.3.2", Settings(argument=2, egl="1"), None),
        ("mujoco", "3.17.0", Settings(cuda="1"), 0),
        ("mujoco", "3.17.0", Settings(egl="2"), 2),
        ("mujoco", "4.0.0", Settings(), 1),
        ("mujoco", "4.0.0", Settings(cuda="1"), 0),
        ("mujoco", "4.0.0", Settings(egl="0"), 1),
        ("mujoco", "4.0.0", Settings(egl="0", cuda="1"), 0),
        ("mujoco", "4.0.0", Settings(egl="2"), 2),
        ("dm_control", "1.0.50", Settings(egl="2", old="1"), 2),
        ("dm_control", "1.0.8", Settings(egl="2", old="1"), 1),
    ],
)
def test_of_several_devices(library: str, release: str, settings: Settings, device: int | None) -> None:
    """A place in EGL's list, by the rule of the library: not CUDA's number where the driver counts otherwise."""
    assert choose_device(library, release, settings, SEVERAL, "3.3.7" if library != "mujoco" else None).device == device


def test_a_device_that_cannot_be_initialised() -> None:
    """MuJoCo goes on to the next one, robosuite does not."""
    devices = [Device(works=False), Device()]

    assert choose_device("mujoco", "3.3.7", Settings(), devices).device == 1
    assert "Cannot initialize a EGL device display" in str(
        choose_device("robosuite", "1.5.2", Settings(), devices, "3.3.7").error
    )


def test_no_more_than_ten_devices_are_looked_at() -> None:
    """The eleventh is out of range, and the message counts ten."""
    found = choose_device("mujoco", "3.3.7", Settings(egl="10"), [Device()] * 11)

    assert found.error == (
        "RuntimeError: The MUJOCO_EGL_DEVICE_ID environment variable must be an integer between 0 and 9 (inclusive),"
        " got 10."
    )


@pytest.mark.parametrize(("mujoco", "stage"), [("3.2.4", Stage.IMPORT), ("3.2.5", Stage.MAKE)])
def test_the_display_is_opened_at_import_or_at_rendering(mujoco: str, stage: Stage) -> None:
    """MuJoCo before 3.2.5 opens its display when it is imported, even if another library renders."""
    assert choose_device("robosuite", "1.5.0", Settings(egl="7"), SEVERAL, mujoco).stage is stage
