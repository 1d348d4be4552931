"""Phase interop: an environment under the libraries that train with it, a function for each thing done with one."""

import importlib
import sys
import warnings

from . import cell_torchrl
from .cell_errors import library
from .cell_interop import close, made, present

SB3 = "stable_baselines3"
STEPS = 64
"""How long a learner learns: two rounds of steps, with an update after each."""


def sb3_check_env(probe, facts):
    """Stable-Baselines3's own checker; its warnings are findings."""
    facts["version"] = _version(present(SB3, "stable-baselines3"))
    probe.watch.take_warnings()
    with library:
        checker = importlib.import_module(SB3 + ".common.env_checker")
        env = made(probe)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        with library:
            checker.check_env(env)
    close(env)
    for text in probe.watch.take_warnings():
        probe.finding("interop.sb3.check_env", text)


def sb3_learn(probe, facts):
    """Let PPO learn for two rounds on the CPU, and act once."""
    sb3 = present(SB3, "stable-baselines3")
    facts["version"] = _version(sb3)
    with library:
        vectors = importlib.import_module(SB3 + ".common.vec_env")
        env = vectors.DummyVecEnv([lambda: made(probe)])
    try:
        with library:
            rounds = {"n_steps": STEPS // 2, "batch_size": STEPS // 2, "n_epochs": 1}
            model = sb3.PPO(_policy(env), env, device="cpu", seed=probe.case["seed"], **rounds)
            model.learn(total_timesteps=STEPS)
            action, _ = model.predict(env.reset(), deterministic=True)
            env.step(action)
        facts["steps"] = int(model.num_timesteps)
    finally:
        close(env)


def _policy(env):
    """The policy that suits the observations: of several parts, or one array.

    A picture would do with a network of convolutions; the plain one learns from it, too, and is there for any size.
    """
    several = type(env.observation_space).__name__ == "Dict"
    return "MultiInputPolicy" if several else "MlpPolicy"


def _version(module):
    torch = sys.modules.get("torch")
    return {"library": str(module.__version__), "torch": str(getattr(torch, "__version__", "?"))}


CHECKS = {"interop.sb3.check_env": sb3_check_env, "interop.sb3.learn": sb3_learn}
CHECKS.update(cell_torchrl.CHECKS)
FOLLOWERS = {}
