"""Compare the trajectory of another new environment with the first one."""

from .cell_episode import run_episode


def run(probe, _facts):
    """Compare the trajectory of the same seed in another new environment of this process."""
    difference = probe.memo["trace"].difference(run_episode(probe))
    if difference:
        probe.finding("single.repeat.fresh", "repeat.fresh", at=difference["step"], difference=difference)
