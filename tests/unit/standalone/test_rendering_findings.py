"""Test the single file's findings about drawing, which it makes without drawing."""

from __future__ import annotations

import pytest

from harness.standalone.doctor import rendering_findings

ALL = {"egl": None, "osmesa": None, "gl": None}


@pytest.mark.parametrize(
    ("libraries", "variables", "said"),
    [
        (ALL, {"MUJOCO_GL": "egl"}, []),
        (ALL, {"DISPLAY": ":0"}, []),
        (ALL, {}, ["there is no display, and MUJOCO_GL is not set: MuJoCo opens no window here; export MUJOCO_GL=egl"]),
        (
            {**ALL, "egl": "gone"},
            {"MUJOCO_GL": "glfw"},
            ["there is no display, and MUJOCO_GL is glfw: MuJoCo opens no window here; export MUJOCO_GL=osmesa"],
        ),
        (
            {**ALL, "egl": "gone"},
            {"MUJOCO_GL": "egl"},
            [
                "MUJOCO_GL=egl asks for EGL (libEGL.so.1), which cannot be loaded (gone); "
                "on Debian it is in libegl1 libgl1-mesa-dri"
            ],
        ),
        (
            ALL,
            {"MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": "egl"},
            ["MUJOCO_GL=osmesa and PYOPENGL_PLATFORM=egl contradict each other: unset PYOPENGL_PLATFORM"],
        ),
    ],
    ids=["egl", "display", "nothing-set", "no-window", "no-egl", "contradiction"],
)  # fmt: skip
def test_settings(libraries: dict[str, str | None], variables: dict[str, str], said: list[str]) -> None:
    """Settings that cannot draw give a warning, with the variable to change or the package to install."""
    found = rendering_findings.findings({"libraries": libraries, "devices": []}, variables)

    assert [one.text for one in found if one.level == "warning"] == said


def test_without_facts_there_is_one_note() -> None:
    """Without facts there is one note, and nothing is made up."""
    assert [one.level for one in rendering_findings.findings({}, {})] == ["note"]
