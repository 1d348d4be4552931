"""Drive all environments in this process."""

from .cell_batch import compare_rollout, open_batch, skip_several_rewards
from .cell_workers import Maker


def run(probe, facts):
    """Drive all environments in this process."""
    skip_several_rewards(probe)
    facts["environments"] = probe.num_envs
    makers = [Maker(probe, "vector.sync")] * probe.num_envs
    with open_batch(probe, makers, None) as env:
        compare_rollout(probe, env, "vector.sync", facts)
