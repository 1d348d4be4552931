"""Drives all environments in this process."""

from .cell_batch import opened_batch, roll_out, skip_several_rewards
from .cell_workers import Maker


def run(probe, facts):
    """Drive all environments in this process."""
    skip_several_rewards(probe)
    facts["environments"] = probe.num_envs
    makers = [Maker(probe, "vector.sync")] * probe.num_envs
    with opened_batch(probe, makers, None) as env:
        roll_out(probe, env, "vector.sync", facts)
