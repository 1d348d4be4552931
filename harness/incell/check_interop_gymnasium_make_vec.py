"""Drive the vector environment that a package brings itself, as `gymnasium.make_vec` makes it."""

import importlib

from .cell_episode import count_steps, open_environment, reporter
from .cell_errors import library, skip, violate
from .cell_trace import Trace

CHECK = "interop.gymnasium.make_vec"
MODE = "vector_entry_point"
"""The mode of `make_vec` that makes the package's own vector environment, and none of single ones."""


def run(probe, facts):
    """Make it twice: the same seed and actions have to give the same, and the observations have to change."""
    _skip_without_entry_point(probe)
    facts["environments"] = probe.num_envs
    first, second = _trace(probe, facts), _trace(probe, facts)
    difference = first.difference(second)
    if difference:
        probe.finding(CHECK, "gymnasium.vector_repeat", at=difference["step"], difference=difference)


def _skip_without_entry_point(probe):
    """Skip environments whose package brings no vector environment."""
    gymnasium = importlib.import_module("gymnasium")
    registration = importlib.import_module("gymnasium.envs.registration")
    module, _, name = probe.api.local_name(probe.case).rpartition(":")
    with library:
        if module:  # `make` imports it, `spec` does not
            importlib.import_module(module)
        spec = gymnasium.spec(name)
    if not hasattr(registration, "VectorizeMode") or spec.vector_entry_point is None:
        skip("gymnasium.no_vector_entry_point")


def _trace(probe, facts):
    """Return the trace of some steps of a new vector environment."""
    trace = Trace()
    with open_environment(probe, "interop", lambda: _make(probe)) as env:
        env.seed_actions(probe.case["seed"])
        facts.update(env.describe())
        observations = [env.reset(probe.case["seed"])]
        trace.add(observations[0])
        for _ in count_steps(probe.case["steps"]):
            values = env.step(env.action())
            observations.append(values[0])
            trace.add(*values)
    if not _changes(observations):
        violate("gymnasium.vector_constant", steps=probe.case["steps"])
    return trace


def _make(probe):
    """Make the vector environment, to be driven like those of the phase `vector`."""
    with library:
        name, options = probe.api.local_name(probe.case), probe.case["kwargs"]
        gymnasium = importlib.import_module("gymnasium")
        raw = gymnasium.make_vec(name, num_envs=probe.num_envs, vectorization_mode=MODE, **options)
    return probe.api.wrap(raw, reporter(probe, "interop"), batch=probe.num_envs)


def _changes(observations):
    """Return whether some observation differs from the first one."""
    traces = [Trace() for _ in observations]
    for trace, observation in zip(traces, observations):
        trace.add(observation)
    return any(trace.digests != traces[0].digests for trace in traces)
