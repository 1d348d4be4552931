"""Several EGL devices, played by a stand-in: the facts of each, and the findings of `doctor --rendering`."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import standin

from harness.devices.egl_rules import CUDA, SPACES, Typed

Doctor = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture(scope="module")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder for the stand-in's libraries."""
    return tmp_path_factory.mktemp("devices")


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an empty environment, about which there is nothing to report."""
    folder = tmp_path_factory.mktemp("environment")
    subprocess.run((sys.executable, "-m", "venv", "--without-pip", folder), check=True)
    return folder


@pytest.fixture
def doctor(libraries: Path, environment: Path) -> Doctor:
    """Return a function that runs `doctor --rendering --json` with these devices and variables.

    It returns exit code and document.
    """

    def run(devices: str, **variables: str) -> tuple[int, dict[str, Any]]:
        known = ("PATH", "HOME", "HARNESS_CACHE", "LANG")
        env = {name: os.environ[name] for name in known if name in os.environ}
        env |= {"MUJOCO_GL": "egl", **standin.variables(libraries, devices), **variables}
        argv = [sys.executable, "-m", "harness", "doctor", "--rendering", "--json", "--python", str(environment)]
        done = subprocess.run(argv, env=env, capture_output=True, text=True, check=False)
        assert done.stderr == ""
        return done.returncode, json.loads(done.stdout)

    return run


def rendering_findings(document: dict[str, Any]) -> list[str]:
    """Return the texts of the findings about rendering."""
    return [one["text"] for one in document["findings"] if one["check"] == "rendering"]


def test_each_device_is_asked(doctor: Doctor) -> None:
    """Devices are listed in EGL's order, with CUDA's number; a broken one is listed and does not hide the others."""
    code, document = doctor("1,0!,-")

    devices = document["rendering"]["devices"]
    assert [(one.get("cuda"), one.get("missing")) for one in devices] == [
        ("1", None),
        ("0", "it cannot be initialised"),
        (None, None),
    ]
    assert all(one["renderer"] for one in devices if "missing" not in one)
    assert (code, rendering_findings(document)) == (0, [])
    assert [one["device"] for one in document["rendering"]["selected"]] == [0] * 5


def test_a_variable_breaks_only_robosuite(doctor: Doctor) -> None:
    """CUDA_VISIBLE_DEVICES=3 breaks only robosuite, as a known failure; the finding names the variable."""
    code, document = doctor("0,1", CUDA_VISIBLE_DEVICES="3")

    wrong = "RuntimeError: The MUJOCO_EGL_DEVICE_ID environment variable must be an integer between 0 and 1 (inclusive)"
    assert (code, rendering_findings(document)) == (
        1,
        [f"robosuite 1.4, 1.5 cannot draw here: {wrong}, got 3. (the number is that of CUDA_VISIBLE_DEVICES=3)"],
    )
    assert [one["device"] for one in document["rendering"]["selected"]] == [None, 0, 0, 0, 0]
    assert document["diagnoses"][0]["signature"] == "robosuite-egl-device-out-of-range"
    assert document["rendering"]["recommended"]["unset"] == ["CUDA_VISIBLE_DEVICES"]


def test_the_recommended_setting_is_well(doctor: Doctor) -> None:
    """With the recommended setting nothing is found, and every library draws on the intended device."""
    _, before = doctor("0,1,-!", CUDA_VISIBLE_DEVICES="1")
    advice = before["rendering"]["recommended"]
    kept = {} if "CUDA_VISIBLE_DEVICES" in advice["unset"] else {"CUDA_VISIBLE_DEVICES": "1"}

    code, after = doctor("0,1,-!", **{**kept, **advice["variables"]})

    assert (code, after["decisive"]) == (0, None)
    assert {one["device"] for one in after["rendering"]["selected"]} == {1}


@pytest.mark.parametrize("typed", SPACES, ids=lambda one: one.text)
def test_spaces_around_the_sign(typed: Typed) -> None:
    """Spaces around the sign have the predicted effect in bash: the variable's value, and bash's error message."""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("unavailable: bash")
    script = f'{typed.text}\nprintf "%s" "${{{CUDA}-unset}}"'

    done = subprocess.run((bash, "-c", script), env={"PATH": os.defpath}, capture_output=True, text=True, check=False)

    assert done.stdout == ("unset" if typed.value is None else typed.value)
    assert typed.says in done.stderr
    assert bool(done.stderr) == bool(typed.says)
