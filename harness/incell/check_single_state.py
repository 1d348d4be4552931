"""Save a state, restore it and go on from it."""

from .cell_episode import continue_with, open_single, rollout
from .cell_errors import skip

STEPS_FROM_A_STATE = 10


def run(probe, _facts):
    """Check that a saved and restored state goes on as it did the first time."""
    with open_single(probe) as env:
        if env.get_state is None:
            skip("skip.no_state")
        rollout(probe, env, steps=STEPS_FROM_A_STATE)
        state = env.get_state()
        actions = [env.action() for _ in range(STEPS_FROM_A_STATE)]
        first = continue_with(env, actions)
        env.set_state(state)
        difference = first.difference(continue_with(env, actions))
    if difference:
        probe.finding("single.state", "state.restored", at=difference["step"], difference=difference)
