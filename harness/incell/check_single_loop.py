"""Drives one environment in a user's loop."""

from .cell_episode import rollout, single
from .cell_used import Called, distribution_of, exercised


def run(probe, facts):
    """Make, reset with a seed, step, reset at episode ends, close."""
    with single(probe) as env:
        trace = rollout(probe, env)
        with Called() as called:
            env.reset()  # a training loop comes to its second episode, however few steps were made here
            env.step(env.action())
        probe.memo["rewards"] = env.rewards()
        facts.update(env.describe())
        facts["environment_of"] = distribution_of(type(getattr(getattr(env, "raw", None), "unwrapped", None)))
    found = exercised(called, probe.ours())
    facts["exercised"] = sorted({*found, facts["environment_of"]} - {None})
    facts["trajectory"], facts["values"] = trace.steps(), trace.values()
    probe.memo["trace"] = trace
