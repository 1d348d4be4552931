"""Let Stable-Baselines3 learn."""

import importlib

from .cell_errors import library
from .cell_interop import close, import_sb3, make_environment
from .cell_learners import learn

STEPS = 64
"""How long a learner learns: two rounds of steps, with an update after each."""


def run(probe, facts):
    """Let PPO learn for two rounds on the CPU, and act once."""
    sb3 = import_sb3(facts)
    with library:
        vectors = importlib.import_module("stable_baselines3.common.vec_env")
        env = vectors.DummyVecEnv([lambda: make_environment(probe)])
    try:
        with library:
            rounds = {"n_steps": STEPS // 2, "batch_size": STEPS // 2, "n_epochs": 1}
            model = sb3.PPO(_policy(env), env, device="cpu", seed=probe.case["seed"], **rounds)
        learn(facts, model, STEPS)
        with library:
            action, _ = model.predict(env.reset(), deterministic=True)
            env.step(action)
    finally:
        close(env)


def _policy(env):
    """Return the policy that suits the observations: of several parts, or one array.

    A picture would do with a network of convolutions; the plain one learns from it, too, and is there for any size.
    """
    several = type(env.observation_space).__name__ == "Dict"
    return "MultiInputPolicy" if several else "MlpPolicy"
