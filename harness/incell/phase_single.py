"""Phase single: one environment in a user's loop."""

import sys
import warnings

from .cell_contact import contact
from .cell_episode import onward, rollout, single
from .cell_errors import Skip
from .cell_solver import solver
from .cell_start import start_pose
from .cell_used import Called, distribution_of, exercised

STEPS_WITH_ANOTHER_SEED = 10
STEPS_FROM_A_STATE = 10
FURTHER_EPISODES, STEPS_OF_A_FURTHER_ONE = 5, 3


def loop(probe, facts):
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
    """The same environment reset with the same seed again, and again; then with another seed."""
    with single(probe) as env:
        first, second, third = [rollout(probe, env) for _ in range(3)]
        between = second.difference(third)
        if first.difference(second) and not between:
            between = _by_chance(probe, env, second)
        other = rollout(probe, env, probe.case["seed"] + 1, STEPS_WITH_ANOTHER_SEED)
    if between:
        text = "the same environment, reset with the same seed, gives another trajectory, "
        probe.finding("single.repeat.same", text + between)
    elif first.difference(second):
        text = "the first episode after make differs from later ones with the same seed, which agree, "
        probe.finding("single.repeat.first", text + first.difference(second))
    elif other.digests[0] == first.digests[0]:
        text = "another seed gives the same first observation: it starts always alike, or does not heed its seed"
        probe.finding("single.repeat.seed", text, level="note")


def _by_chance(probe, env, expected):
    """Return how further episodes differ from two that agreed: where few tasks are drawn from, two may be alike."""
    for _ in range(FURTHER_EPISODES):
        again = rollout(probe, env, steps=STEPS_OF_A_FURTHER_ONE)
        if again.digests != expected.digests[: len(again.digests)]:
            return expected.difference(again)
    return None


def state(probe, _facts):
    """A state that was saved and restored goes on as it did the first time."""
    with single(probe) as env:
        if env.get_state is None:
            message = "its state cannot be had"
            raise Skip(message)
        rollout(probe, env, steps=STEPS_FROM_A_STATE)
        kept = env.get_state()
        actions = [env.action() for _ in range(STEPS_FROM_A_STATE)]
        first = onward(env, actions)
        env.set_state(kept)
        difference = first.difference(onward(env, actions))
    if difference:
        probe.finding("single.state", "a restored state goes on otherwise than it did, " + difference)


def check_env(probe, _facts):
    """Run the library's own checker; its warnings and what it raises are findings."""
    probe.watch.take_warnings()
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        probe.api.check_env(probe.case)
    for text in probe.watch.take_warnings():
        probe.finding("single.check_env", text)


def arrays(probe, _facts):
    """See whether what was promised as an array was one."""
    bullet = sys.modules.get("pybullet")
    if not getattr(bullet, "isNumpyEnabled", lambda: 1)():
        reason = "could not be measured as arrays: this pybullet was built without numpy, and gives tuples"
        raise Skip(reason)
    for text in probe.findings("single.type"):
        if "where an array was promised" in text:
            reason = "could not be measured as arrays: " + text
            raise Skip(reason)


def _episode(probe):
    with single(probe) as env:
        return rollout(probe, env)


CHECKS = {
    "single.loop": loop,
    "single.repeat": repeat,
    "single.repeat.fresh": fresh,
    "single.repeat.same": same,
    "single.state": state,
    "single.check_env": check_env,
    "single.start_pose": start_pose,
    "single.contact": contact,
    "single.solver": solver,
    "single.arrays": arrays,
}
FOLLOWERS = {
    "single.loop": (
        "single.repeat.fresh",
        "single.repeat.same",
        "single.state",
        "single.check_env",
        "single.start_pose",
        "single.contact",
        "single.solver",
        "single.arrays",
    )
}
