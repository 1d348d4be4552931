"""An environment from make to close, driven as a user would."""

from contextlib import contextmanager

from .cell_errors import library, summary
from .cell_trace import Trace
from .cell_values import Examiner


@contextmanager
def opened(probe, phase, make, *args, **kwargs):
    """Make an environment and close it; an exception of close() is a finding, and none after a failure."""
    with library:
        env = make(*args, **kwargs)
    try:
        yield env
    except BaseException:
        _close(env)
        raise
    error = _close(env)
    if error:
        probe.finding(phase + ".teardown", "close() raised {}".format(error))


def _close(env):
    try:
        env.close()
    except BaseException as error:
        return summary(error)
    return None


def tell(probe, phase):
    """Return what an examiner tells its lesser things to."""
    return lambda kind, text: probe.finding("{}.{}".format(phase, kind), text)


def rollout(probe, env):
    """Seeded reset, then steps with sampled actions and resets at episode ends: a `Trace`."""
    seed = probe.case["seed"]
    examiner = Examiner(probe.api.spaces, env, tell(probe, "single"))
    trace = Trace()
    with library:
        env.action_space.seed(seed)
        result = env.reset(seed=seed)
    trace.add(examiner.reset(result))
    for _ in range(probe.case["steps"]):
        with library:
            result = env.step(env.action_space.sample())
        values = examiner.step(result)
        trace.add(*values)
        if values[2] or values[3]:
            with library:
                result = env.reset()
            trace.add(examiner.reset(result))
    return trace
