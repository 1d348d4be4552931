"""Isaac Gym's adapter is checked against the published stubs, by the type checker that can read them; no network."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import harness

INCELL = Path(harness.__file__).parent / "incell"
SETTINGS = {
    "typeCheckingMode": "standard",
    "pythonVersion": "3.8",
    "reportIncompatibleMethodOverride": False,  # the in-cell side has no annotations
    "reportOptionalMemberAccess": False,
}
LATE, EARLY = 'gymapi = importlib.import_module("isaacgym.gymapi")', "from isaacgym import gymapi"
"""How the adapter imports the API, and how a type checker can see it."""

MISTAKES = {
    "gymapi.UP_AXIS_Z": "gymapi.UP_AXIS",
    "gym.render_all_camera_sensors(": "gym.render_camera_sensors(",
    "self.gym.prepare_sim(self.sim)": "self.gym.prepare_sim()",
    "properties.enable_tensors": "properties.enable_tensor",
    "gym.create_sphere(self.sim, 0.15": 'gym.create_sphere(self.sim, "0.15"',
    "self.gymapi.STATE_ALL).copy().view": "self.gymapi.STATE_EVERY).copy().view",
}
"""Of each kind of use one, and what it may be mistaken for."""


def mistaken(source: str) -> str:
    """Return the source with every mistake in it."""
    for right, wrong in MISTAKES.items():
        assert source.count(right) == 1
        source = source.replace(right, wrong)
    return source


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """Return the lines with type errors, for the adapter as it is and for one with mistakes."""
    folder = tmp_path_factory.mktemp("stubs")
    package = folder / "checked"
    package.mkdir()
    for file in INCELL.glob("cell_*.py"):
        (package / file.name).write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
    source = (INCELL / "api_isaacgym.py").read_text(encoding="utf-8")
    assert source.count(LATE) == 1
    sources = {"right": source, "wrong": mistaken(source)}
    for name, text in sources.items():
        (package / f"{name}.py").write_text(text.replace(LATE, EARLY), encoding="utf-8")
    (folder / "pyrightconfig.json").write_text(json.dumps(SETTINGS), encoding="utf-8")
    command = (sys.executable, "-m", "basedpyright", "--pythonpath", sys.executable, "-p", folder, "--outputjson")
    files = [package / f"{name}.py" for name in sources]
    done = subprocess.run((*command, *files), cwd=folder, capture_output=True, text=True, check=False)
    answer = json.loads(done.stdout)
    assert answer["summary"]["filesAnalyzed"] == len(files), done.stdout + done.stderr
    found: dict[str, list[str]] = {name: [] for name in sources}
    for one in answer["generalDiagnostics"]:
        if one["severity"] == "error":
            name = Path(one["file"]).stem
            found[name].append(sources[name].splitlines()[one["range"]["start"]["line"]].strip())
    return found


def test_every_call_is_in_the_stubs(reported: dict[str, list[str]]) -> None:
    """The type checker finds no error in the adapter."""
    assert reported["right"] == []


def test_a_mistake_is_reported(reported: dict[str, list[str]]) -> None:
    """A constant, method, missing argument, attribute or type that the stubs lack is reported each."""
    found = reported["wrong"]

    assert [wrong for wrong in MISTAKES.values() if not any(wrong in line for line in found)] == []
    assert len(found) == len(MISTAKES)
