"""The in-cell checks on real gym and gymnasium: good environments pass, and each trouble has its own result."""

from __future__ import annotations

import hashlib
import subprocess
from collections.abc import Callable
from ctypes.util import find_library
from pathlib import Path

import numpy as np
import pytest
from uv import find_uv_bin

from harness.machine import interpreters
from harness.model import Case, Outcome
from harness.probes import program, wire

ALL = ("import.modules", "single.loop", "vector.sync", "vector.async.fork", "render.rgb_array")
HERE = Path(__file__).parent / "environments"
SITES = {
    "gym 0.17.3": ("3.7", "gym", ("gym==0.17.3",)),
    "gym 0.25.2": ("3.9", "gym", ("gym==0.25.2", "numpy==1.23.5", "pygame==2.1.0")),
    "gym 0.26.2": ("3.9", "gym", ("gym==0.26.2", "numpy<2", "pygame==2.6.1")),
    "gymnasium 0.26.3": ("3.7", "gymnasium", ("gymnasium==0.26.3",)),
    "gymnasium 0.29.1": ("3.10", "gymnasium", ("gymnasium==0.29.1", "mujoco==2.3.7", "imageio", "numpy<2")),
    "gymnasium 1.4.0": ("3.11", "gymnasium", ("gymnasium[mujoco]==1.4.0", "pygame==2.6.1")),
}
NEWEST = "gymnasium 1.4.0"
OLDEST = ("gym 0.17.3", "gym 0.26.2", "gymnasium 0.26.3")
CLASSIC = "gym 0.17.3"


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], str]:
    """Return a function that makes the environment of a site once, and returns its interpreter."""
    made: dict[str, str] = {}

    def make(site: str) -> str:
        if site not in made:
            version, _, requirements = SITES[site]
            interpreter = interpreters.find(version)
            if interpreter is None:
                pytest.skip(f"unavailable: python{version}")
            folder = tmp_path_factory.mktemp("site") / "env"
            uv = find_uv_bin()
            subprocess.run([uv, "venv", "-q", "-p", interpreter.path, str(folder)], check=True)
            subprocess.run([uv, "pip", "install", "-q", "-p", str(folder / "bin/python"), *requirements], check=True)
            made[site] = str(folder / "bin/python")
        return made[site]

    return make


@pytest.fixture
def run_checks(probe, python):
    """Return a function that runs checks of an environment in a site."""

    def run(
        site: str,
        env: str,
        mode: str = "",
        checks: tuple[str, ...] = ALL,
        imports: tuple[str, ...] = (),
        *,
        steps: int = 30,
        **more,
    ):
        api = SITES[site][1]
        kwargs = {"mode": mode} if mode else {}
        case = Case(id="c", env=env, api=api, kwargs=kwargs, imports=imports, checks=checks, steps=steps)
        variables = {"LIBRARY": api, "MUJOCO_GL": "egl", "SDL_VIDEODRIVER": "dummy"}
        return probe(python(site), case, path=HERE, variables=variables, **more)

    return run


def loaded(api: str, checks: tuple[str, ...]) -> tuple[str, ...]:
    """Return the files that a probe loads of whose checks all pass, with those that follow them."""
    followers = [name for check in checks for name in wire.FOLLOWERS.get(check, ())]
    return program.own().loaded(api, [*checks, *followers])


def outcomes(done) -> dict[str, Outcome | None]:
    """Return the outcome of each requested check."""
    return {reply.check: reply.outcome for reply in done.reply.checks if reply.check in ALL}


@pytest.mark.parametrize(
    ("site", "env"),
    [
        ("gym 0.25.2", "CartPole-v1"),
        ("gym 0.26.2", "CartPole-v1"),
        ("gym 0.26.2", "Blackjack-v1"),
        ("gymnasium 0.29.1", "Ant-v4"),
        (NEWEST, "CartPole-v1"),
        (NEWEST, "FrozenLake-v1"),
        (NEWEST, "Blackjack-v1"),
        (NEWEST, "Pendulum-v1"),
        (NEWEST, "Ant-v5"),
    ],
)
def test_good_environments_pass(site: str, env: str, run_checks) -> None:
    """Every check of a good environment passes; only the files that the key is made of are loaded."""
    if env.startswith("Ant") and find_library("EGL") is None:
        pytest.skip("missing library: libEGL")
    done = run_checks(site, env)
    assert outcomes(done) == dict.fromkeys(ALL, Outcome.PASSED)
    assert (done.reply.complete, done.reply.problems) == (True, ())
    assert set(done.findings) <= {
        "single.check_env",
        "single.repeat.seed",
        "single.deprecation",
        "vector.deprecation",
    }
    assert [name for _, name in done.reply.frames] == ["render.rgb_array-first.npy", "render.rgb_array-last.npy"]
    assert len(done["single.loop"].facts["trajectory"]) >= 31
    assert done.reply.modules == loaded(SITES[site][1], ALL)


def test_old_environments_pass(run_checks) -> None:
    """Environments of gym before 0.18 pass: float64 instead of the promised float32 stops no loop."""
    done = run_checks(CLASSIC, "Pendulum-v0", checks=ALL[:-1])
    assert outcomes(done) == dict.fromkeys(ALL[:-1], Outcome.PASSED)
    assert set(done.findings) == {"single.type"}
    assert done["single.check_env"].reason == "this gym has no checker"
    assert done.reply.modules == loaded("gym", ALL[:-1])


WAYS = ("vector.async.spawn", "vector.async.forkserver", "vector.async.unshared", "vector.async.many")


@pytest.mark.parametrize("site", [CLASSIC, NEWEST])
def test_every_way_of_workers(site: str, run_checks) -> None:
    """Every start method, without shared memory, with more environments than cores; workers import what is named."""
    done = run_checks(site, "Troubled-v0", checks=WAYS, imports=("troubled",))
    assert {reply.check: reply.outcome for reply in done.reply.checks} == dict.fromkeys(WAYS, Outcome.PASSED)
    assert [len(done[check].workers) for check in WAYS[:3]] == [2, 2, 2]
    assert len(done[WAYS[3]].workers) >= 4
    assert {(worker.exit_code, worker.reached) for check in WAYS for worker in done[check].workers} == {(0, "step")}


@pytest.mark.parametrize(
    ("site", "modes", "findings"),
    [
        (CLASSIC, ["SAME_STEP"], {"vector.autoreset"}),
        ("gymnasium 0.26.3", ["SAME_STEP"], set()),
        (NEWEST, ["NEXT_STEP", "SAME_STEP", "DISABLED"], set()),
    ],
)
def test_episodes_end_in_a_batch_as_alone(site: str, modes: list[str], findings: set[str], run_checks) -> None:
    """Each environment of a batch does what it does alone, over episode ends, in each mode of the library."""
    done = run_checks(site, "troubled:Troubled-v0", checks=("vector.autoreset",))
    assert done["vector.autoreset"].outcome is Outcome.PASSED
    assert done["vector.autoreset"].facts["modes"] == modes
    assert {name for name in done.findings if not name.endswith(".deprecation")} == findings


def test_environments_that_share_something_differ_in_workers(run_checks) -> None:
    """A generator that all environments of a process share makes another batch of the same seeds."""
    done = run_checks(
        NEWEST, "troubled:Troubled-v0", "shared", checks=("vector.sync", "vector.async.fork", "vector.autoreset")
    )
    assert {reply.outcome for reply in done.reply.checks} == {Outcome.PASSED}
    assert done.findings["vector.repeat"][0].startswith(
        "the same seed and actions give other values in vector.async.fork than in vector.sync, from step 1 on (obs"
    )
    assert done.findings["vector.autoreset"][0] == (
        "environment 0 of 2 gives another observation than alone with its seed and actions, from step 1 on, "
        "episodes that begin in mode NEXT_STEP"
    )


@pytest.mark.parametrize(
    ("mode", "message"),
    [
        ("pair", "reset() returned an observation that is a tuple of 2, not numbers"),
        ("five", "step() returned a tuple of 5, not (observation, reward, done, info)"),
        ("noinfo", "step() returned None as info, not a dict"),
    ],
)
def test_the_new_api_in_an_old_gym_fails(mode: str, message: str, run_checks) -> None:
    """Results of the new API in an old gym fail: a loop of four values cannot use them."""
    raised = run_checks(CLASSIC, "troubled:Troubled-v0", mode, checks=("single.loop",))["single.loop"].raised
    assert (raised.blame, raised.message) == ("library", message)


def test_a_seed_that_is_not_heeded(run_checks) -> None:
    """Before gym 0.26 seed() may do nothing: the trajectories of one seed differ."""
    done = run_checks(CLASSIC, "troubled:Troubled-v0", "deaf", checks=("single.loop",))
    assert done["single.loop"].outcome is Outcome.PASSED
    assert {"single.repeat.fresh", "single.repeat.same"} <= set(done.findings)


@pytest.mark.parametrize("check", ALL[1:])
def test_a_check_alone(check: str, run_checks) -> None:
    """Each check can be asked for by itself, as after the death of a process, and loads what its key says."""
    done = run_checks(NEWEST, "CartPole-v1", checks=(check,))
    assert outcomes(done) == {check: Outcome.PASSED}
    assert done.reply.modules == loaded("gymnasium", (check,))


def test_another_process_has_the_same_trajectory(run_checks, tmp_path: Path) -> None:
    """`single.repeat` gives what `single.loop` gave in another process."""
    first = run_checks(NEWEST, "Ant-v5", checks=("single.loop",))["single.loop"].facts["trajectory"]
    (tmp_path / "reply").rename(tmp_path / "before")
    assert run_checks(NEWEST, "Ant-v5", checks=("single.repeat",))["single.repeat"].facts["trajectory"] == first


def test_values_of_a_trajectory(run_checks) -> None:
    """Observations, rewards and flags of the first steps, cut where they are many, and how many there were."""
    values = run_checks(NEWEST, "Ant-v5", checks=("single.loop",))["single.loop"].facts["values"]
    assert (values["steps"] >= 31, values["sizes"], len(values["entries"])) == (True, [105, 1, 1, 1], 14)
    assert [len(part) for part in values["entries"][1]] == [64, 1, 1, 1]
    assert abs(values["entries"][0][0][0] - 0.75) < 0.1  # the height of the torso


@pytest.mark.parametrize(
    ("site", "env", "api"),
    [
        (NEWEST, "Ant-v5", "gymnasium"),
        ("gymnasium 0.29.1", "Ant-v4", "gymnasium"),
        (NEWEST, "mujoco:markers", "mujoco"),
    ],
)
def test_pictures_in_numbers(site: str, env: str, api: str, probe, python) -> None:
    """Each frame has the digest of its pixels, and the pose of MuJoCo's camera."""
    if find_library("EGL") is None:
        pytest.skip("missing library: libEGL")
    case = Case(id="c", env=env, api=api, checks=("render.rgb_array",))
    done = probe(python(site), case, variables={"MUJOCO_GL": "egl"})
    pictures = done["render.rgb_array"].facts["pictures"]
    assert list(pictures) == ["first", "last"]
    for name, told in pictures.items():
        frame = np.load(done.folder / f"render.rgb_array-{name}.npy")
        assert told["sha256"] == hashlib.sha256(frame.tobytes()).hexdigest()
        assert (told["shape"], told["constant"], sum(told["colours"].values())) == (
            list(frame.shape), False, frame.shape[0] * frame.shape[1]
        )  # fmt: skip
    loaded_then = done["render.rgb_array"].facts["loaded"]
    assert {api, "mujoco", "numpy"} <= {*loaded_then}
    assert not {"os", "json", "encodings", "_simmatrix_cell", "__main__"} & {*loaded_then}
    camera = pictures["first"]["camera"]
    assert np.allclose([np.linalg.norm(camera[name]) for name in ("forward", "up")], 1, atol=1e-5)
    assert abs(camera["fovy"] - 45) < 0.01
    if api == "mujoco":
        assert np.allclose(camera["position"], (0, -3, 0), atol=1e-5)
        assert np.allclose(camera["forward"], (0, 1, 0), atol=1e-5)


@pytest.mark.parametrize(
    ("mode", "message"),
    [
        ("nan", "reset() returned an observation that is not finite (3 of 3 values)"),
        ("shape", "reset() returned an observation that has shape (2,), its space (3,)"),
        ("none", "reset() returned an observation that is None, not numbers"),
        ("noinfo", None),
        ("four", None),
        ("infinite", "step() returned a reward that is not finite (1 of 1 values)"),
        ("make-raise", "the true reason"),
        ("reset-raise", "the true reason"),
        ("step-raise", "the true reason"),
        ("step-sysexit", "3"),
    ],
)
def test_a_defect_that_stops_a_loop_fails(mode: str, message: str | None, run_checks) -> None:
    """An exception, a wrong arity, shape or dtype, a number that is not finite: failed, and the library's doing."""
    reply = run_checks(NEWEST, "troubled:Troubled-v0", mode, checks=("single.loop",))["single.loop"]
    assert reply.outcome is Outcome.FAILED
    assert reply.raised is not None
    assert reply.raised.blame == "library"
    assert message is None or reply.raised.message == message


def test_a_second_episode_is_begun(run_checks) -> None:
    """A loop too short for an episode's end begins another one all the same, as every training loop does."""
    reply = run_checks(NEWEST, "troubled:Troubled-v0", "again-raise", checks=("single.loop",), steps=2)["single.loop"]
    assert (reply.outcome, reply.raised and reply.raised.message) == (Outcome.FAILED, "the true reason")


def test_an_old_signature_is_the_librarys(run_checks) -> None:
    """A TypeError raised in our own frame, for a call that every user makes, is not ours."""
    raised = run_checks(NEWEST, "troubled:Old-v0", checks=("single.loop",))["single.loop"].raised
    assert (raised.type, raised.blame) == ("TypeError", "library")


@pytest.mark.parametrize(
    ("mode", "check", "text"),
    [
        ("list", "single.type", "reset() returned an observation that is a list of 3 where an array was promised"),
        ("float64", "single.type", "reset() returned an observation that has dtype float64, its space float32"),
        ("rewards", "single.type", "step() returned a reward of shape (1,), not a number"),
        ("float16", "single.type", "reset() returned an observation that has dtype float16, its space float32"),
        ("integer", "single.type", "step() returned terminated as a int, not as bool"),
        (
            "outside",
            "single.space",
            "reset() returned an observation outside its space Box(-1.0, 1.0, (3,), float32)",
        ),
        ("outside", "single.check_env", "AssertionError: The first element returned by `env.reset()` is not within"),
        ("unseeded", "single.repeat.fresh", "the same seed gives another trajectory in a new environment, from step 0"),
        ("unseeded", "single.repeat.same", "the same environment, reset with the same seed, gives another trajectory"),
        ("eachepisode", "single.repeat.same", "the same environment, reset with the same seed, gives another"),
        ("fewtasks", "single.repeat.same", "the same environment, reset with the same seed, gives another trajectory"),
        ("firstepisode", "single.repeat.first", "the first episode after make differs from later ones with the same"),
        ("close-raise", "single.teardown", "close() raised ValueError: the true reason"),
    ],
)
def test_lesser_things_are_findings(mode: str, check: str, text: str, run_checks) -> None:
    """Problems that do not stop a loop pass, with a finding."""
    done = run_checks(NEWEST, "troubled:Troubled-v0", mode, checks=("single.loop",))
    assert done["single.loop"].outcome is Outcome.PASSED
    assert done.findings[check][0].startswith(text)
    if mode == "firstepisode":
        assert not set(done.findings) & {"single.repeat.same", "single.repeat.fresh"}


@pytest.mark.parametrize("site", [*OLDEST, NEWEST])
@pytest.mark.parametrize(
    ("mode", "told"),
    [
        ("make-child-raise", ("ValueError", 1, "constructor")),
        ("make-child-segv", (None, -11, "constructor")),
        ("make-child-exit", (None, 7, "constructor")),
        ("make-child-sysexit", ("SystemExit", 3, "constructor")),
        ("reset-child-exit", (None, 7, "reset")),
        ("step-child-raise", ("ValueError", 0, "step")),
        ("step-child-segv", (None, -11, "step")),
    ],
)
def test_workers_tell_their_own_end(site: str, mode: str, told, run_checks) -> None:
    """Behind whatever the parent gets, each worker's own first exception, exit code or signal is known."""
    done = run_checks(site, "troubled:Troubled-v0", mode, checks=("vector.sync", "vector.async.fork"))
    assert outcomes(done) == {"vector.sync": Outcome.PASSED, "vector.async.fork": Outcome.FAILED}
    workers = done["vector.async.fork"].workers
    assert len(workers) == 2
    assert told in [(w.raised.type if w.raised else None, w.exit_code, w.reached) for w in workers]
    if mode.endswith("segv"):
        assert any("Segmentation fault" in (worker.stacks or "") for worker in workers)


def test_a_hanging_worker_is_seen(run_checks) -> None:
    """Workers that hang in their constructor leave how far they came and their stacks, though the parent is ended."""
    done = run_checks(
        NEWEST, "troubled:Troubled-v0", "make-child-hang", checks=("vector.async.fork",), limit=2, deadline=12
    )
    reply = done["vector.async.fork"]
    assert (done.returncode, reply.outcome) == (None, None)
    assert [worker.reached for worker in reply.workers] == ["constructor"] * 2
    assert all("troubled.py" in (worker.stacks or "") for worker in reply.workers)


@pytest.mark.parametrize(
    ("mode", "message"),
    [
        ("blank", "blank frame: every pixel is [7, 7, 7]"),
        ("nothing", "render() returned a NoneType, not an array"),
        ("frames", "render() returned a list, not an array"),
        ("floats", "render() returned dtype float64, not uint8"),
        ("gray", "render() returned shape (32, 48), not (height, width, 3)"),
        ("render-raise", "the true reason"),
    ],
)
def test_unusable_frames_fail(mode: str, message: str, run_checks) -> None:
    """A frame that is no picture fails."""
    reply = run_checks(NEWEST, "troubled:Troubled-v0", mode, checks=("render.rgb_array",))["render.rgb_array"]
    assert (reply.outcome, reply.raised and reply.raised.message) == (Outcome.FAILED, message)


def test_an_alpha_channel_is_a_finding(run_checks) -> None:
    """A picture of four channels is judged without the fourth, which no user's loop stumbles over."""
    done = run_checks(NEWEST, "troubled:Troubled-v0", "alpha", checks=("render.rgb_array",))
    assert (done["render.rgb_array"].outcome, done["render.rgb_array"].facts["shape"]) == (Outcome.PASSED, [32, 48, 3])
    assert done.findings["render.alpha"] == ["render() returned a picture with an alpha channel, which was left out"]


def test_a_package_that_lets_numpy_raise_is_no_fault_of_ours(run_checks) -> None:
    """Large numbers are compared even if a package makes numpy raise."""
    reply = run_checks(NEWEST, "troubled:Troubled-v0", "raising", checks=("render.rgb_array",))["render.rgb_array"]
    assert (reply.outcome, reply.raised) == (Outcome.PASSED, None)


def test_nothing_to_render_is_skipped(run_checks) -> None:
    """An environment that declares no rgb_array is skipped, with the reason."""
    reply = run_checks(NEWEST, "troubled:Blind-v0", checks=("render.rgb_array",))["render.rgb_array"]
    assert (reply.outcome, reply.reason) == (Outcome.SKIPPED, "the environment declares no render mode rgb_array")


def test_a_missing_extra_fails(run_checks) -> None:
    """Without pygame rendering fails: the lock lacks it, this machine does not."""
    reply = run_checks("gymnasium 0.29.1", "CartPole-v1", checks=("render.rgb_array",))["render.rgb_array"]
    assert (reply.outcome, reply.raised and reply.raised.type) == (
        Outcome.FAILED,
        "gymnasium.error.DependencyNotInstalled",
    )
