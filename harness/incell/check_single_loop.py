"""Drive one environment in a user's loop."""

from .cell_episode import open_single, rollout
from .cell_used_packages import CallWatch, distribution_of, used_distributions


def run(probe, facts):
    """Make, reset with a seed, step, reset at episode ends, close."""
    with open_single(probe) as env:
        trace = rollout(probe, env)
        with CallWatch() as calls:
            env.reset()  # a training loop comes to its second episode, however few steps were made here
            env.step(env.action())
        probe.memo["rewards"] = env.reward_size()
        facts.update(env.describe())
        facts["environment_of"] = distribution_of(type(getattr(env.raw, "unwrapped", None)))
    distributions = used_distributions(calls, probe.own_imports())
    facts["exercised"] = sorted({*distributions, facts["environment_of"]} - {None})
    facts["trajectory"], facts["values"] = trace.steps(), trace.values()
    probe.memo["trace"] = trace
