"""Measure the promises of a case on real releases: each check on a right one and on a wrong one.

The wrong ones raise nothing: their loops run, and a picture, a pose or a contact is another than was promised.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from ctypes.util import find_library
from pathlib import Path

import pytest
from uv import find_uv_bin

from harness.machine import interpreters
from harness.model import Case, Outcome

HERE = Path(__file__).parent / "environments"
ROBOTICS = ("gymnasium_robotics",)
SITES = {
    "gymnasium 1.4.0, mujoco 2.3.7, numpy 2": ("gymnasium[mujoco]==1.4.0", "mujoco==2.3.7", "numpy==2.4.6"),
    "gymnasium 1.4.0, mujoco 3.3.7, numpy 2": ("gymnasium[mujoco]==1.4.0", "mujoco==3.3.7", "numpy==2.4.6"),
    "gymnasium 1.4.0, mujoco 4.0.0, numpy 2": ("gymnasium[mujoco]==1.4.0", "mujoco==4.0.0", "numpy==2.4.6"),
    "gymnasium 0.29.1, mujoco 2.3.7, numpy 1": ("gymnasium==0.29.1", "mujoco==2.3.7", "numpy<2", "imageio"),
    "gymnasium 0.29.1, mujoco 3.3.7, numpy 1": ("gymnasium==0.29.1", "mujoco==3.3.7", "numpy<2", "imageio"),
    "robotics 1.2.4": ("gymnasium-robotics==1.2.4", "gymnasium==0.29.1", "mujoco==2.3.7", "numpy<2"),
    "robotics 1.2.4, numpy 2": ("gymnasium-robotics==1.2.4", "gymnasium==0.29.1", "mujoco==2.3.7", "numpy==2.0.2"),
    "robotics 1.3.1": ("gymnasium-robotics==1.3.1", "gymnasium==1.0.0", "mujoco==3.1.6"),
    "robotics 1.4.2": ("gymnasium-robotics==1.4.2", "gymnasium==1.4.0", "mujoco==3.11.0"),
    "dm_control, numpy 2": ("dm_control==1.0.14", "mujoco==2.3.7", "numpy==2.0.2"),
    "robosuite 1.4.1, mujoco 3.1.3": ("robosuite==1.4.1", "mujoco==3.1.3", "numpy==2.3.5", "gymnasium==1.0.0"),
    "robosuite 1.4.1, mujoco 3.1.4": ("robosuite==1.4.1", "mujoco==3.1.4", "numpy==2.3.5", "gymnasium==1.0.0"),
}
OLD, NEW, NEWEST = list(SITES)[:3]
PASSED, FAILED, SKIPPED = Outcome.PASSED, Outcome.FAILED, Outcome.SKIPPED


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], str]:
    """Return a function that makes the environment of a site once, and returns its interpreter."""
    made: dict[str, str] = {}

    def make(site: str) -> str:
        if site not in made:
            interpreter = interpreters.find("3.11")
            if interpreter is None:
                pytest.skip("unavailable: python3.11")
            folder, uv = tmp_path_factory.mktemp("site") / "env", find_uv_bin()
            subprocess.run([uv, "venv", "-q", "-p", interpreter.path, str(folder)], check=True)
            target = str(folder / "bin/python")
            subprocess.run([uv, "pip", "install", "-q", "-p", target, *SITES[site]], check=True)
            made[site] = target
        return made[site]

    return make


@pytest.fixture
def run_loop(probe, python):
    """Return a function that runs the loop of an environment in a site, and draws it if asked.

    Checks that follow from these are included.
    """

    def run(site: str, env: str, *, drawn: bool = False, imports: tuple[str, ...] = (), **kwargs):
        if drawn and find_library("EGL") is None:
            pytest.skip("missing library: libEGL")
        api = env.partition(":")[0] if env.startswith(("dm_control:", "robosuite:")) else "gymnasium"
        checks = ("import.modules", "single.loop", *(("render.rgb_array",) if drawn else ()))
        case = Case(id="c", env=env, api=api, kwargs=kwargs, imports=imports, checks=checks, steps=20)
        done = probe(python(site), case, path=HERE, variables={"MUJOCO_GL": "egl"}, limit=120, deadline=240)
        assert {done[check].outcome for check in checks} == {PASSED}
        return done

    return run


def line(reply) -> str | None:
    """Return the line that says why a check did not pass."""
    return reply.raised.message if reply.raised else reply.reason


@pytest.mark.parametrize(
    ("site", "env", "imports", "outcome", "text"),
    [
        (OLD, "Ant-v5", (), FAILED, "the free camera looks at (0.803, 0, 0), not at (0.0125, 0.0413, 0.803)"),
        (NEW, "Ant-v5", (), PASSED, ""),
        (NEWEST, "Ant-v5", (), PASSED, ""),
        ("gymnasium 0.29.1, mujoco 2.3.7, numpy 1", "Ant-v4", (), SKIPPED, "the camera is fixed in the model"),
        ("robotics 1.2.4", "FetchReach-v2", ROBOTICS, PASSED, ""),
        (
            "robotics 1.2.4, numpy 2",
            "FetchReach-v2",
            ROBOTICS,
            FAILED,
            "at (0.55, 0, 0), not at (1.3, 0.75, 0.55)",
        ),
        ("robotics 1.2.4, numpy 2", "FrankaKitchen-v1", ROBOTICS, FAILED, "looks at (2, 0, 0), not at (-0.2, 0.5, 2)"),
        ("dm_control, numpy 2", "dm_control:cheetah/run", (), SKIPPED, "the camera is fixed in the model"),
        (
            "robosuite 1.4.1, mujoco 3.1.3",
            "robosuite:Lift",
            (),
            FAILED,
            "geomgroup [1, 1, 1, 0, 0, 0], not with [0, 1, 1",
        ),
        ("robosuite 1.4.1, mujoco 3.1.4", "robosuite:Lift", (), SKIPPED, "the camera is fixed in the model"),
    ],
)
def test_a_camera_looks_where_it_is_pointed(
    site: str, env: str, imports: tuple[str, ...], outcome: Outcome, text: str, run_loop
) -> None:
    """A free camera looks at what was written, and draws what was asked for; one of the model's own is not judged."""
    camera = run_loop(site, env, imports=imports, drawn=True)["render.camera"]
    assert (camera.outcome, text in (line(camera) or "")) == (outcome, True), line(camera)


@pytest.mark.parametrize(
    ("site", "kind", "outcome"),
    [
        (OLD, "tracking", PASSED),
        (NEW, "tracking", PASSED),
        (OLD, "free", PASSED),
        (OLD, "written", FAILED),
        (NEW, "written", PASSED),
    ],
)
def test_a_camera_of_ones_own(site: str, kind: str, outcome: Outcome, run_loop) -> None:
    """Cameras that MuJoCo itself places are right beside any numpy; one whose `lookat` is written is not."""
    camera = run_loop(site, "followed:Followed", drawn=True, kind=kind)["render.camera"]
    assert camera.outcome is outcome, line(camera)


@pytest.mark.parametrize(
    ("site", "env", "outcome"),
    [
        ("robotics 1.2.4", "FetchReach-v2", PASSED),
        ("robotics 1.3.1", "FetchReach-v3", FAILED),
        ("robotics 1.3.1", "FetchPush-v3", FAILED),
        ("robotics 1.4.2", "FetchPush-v4", PASSED),
        ("robotics 1.4.2", "HandReach-v3", PASSED),
        ("robotics 1.4.2", "HandManipulateBlock-v1", SKIPPED),
        ("robotics 1.4.2", "AdroitHandDoor-v1", SKIPPED),
    ],
)
def test_a_robot_starts_where_it_says(site: str, env: str, outcome: Outcome, run_loop) -> None:
    """A reset puts the joints where the environment's own initial_qpos has them, if it steps no simulation."""
    pose = run_loop(site, env, imports=ROBOTICS)["single.start_pose"]
    assert pose.outcome is outcome, line(pose)


@pytest.mark.parametrize(
    ("site", "env", "imports", "outcome"),
    [
        ("gymnasium 0.29.1, mujoco 2.3.7, numpy 1", "Pusher-v4", (), PASSED),
        ("gymnasium 0.29.1, mujoco 3.3.7, numpy 1", "Pusher-v4", (), FAILED),
        (OLD, "Pusher-v4", (), PASSED),
        (NEW, "Pusher-v5", (), PASSED),
        (NEWEST, "Pusher-v5", (), PASSED),
        (NEW, "Ant-v5", (), SKIPPED),
        ("robotics 1.4.2", "FetchPickAndPlace-v4", ROBOTICS, PASSED),
        ("robotics 1.4.2", "HandManipulateBlock-v1", ROBOTICS, PASSED),
    ],
)
def test_a_robot_pushes_what_it_touches(
    site: str, env: str, imports: tuple[str, ...], outcome: Outcome, run_loop
) -> None:
    """An object that a robot overlaps with is pushed out of it; an ant has nothing to push."""
    contact = run_loop(site, env, imports=imports)["single.contact"]
    assert contact.outcome is outcome, (line(contact), contact.facts)


@pytest.mark.parametrize(("site", "outcome"), [(NEW, PASSED), (NEWEST, FAILED)])
@pytest.mark.parametrize("seed", [49, 90])
def test_accelerations_do_not_depend_on_storage(site: str, seed: int, outcome: Outcome, run_loop) -> None:
    """MuJoCo 4.0.0 computes other accelerations where the Jacobian of some trees of bodies is sparse."""
    solver = run_loop(site, "tangled:Tangled", seed=seed)["single.solver"]
    assert (solver.outcome, solver.facts["sparse"]) == (outcome, True), line(solver)
