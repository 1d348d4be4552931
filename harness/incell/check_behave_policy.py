"""Plays an environment by the policy that the case names."""

import numpy as np

from .cell_arrays import save
from .cell_episode import open_single
from .cell_policies import POLICIES, play

PLAYED = "played.npz"


def run(probe, _facts):
    """Play the episodes that the case asks for, and write start, return, length and success of each.

    The first one is played once more in the end, to see whether episodes repeat themselves.
    """
    with open_single(probe) as env:
        policy = POLICIES[probe.case["policy"]["by"]](env, probe.case)
        episodes = [play(policy, number) for number in range(probe.case["policy"]["episodes"])]
        again = play(policy, 0)
    starts, returns, lengths, successes = zip(*episodes)
    arrays = {
        "start": np.array(starts, dtype=np.float32),
        "return": np.array(returns, dtype=float),
        "length": np.array(lengths, dtype=np.int32),
        "success": np.array(successes, dtype=np.int8),
    }
    save(probe, PLAYED, arrays, {"form": 1, "repeats": again[1:] == episodes[0][1:]})
