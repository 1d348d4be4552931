"""Isaac Gym's adapter is checked against the published stubs, by the type checker that can read them; no network."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

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


def reported(folder: Path, source: str) -> list[str]:
    """Lines of a source in which the type checker finds an error."""
    package = folder / "checked"
    package.mkdir()
    for file in INCELL.glob("cell_*.py"):
        (package / file.name).write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
    (package / "adapter.py").write_text(source.replace(LATE, EARLY), encoding="utf-8")
    (folder / "pyrightconfig.json").write_text(json.dumps(SETTINGS), encoding="utf-8")
    command = (sys.executable, "-m", "basedpyright", "--pythonpath", sys.executable, "-p", folder, "--outputjson")
    done = subprocess.run((*command, package / "adapter.py"), cwd=folder, capture_output=True, text=True, check=False)
    answer = json.loads(done.stdout)
    assert answer["summary"]["filesAnalyzed"] == 1, done.stdout + done.stderr
    lines = source.splitlines()
    found = [one for one in answer["generalDiagnostics"] if one["severity"] == "error"]
    return [lines[one["range"]["start"]["line"]].strip() for one in found]


def test_every_call_is_in_the_stubs(tmp_path: Path) -> None:
    """The type checker has nothing to say of the adapter."""
    source = (INCELL / "api_isaacgym.py").read_text(encoding="utf-8")

    assert source.count(LATE) == 1
    assert reported(tmp_path, source) == []


def test_a_mistake_is_reported(tmp_path: Path) -> None:
    """A constant, a method, a missing argument, an attribute and a type that the stubs do not have: each is told."""
    source = (INCELL / "api_isaacgym.py").read_text(encoding="utf-8")
    for right, wrong in MISTAKES.items():
        assert source.count(right) == 1
        source = source.replace(right, wrong)
    found = reported(tmp_path, source)

    assert [wrong for wrong in MISTAKES.values() if not any(wrong in line for line in found)] == []
    assert len(found) == len(MISTAKES)
