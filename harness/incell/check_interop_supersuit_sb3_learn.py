"""Let Stable-Baselines3 learn in a PettingZoo environment that SuperSuit converts."""

from .cell_errors import library
from .cell_interop import close, import_sb3
from .cell_learners import learn
from .cell_supersuit import COPIES, make_vector

STEPS = 16
"""Steps of every agent in a round of learning."""


def run(probe, facts):
    """Let PPO learn for two rounds on the CPU, and act once; such a vector environment takes no seed from it."""
    sb3 = import_sb3(facts)
    env, vector = make_vector(probe, facts, "stable_baselines3")
    try:
        with library:
            rounds = {"n_steps": STEPS, "batch_size": STEPS, "n_epochs": 1}
            model = sb3.PPO("MlpPolicy", vector, device="cpu", **rounds)
        learn(facts, model, 2 * STEPS * COPIES * len(env.possible_agents))
        with library:
            action, _ = model.predict(vector.reset(), deterministic=True)
            vector.step(action)
    finally:
        close(vector)
