"""Saves a state, restores it and goes on from it."""

from .cell_episode import onward, rollout, single
from .cell_errors import skip

STEPS_FROM_A_STATE = 10


def run(probe, _facts):
    """Check that a saved and restored state goes on as it did the first time."""
    with single(probe) as env:
        if env.get_state is None:
            skip("skip.no_state")
        rollout(probe, env, steps=STEPS_FROM_A_STATE)
        kept = env.get_state()
        actions = [env.action() for _ in range(STEPS_FROM_A_STATE)]
        first = onward(env, actions)
        env.set_state(kept)
        difference = first.difference(onward(env, actions))
    if difference:
        probe.finding("single.state", "state.restored", at=difference["step"], difference=difference)
