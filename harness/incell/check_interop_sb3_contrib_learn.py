"""Let sb3-contrib learn."""

import importlib

from .cell_errors import library
from .cell_interop import close, import_sb3, import_trainer, make_environment
from .cell_learners import check_count, check_return, compare_parameters, copy_parameters, seed_torch

STEPS = 64
"""Steps that each learner makes: two rounds, with an update after each."""


def run(probe, facts):
    """Let TRPO learn for two rounds on the CPU, and a recurrent PPO; evaluate both by their library's own function."""
    contrib = import_trainer("sb3_contrib", "sb3-contrib")
    import_sb3({})
    seed_torch(probe, facts, contrib)
    with library:
        monitor = importlib.import_module("stable_baselines3.common.monitor").Monitor
        evaluate = importlib.import_module("stable_baselines3.common.evaluation").evaluate_policy
    rounds = {"n_steps": STEPS // 2, "batch_size": STEPS // 2, "device": "cpu", "seed": probe.case["seed"]}
    for learner, policy, more in (
        (contrib.TRPO, "MlpPolicy", {}),
        (contrib.RecurrentPPO, "MlpLstmPolicy", {"n_epochs": 1}),
    ):
        env = make_environment(probe)
        try:
            with library:
                model = learner(policy, monitor(env), **rounds, **more)
                before = copy_parameters(model.policy)
                model.learn(total_timesteps=STEPS)
                mean, _ = evaluate(model, model.get_env(), n_eval_episodes=1)
            compare_parameters(before, copy_parameters(model.policy))
            check_count(STEPS, model.num_timesteps)
            check_return(mean)
            facts["steps"] = facts.get("steps", 0) + STEPS
        finally:
            close(env)
