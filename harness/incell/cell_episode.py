"""An environment from make to close, driven as a user would."""

from contextlib import contextmanager

from .cell_errors import raised
from .cell_observed import step
from .cell_trace import Trace


@contextmanager
def opened(probe, phase, make):
    """Make an environment and close it; an exception of close() is a finding, and none after a failure."""
    env = make()
    try:
        yield env
    except BaseException:
        _close(env)
        raise
    error = _close(env)
    if error:
        probe.finding(phase + ".teardown", "teardown.close", raised=error)


def single(probe, draw=False):
    """Open the environment of the case; what it tells beside is of phase single, whoever runs it."""
    phase = "render" if draw else "single"
    return opened(probe, phase, lambda: probe.api.make(probe.case, teller(probe, "single"), draw=draw))


def _close(env):
    try:
        env.close()
    except BaseException as error:
        return raised(error)
    return None


def teller(probe, phase):
    """Return the function to which an examiner reports its lesser things."""
    return lambda kind, code, **data: probe.finding("{}.{}".format(phase, kind), code, **data)


def counted(steps):
    """Count the steps that are made for each of these, or so many of them, for what is observed meanwhile."""
    for number, each in enumerate(range(steps) if isinstance(steps, int) else steps):
        step.number = number + 1
        yield each
    step.number = None


def rollout(probe, env, seed=None, steps=None):
    """Seeded reset, then steps with sampled actions and resets at episode ends: a `Trace`."""
    seed = probe.case["seed"] if seed is None else seed
    trace = Trace()
    env.seed_actions(seed)
    trace.add(env.reset(seed))
    for _ in counted(probe.case["steps"] if steps is None else steps):
        values = env.step(env.action())
        trace.add(*values)
        if values[2] or values[3]:
            trace.add(env.reset())
    return trace


def episode(probe):
    """Drive a new environment from make to close: a `Trace`."""
    with single(probe) as env:
        return rollout(probe, env)


def onward(env, actions):
    """Go on with these actions, to the end of the episode at most: a `Trace`."""
    trace = Trace()
    for action in counted(actions):
        values = env.step(action)
        trace.add(*values)
        if values[2] or values[3]:
            break
    return trace
