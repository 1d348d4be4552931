"""The device that draws, with real libraries and a stand-in for several devices.

Requested and actual device, memory, precedence of settings.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from ctypes.util import find_library
from pathlib import Path
from typing import Any

import pytest
import standin
from uv import find_uv_bin

from harness.devices.egl_rules import Choice, Device, Settings, choose_device
from harness.machine import interpreters
from harness.model import Case, Outcome

MUJOCO, OLDER = "4.0.0", "3.3.7"
ROBOSUITE = "1.5.2"
CHECK = "render.device"
LISTS = ["1,0,-", "-!,-,-", "-" + ",-" * 11]
SETTINGS = [
    Settings(),
    Settings(cuda="1"),
    Settings(cuda="1,0"),
    Settings(egl="0"),
    Settings(egl="2", cuda="1"),
    Settings(egl="0", cuda="1,0"),
    Settings(egl="11"),
]
ROBOSUITES = [*SETTINGS, Settings(argument=1), Settings(argument=1, cuda="0"), Settings(argument=0, cuda="1,0")]
WITNESS = (Path(__file__).parent / "device_witness.py").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder for the stand-in's libraries."""
    if find_library("EGL") is None:
        pytest.skip("missing library: libEGL")
    return tmp_path_factory.mktemp("devices")


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., str]:
    """Return a function that makes an environment of requirements once, and returns its interpreter."""
    made: dict[tuple[str, ...], str] = {}

    def make(*requirements: str) -> str:
        if requirements not in made:
            interpreter = interpreters.find("3.11")
            if interpreter is None:
                pytest.skip("unavailable: python3.11")
            folder = tmp_path_factory.mktemp("site") / "env"
            subprocess.run([find_uv_bin(), "venv", "-q", "-p", interpreter.path, str(folder)], check=True)
            made[requirements] = str(folder / "bin/python")
            argv = [find_uv_bin(), "pip", "install", "-q", "-p", made[requirements], *requirements]
            subprocess.run(argv, check=True)
        return made[requirements]

    return make


@pytest.fixture
def newest(python: Callable[..., str]) -> str:
    """Return the Python of an environment with MuJoCo and a gymnasium that draws with it."""
    return python(f"mujoco=={MUJOCO}", "gymnasium==1.4.0", "imageio", "packaging", "numpy==2.4.6")


@pytest.fixture
def draw_on(probe, newest: str, libraries: Path):
    """Return a function that draws with an environment on these devices."""

    def run(devices: str, api: str, env: str, **variables: str):
        case = Case(id="c", env=env, api=api, checks=(CHECK,), steps=1)
        seen = {"MUJOCO_GL": "egl", **standin.variables(libraries, devices), **variables}
        return probe(newest, case, variables=seen, limit=100, deadline=100)

    return run


def test_one_real_device(probe, newest: str) -> None:
    """Without a stand-in the real device is found; GPU memory is unavailable without an NVIDIA driver."""
    if find_library("EGL") is None:
        pytest.skip("missing library: libEGL")
    case = Case(id="c", env="mujoco:markers", api="mujoco", checks=(CHECK,), steps=1)
    done = probe(newest, case, variables={"MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "0"})

    told = done[CHECK].facts["told"]
    assert done[CHECK].outcome is Outcome.PASSED
    assert (told["asked"], told["got"]["api"], told["got"]["index"]) == ({"MUJOCO_EGL_DEVICE_ID": "0"}, "egl", 0)
    assert len(told["devices"]) >= 1
    if find_library("nvidia-ml") is None:
        assert told["memory"] == "unavailable: no libnvidia-ml.so.1: no NVIDIA driver here"


def test_another_device_than_was_asked_for(draw_on) -> None:
    """A drawing on another device than requested fails, and names the setting.

    It also shows whose memory grew, for the workers of a vector environment too.
    """
    done = draw_on("1,0,-", "gymnasium", "InvertedPendulum-v5", CUDA_VISIBLE_DEVICES="3")

    check = done[CHECK]
    assert (check.outcome, check.raised.message, check.raised.blame) == (
        Outcome.FAILED,
        "asked for device 3 by CUDA_VISIBLE_DEVICES=3, drew on EGL device 1 (CUDA device 0), which nothing named",
        "library",
    )
    told = check.facts["told"]
    assert told["devices"] == ["CUDA 1, software", "CUDA 0, software", "software"]
    assert told["workers"] == [{"api": "egl", "index": 1, "cuda": 0}] * 2
    assert told["memory"] == [
        {"name": "Stand-in 0", "before": 100, "after": 164, "with 2 workers": 292},
        {"name": "Stand-in 1", "before": 100, "after": 100, "with 2 workers": 100},
    ]


def test_a_place_of_egl_s_that_is_another_gpu(draw_on) -> None:
    """MUJOCO_EGL_DEVICE_ID=1 overrides CUDA_VISIBLE_DEVICES=0; the numbers of EGL and CUDA differ here."""
    done = draw_on("1,0,-", "mujoco", "mujoco:markers", CUDA_VISIBLE_DEVICES="0", MUJOCO_EGL_DEVICE_ID="1")

    where = "on EGL device 0 (CUDA device 1), which MUJOCO_EGL_DEVICE_ID=1 named"
    assert done[CHECK].raised.message == f"asked for device 0 by CUDA_VISIBLE_DEVICES=0, drew {where}"


def test_the_device_that_was_asked_for(draw_on) -> None:
    """A drawing on the requested device passes; different numbers in EGL and CUDA are a finding."""
    done = draw_on("1,0,-", "mujoco", "mujoco:markers", MUJOCO_EGL_DEVICE_ID="0")

    assert done[CHECK].outcome is Outcome.PASSED
    assert done[CHECK].facts["told"]["workers"]["skipped"]["code"] == "skip.no_batches"
    assert done.findings == {CHECK: ["EGL device 1 is CUDA device 0, and MUJOCO_EGL_DEVICE_ID may mean either"]}


def test_a_place_among_the_visible_devices(draw_on) -> None:
    """A number may count what CUDA_VISIBLE_DEVICES leaves, as it does in MuJoCo 4."""
    done = draw_on("0,1", "mujoco", "mujoco:markers", MUJOCO_EGL_DEVICE_ID="0", CUDA_VISIBLE_DEVICES="1")

    assert done[CHECK].outcome is Outcome.PASSED
    assert done[CHECK].facts["told"]["got"]["index"] == 1


def test_a_device_without_a_number_of_cuda(draw_on) -> None:
    """CUDA_VISIBLE_DEVICES does not apply to a device without a CUDA number."""
    done = draw_on("1,0,-", "mujoco", "mujoco:markers", MUJOCO_EGL_DEVICE_ID="2", CUDA_VISIBLE_DEVICES="5")

    assert done[CHECK].outcome is Outcome.PASSED
    assert done[CHECK].facts["told"]["got"]["index"] == 2


@pytest.mark.parametrize("devices", LISTS)
def test_mujoco_draws_as_predicted(devices: str, newest: str, libraries: Path) -> None:
    """MuJoCo draws on the predicted device, or fails with the predicted message.

    Several devices, in CUDA's order or not, a broken one, and more than are examined.
    """
    got = witness_devices(newest, "mujoco", devices, SETTINGS, libraries)

    assert got == [predict("mujoco", MUJOCO, devices, one, None) for one in SETTINGS]


if os.environ.get("ENDURANCE"):  # robosuite is large

    @pytest.mark.parametrize("devices", LISTS)
    def test_robosuite_draws_as_predicted(devices: str, python: Callable[..., str], libraries: Path) -> None:
        """robosuite's own function does as predicted, with a MuJoCo release that does not know CUDA numbers."""
        site = python(f"robosuite=={ROBOSUITE}", f"mujoco=={OLDER}", "numpy==1.26.4", "gymnasium==1.0.0")

        got = witness_devices(site, "robosuite", devices, ROBOSUITES, libraries)

        assert got == [predict("robosuite", ROBOSUITE, devices, one, OLDER) for one in ROBOSUITES]


def predict(library: str, release: str, devices: str, settings: Settings, mujoco: str | None) -> list[Any]:
    """Return the predicted device, error and stage."""
    known = [
        Device(cuda=None if word[0] == "-" else int(word.rstrip("!")), works=not word.endswith("!"))
        for word in devices.split(",")
    ]
    found: Choice = choose_device(library, release, settings, known, mujoco)
    return [found.device, found.error, str(found.stage) if found.error else "make"]


def witness_devices(python: str, library: str, devices: str, asked: list[Settings], libraries: Path) -> list[list[Any]]:
    """Return a library's device, error and stage on these devices, for each of the settings in its own process."""
    base = {"PATH": os.defpath, "MUJOCO_GL": "egl", **standin.variables(libraries, devices)}
    found = []
    for one in asked:
        given = {"MUJOCO_EGL_DEVICE_ID": one.egl, "CUDA_VISIBLE_DEVICES": one.cuda}
        env = base | {name: value for name, value in given.items() if value is not None}
        argument = "-1" if one.argument is None else str(one.argument)
        argv = [python, "-c", WITNESS, library, argument]
        done = subprocess.run(argv, env=env, capture_output=True, text=True, check=False)
        line = next((line for line in done.stdout.splitlines() if line.startswith("WITNESS ")), None)
        assert line, done.stderr
        found.append(json.loads(line.removeprefix("WITNESS ")))
    return found
