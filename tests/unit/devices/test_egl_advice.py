"""Test the advice on drawing: the device of each library, faults in the settings, and the one setting to use."""

from __future__ import annotations

from typing import Any

import pytest

from harness.devices import egl_advice
from harness.devices.egl_advice import CROSSED, LIBRARIES, DrawingSupport
from harness.devices.egl_rules import Device
from harness.devices.gl_inventory import RenderingWays
from harness.rootcause.doctor import doctor_rendering

ONE = DrawingSupport(devices=(Device(),), osmesa=True, display=False)
OSMESA = {"MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": "osmesa"}
NOTHING = DrawingSupport(devices=(), osmesa=False, display=False)
NAMES = [who.name for who in LIBRARIES]
RANGE = "RuntimeError: The MUJOCO_EGL_DEVICE_ID environment variable must be an integer between 0 and 0 (inclusive)"
NO_BACKEND = "RuntimeError: No OpenGL rendering backend is available."
INVALID = "RuntimeError: invalid value for environment variable MUJOCO_GL: vulkan"
MUST_BE = "RuntimeError: Environment variable MUJOCO_GL must be one of"
NO_WINDOW = "FatalError: an OpenGL platform library has not been loaded into this process"


def advise(variables: dict[str, str], here: DrawingSupport) -> list[Any]:
    """Return the device, the way of drawing or the error of each library, in order."""
    results = egl_advice.outcomes(variables, here)
    return [(one.error or (one.way if one.device is None else one.device)) for one in results]


def test_a_device_that_cuda_has_and_egl_has_not() -> None:
    """Only robosuite reads CUDA_VISIBLE_DEVICES as a place in EGL's list; the finding says whose number it is."""
    variables = {"MUJOCO_GL": "egl", "CUDA_VISIBLE_DEVICES": "3"}

    assert advise(variables, ONE) == [f"{RANGE}, got 3.", 0, 0, 0, 0]
    ((error, failing),) = egl_advice.troubles(variables, ONE).items()
    assert egl_advice.describe_error(error, failing, variables) == (
        f"robosuite 1.4, 1.5 cannot draw here: {RANGE}, got 3. (the number is that of CUDA_VISIBLE_DEVICES=3)"
    )
    advice = egl_advice.recommend(variables, ONE)
    assert advice is not None
    assert (advice.variables, advice.unset) == (
        {"MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "0"},
        ("CUDA_VISIBLE_DEVICES",),
    )
    assert egl_advice.troubles(egl_advice.apply_advice(advice, variables), ONE) == {}


def test_no_way_of_drawing_chosen_and_no_display() -> None:
    """robosuite takes EGL by itself; all others open a window, which is foretold to fail."""
    assert [str(one)[: len(NO_WINDOW)] for one in advise({}, ONE)] == ["0", *[NO_WINDOW] * 4]
    assert advise({}, DrawingSupport(devices=(), osmesa=False, display=True))[1:] == ["glfw"] * 4


@pytest.mark.parametrize(
    ("variables", "wanted"),
    [
        ({"MUJOCO_GL": "osmesa"}, ["osmesa"] * 5),
        ({"MUJOCO_GL": "glx"}, [NO_WINDOW, NO_WINDOW, NO_WINDOW, MUST_BE, MUST_BE]),
        ({"MUJOCO_GL": "1"}, ["0", NO_WINDOW, NO_WINDOW, MUST_BE, NO_WINDOW]),
        ({"MUJOCO_GL": "EGL"}, ["0", "0", "0", MUST_BE, MUST_BE]),
        ({"MUJOCO_GL": "disable"}, ["0", *["AttributeError: "] * 2, MUST_BE, NO_BACKEND]),
        ({"MUJOCO_GL": "vulkan"}, ["0", *[INVALID] * 4]),
        ({"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "osmesa"}, ["ImportError: Cannot use EGL rendering platform"] * 5),
        ({"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "EGL"}, ["0"] * 5),
        (
            {"MUJOCO_GL": "osmesa", "MUJOCO_EGL_DEVICE_ID": "1", "CUDA_VISIBLE_DEVICES": "0"},
            ["AssertionError: MUJOCO_EGL_DEVICE_ID needs", *["osmesa"] * 4],
        ),
    ],
)  # fmt: skip
def test_ways_of_drawing(variables: dict[str, str], wanted: list[str]) -> None:
    """MUJOCO_GL and PYOPENGL_PLATFORM decide how each library draws, or how it fails."""
    found = [str(one)[: len(beginning)] for one, beginning in zip(advise(variables, ONE), wanted, strict=True)]

    assert found == wanted


def test_libraries_that_draw_apart() -> None:
    """MuJoCo 4 counts as CUDA does, the others as EGL does: under one number they draw on two devices."""
    variables = {"MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "0"}

    assert advise(variables, CROSSED) == [0, 0, 1, 1, 0]
    assert egl_advice.describe_disagreement(variables, CROSSED) == (
        "the libraries draw on different EGL devices here: device 0: robosuite 1.4, 1.5, MuJoCo before 4, dm_control;"
        " device 1: MuJoCo 4, gymnasium (MuJoCo 4)"
    )
    assert egl_advice.describe_disagreement(variables, ONE) is None


def test_a_device_that_was_given_is_the_one_recommended() -> None:
    """Of two GPUs the one that CUDA_VISIBLE_DEVICES names; what is not set need not be unset."""
    here = DrawingSupport(devices=(Device(cuda=0), Device(cuda=1)), osmesa=True, display=True)

    advice = egl_advice.recommend({"CUDA_VISIBLE_DEVICES": "1"}, here)

    assert advice == egl_advice.Advice(
        variables={"MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "1"},
        unset=(),
        reason="all libraries draw on EGL device 1, by a number that every one of them reads",
    )


def test_a_gpu_for_most_comes_before_the_cpu_for_all() -> None:
    """A GPU for most comes before the CPU for all; who cannot draw is said."""
    here = DrawingSupport(devices=(Device(works=False), Device(cuda=0), Device(cuda=1)), osmesa=True, display=False)

    advice = egl_advice.recommend({"CUDA_VISIBLE_DEVICES": "1"}, here)

    assert advice is not None
    assert (advice.variables["MUJOCO_EGL_DEVICE_ID"], advice.unset) == ("2", ("CUDA_VISIBLE_DEVICES",))
    assert advice.reason.startswith("all but MuJoCo 4, gymnasium (MuJoCo 4) draw on EGL device 2, in the process")


@pytest.mark.parametrize(
    ("here", "variables"),
    [
        (DrawingSupport(devices=(Device(works=False),), osmesa=True, display=True), OSMESA),
        (NOTHING, None),
    ],
)  # fmt: skip
def test_without_a_device_of_egl(here: DrawingSupport, variables: dict[str, str] | None) -> None:
    """OSMesa comes next; where nothing draws nothing is recommended."""
    advice = egl_advice.recommend({}, here)

    assert (advice and advice.variables) == variables


def test_the_document() -> None:
    """Every value that could be set stands there, one out of range too."""
    ways = RenderingWays(devices=({"software": "yes"},), egl_missing=None, osmesa={}, display={"missing": "none"})

    made = doctor_rendering.assess_rendering(ways, {"MUJOCO_GL": "egl", "CUDA_VISIBLE_DEVICES": "3"})

    assert "robosuite 1.4, 1.5 cannot draw here" in made.findings[0].text
    assert [one.setting for one in made.rendering.possible] == [
        "nothing",
        "MUJOCO_EGL_DEVICE_ID=0",
        "MUJOCO_EGL_DEVICE_ID=1",
        "CUDA_VISIBLE_DEVICES=0",
        "CUDA_VISIBLE_DEVICES=1",
        "render_gpu_device_id=0",
        "render_gpu_device_id=1",
        "MUJOCO_EGL_DEVICE_ID=0 CUDA_VISIBLE_DEVICES=1",
    ]
    assert [one.device for one in made.rendering.selected] == [None, 0, 0, 0, 0]
    assert "\n  robosuite 1.4, 1.5: fails: RuntimeError: The MUJOCO_EGL" in "\n".join(
        doctor_rendering.lines(made.rendering)
    )
    assert "\n  MuJoCo before 4, MuJoCo 4, gymnasium (MuJoCo 4), dm_control: EGL device 0\n" in "\n".join(
        doctor_rendering.lines(made.rendering)
    )
