"""Compare trajectories of one environment that is reset with the same seed, and with another."""

from .cell_episode import open_single, rollout

STEPS_WITH_ANOTHER_SEED = 10
FURTHER_EPISODES, STEPS_OF_A_FURTHER_ONE = 5, 3


def run(probe, _facts):
    """Reset the same environment with the same seed again, and again; then with another seed."""
    with open_single(probe) as env:
        first, second, third = [rollout(probe, env) for _ in range(3)]
        between = second.difference(third)
        if first.difference(second) and not between:
            between = _by_chance(probe, env, second)
        other = rollout(probe, env, probe.case["seed"] + 1, STEPS_WITH_ANOTHER_SEED)
    if between:
        probe.finding("single.repeat.same", "repeat.same", at=between["step"], difference=between)
    elif first.difference(second):
        difference = first.difference(second)
        probe.finding("single.repeat.first", "repeat.first", at=difference["step"], difference=difference)
    elif other.digests[0] == first.digests[0]:
        probe.finding("single.repeat.seed", "repeat.seed", level="note")


def _by_chance(probe, env, expected):
    """Return how further episodes differ from two that agreed: where few tasks are drawn from, two may be alike."""
    for _ in range(FURTHER_EPISODES):
        again = rollout(probe, env, steps=STEPS_OF_A_FURTHER_ONE)
        if again.digests != expected.digests[: len(again.digests)]:
            return expected.difference(again)
    return None
