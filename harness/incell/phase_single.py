"""Phase single: one environment in a user's loop."""

import warnings

from .cell_episode import opened, rollout
from .cell_errors import library


def loop(probe, facts):
    """Make, reset with a seed, step, reset at episode ends, close."""
    with opened(probe, "single", probe.api.make, probe.case) as env:
        trace = rollout(probe, env)
        with library:
            facts["observation_space"] = str(env.observation_space)[:500]
            facts["action_space"] = str(env.action_space)[:500]
    facts["trajectory"] = trace.steps()
    probe.memo["trace"] = trace


def repeat(probe, facts):
    """Only the trajectory: for a second process, to be compared with the first one's."""
    facts["trajectory"] = _episode(probe).steps()


def fresh(probe, _facts):
    """The same seed in another new environment of this process."""
    difference = probe.memo["trace"].difference(_episode(probe))
    if difference:
        probe.finding(
            "single.repeat.fresh", "the same seed gives another trajectory in a new environment, " + difference
        )


def same(probe, _facts):
    """The same environment reset with the same seed again, and again."""
    with opened(probe, "single", probe.api.make, probe.case) as env:
        first, second, third = [rollout(probe, env) for _ in range(3)]
    between = second.difference(third)
    if between:
        text = "the same environment, reset with the same seed, gives another trajectory, "
        probe.finding("single.repeat.same", text + between)
    elif first.difference(second):
        text = "the first episode after make differs from later ones with the same seed, which agree, "
        probe.finding("single.repeat.first", text + first.difference(second))


def check_env(probe, _facts):
    """Run the library's own checker; its warnings and what it raises are findings."""
    probe.watch.take_warnings()
    with opened(probe, "single", probe.api.make, probe.case) as env, warnings.catch_warnings():
        warnings.simplefilter("always")
        with library:
            probe.api.check_env(env)
    for text in probe.watch.take_warnings():
        probe.finding("single.check_env", text)


def _episode(probe):
    with opened(probe, "single", probe.api.make, probe.case) as env:
        return rollout(probe, env)


CHECKS = {
    "single.loop": loop,
    "single.repeat": repeat,
    "single.repeat.fresh": fresh,
    "single.repeat.same": same,
    "single.check_env": check_env,
}
FOLLOWERS = {"single.loop": ("single.repeat.fresh", "single.repeat.same", "single.check_env")}
