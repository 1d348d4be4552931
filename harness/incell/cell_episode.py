"""Drive an environment from make to close, as a user would."""

from contextlib import contextmanager

from .cell_errors import observed_error
from .cell_observation import current_step
from .cell_trace import Trace


@contextmanager
def open_environment(probe, phase, make):
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


def open_single(probe, draw=False):
    """Open the environment of the case; what it reports belongs to phase single, whichever phase opens it."""
    phase = "render" if draw else "single"
    return open_environment(probe, phase, lambda: probe.api.make(probe.case, reporter(probe, "single"), draw=draw))


def _close(env):
    try:
        env.close()
    except BaseException as error:
        return observed_error(error)
    return None


def reporter(probe, phase):
    """Return the function to which an environment reports lesser things, as findings of a phase."""
    return lambda kind, code, **data: probe.finding("{}.{}".format(phase, kind), code, **data)


def count_steps(steps):
    """Yield these items, or the numbers below `steps`, each as one step that observations name."""
    for number, item in enumerate(range(steps) if isinstance(steps, int) else steps):
        current_step.number = number + 1
        yield item
    current_step.number = None


def rollout(probe, env, seed=None, steps=None):
    """Reset with a seed, then step with sampled actions, with resets at episode ends; return a `Trace`."""
    seed = probe.case["seed"] if seed is None else seed
    trace = Trace()
    env.seed_actions(seed)
    trace.add(env.reset(seed))
    for _ in count_steps(probe.case["steps"] if steps is None else steps):
        values = env.step(env.action())
        trace.add(*values)
        if values[2] or values[3]:
            trace.add(env.reset())
    return trace


def run_episode(probe):
    """Drive a new environment from make to close and return its `Trace`."""
    with open_single(probe) as env:
        return rollout(probe, env)


def continue_with(env, actions):
    """Step with these actions, to the end of the episode at most, and return the `Trace`."""
    trace = Trace()
    for action in count_steps(actions):
        values = env.step(action)
        trace.add(*values)
        if values[2] or values[3]:
            break
    return trace
