"""States that are set in environments which remember more than MuJoCo's data: Meta-World and gymnasium-robotics."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from uv import find_uv_bin

from harness.machine import interpreters
from harness.model import Case
from harness.probes import launch

SITES = {
    "metaworld": ("metaworld==3.0.0", "gymnasium[mujoco]==1.2.3", "mujoco==3.3.7", "numpy==1.26.4"),
    "gymnasium_robotics": ("gymnasium-robotics==1.4.2", "gymnasium[mujoco]==1.2.3", "mujoco==3.3.7", "numpy==1.26.4"),
}
PEG = ("metaworld", "Meta-World/MT1", {"env_name": "peg-insert-side-v3", "seed": 1})
PICK = ("gymnasium_robotics", "FetchPickAndPlace-v4", {})
REACH = ("gymnasium_robotics", "FetchReach-v4", {})
DOOR = ("gymnasium_robotics", "AdroitHandDoor-v1", {})
KITCHEN = ("gymnasium_robotics", "FrankaKitchen-v1", {})
NAMES = {"peg": PEG, "pick": PICK, "reach": REACH, "door": DOOR, "kitchen": KITCHEN}


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], dict[str, Any]]:
    """Return a function that makes states of an environment, steps from them, and returns what was seen."""
    pythons: dict[str, str] = {}
    results: dict[str, dict[str, Any]] = {}

    def python(module: str) -> str:
        if module not in pythons:
            interpreter = interpreters.find("3.11")
            if interpreter is None:
                pytest.skip("unavailable: python3.11")
            folder, uv = tmp_path_factory.mktemp("site") / "env", find_uv_bin()
            subprocess.run([uv, "venv", "-q", "-p", interpreter.path, str(folder)], check=True)
            pythons[module] = str(folder / "bin/python")
            subprocess.run([uv, "pip", "install", "-q", "-p", pythons[module], *SITES[module]], check=True)
        return pythons[module]

    def look(name: str) -> dict[str, Any]:
        if name not in results:
            module, env, kwargs = NAMES[name]
            case = Case(id="c", env=env, api="gymnasium", kwargs=kwargs, imports=(module,))
            told = [str(launch.INCELL), json.dumps(msgspec.to_builtins(case))]
            script = Path(__file__).parent / "set_states.py"
            ran = subprocess.run(
                [python(module), "-W", "ignore", str(script), *told], check=True, capture_output=True, text=True
            )
            # Libraries print, too, some of them at their end.
            (document,) = [line for line in ran.stdout.splitlines() if line.startswith("{")]
            results[name] = json.loads(document)
        return results[name]

    return look


@pytest.mark.parametrize("name", NAMES)
def test_a_state_leads_to_the_same_whatever_came_before(seen: Callable[[str], dict[str, Any]], name: str) -> None:
    """No step, no reset with another goal and no noise before it changes a bit of any output."""
    result = seen(name)
    assert (result["repeats"], result["unlike"]) == (True, [])


@pytest.mark.parametrize(
    ("name", "attribute", "places"),
    [("peg", "_prev_obs", 2), ("peg", "_target_pos", 2), ("pick", "goal", 0), ("kitchen", "_last_robot_qpos", 0)],
)
def test_a_state_holds_what_the_task_remembers(
    seen: Callable[[str], dict[str, Any]], name: str, attribute: str, places: int
) -> None:
    """Goals, earlier observations and places of objects are parts of a state: others are observed otherwise."""
    result = seen(name)
    assert attribute in result["task"]
    assert (result["places"], result["other_task"]) == (places, True)


def test_a_door_that_a_reset_places_is_placed_by_the_state(seen: Callable[[str], dict[str, Any]]) -> None:
    """Adroit's door stands in the model, where each reset puts it elsewhere."""
    result = seen("door")
    assert (result["task"], result["places"], result["other_task"]) == ([], 1, True)


@pytest.mark.parametrize(("name", "grasps"), [("peg", 8), ("pick", 8), ("kitchen", 8), ("reach", 0), ("door", 0)])
def test_both_fingers_touch_what_a_grasp_holds(seen: Callable[[str], dict[str, Any]], name: str, grasps: int) -> None:
    """A fifth of the states are grasps where the model has a gripper and a free body, and none is elsewhere."""
    result = seen(name)
    assert (result["kinds"][4], result["held"]) == (grasps, grasps)
    assert sum(result["kinds"]) == 40
