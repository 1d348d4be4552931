"""A sphere falls alike in every simulator whose adapter has the same scene, with the same settings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from test_adapters import RELEASES, cell, name, runner  # noqa: F401 - a fixture

from harness.model import Phase, replace
from harness.probes import launch
from harness.running.scheduler import ControlledRunner, Settings
from harness.smoke.tried import CellUnderTest

HEIGHT, FALLEN = 1.0, 9.81 * 0.002**2 * 50 * 51 / 2
"""Where it begins (m), and how far it falls in 50 steps of 2 ms, each of which first makes it faster."""

PLACES = {"mujoco": ("qpos", 2), "mjx": ("qpos", 2), "mujoco_warp": ("qpos", 2), "newton": ("body_q", 2)}
"""Where its height stands in an observation, whatever the shape of that."""

INSIDE = """
import importlib, sys
sys.path.insert(0, ASKED["incell"])
importlib.import_module("bootstrap").enter()
case = ASKED["case"]
api = importlib.import_module("_simmatrix_cell.api_" + case["api"]).API
for module in api.modules(case):
    importlib.import_module(module)
env = api.make(case, lambda kind, code, **data: None)
env.seed_actions(7)
env.reset(7)
for _ in range(50):
    seen = env.step(env.action())[0]
print("HEIGHT", float(seen[ASKED["key"]].reshape(-1)[ASKED["place"]]))
"""


@pytest.mark.parametrize("release", [one for one in RELEASES if one["api"] in PLACES], ids=name)
def test_a_sphere_falls_as_it_must(release: dict[str, Any], runner: ControlledRunner, tmp_path: Path) -> None:  # noqa: F811
    """A falling sphere is at a height of 0.949969 m after 50 steps of 2 ms."""
    api = release["api"]
    asked = cell({**release, "env": f"{api}:sphere"}, tmp_path)
    ready = replace(runner.runner, settings=Settings(until=Phase.INSTALL)).prepare(replace(asked, cases=()))
    assert ready.site
    inside = CellUnderTest(
        id=asked.id, axes={}, version="", installed=ready.record.installed or {}, expect=None, site=ready.site
    )
    key, place = PLACES[api]
    told = {"incell": str(launch.INCELL), "case": msgspec.to_builtins(asked.cases[0]), "key": key, "place": place}

    ran = inside.run(f"import json\nASKED = json.loads({json.dumps(told)!r})\n{INSIDE}", timeout=300)

    line = next(line for line in ran.output.splitlines() if line.startswith("HEIGHT "))
    assert float(line.removeprefix("HEIGHT ")) == pytest.approx(HEIGHT - FALLEN, abs=1e-4)
