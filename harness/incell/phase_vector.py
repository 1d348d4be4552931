"""Phase vector: several environments as one, in this process and in workers."""

import multiprocessing
import os

from .cell_episode import opened, tell
from .cell_errors import Skip
from .cell_workers import Maker, endings, finish, processes

PATIENCE = 3.0
"""Seconds given to workers to end by themselves after a failure or a close."""

FEWEST, MOST = 4, 16
"""How many environments `vector.async.many` has at least and at most."""


def sync(probe, facts):
    """All environments in this process."""
    makers = [Maker(probe, "vector.sync")] * probe.num_envs
    with opened(probe, "vector", lambda: probe.api.make_vector(makers, None, tell(probe, "vector"))) as env:
        _rollout(probe, env, facts)


def many():
    """More environments than this process may use cores."""
    return min(max(FEWEST, 2 * len(os.sched_getaffinity(0))), MOST)


def _in_workers(check, method, **more):
    """Return the check of one worker for each environment."""

    def run(probe, facts):
        if method not in multiprocessing.get_all_start_methods():
            message = "this system has no start method {}".format(method)
            raise Skip(message)
        number = many() if check.endswith(".many") else probe.num_envs
        facts["environments"] = number
        _watched(probe, [Maker(probe, check)] * number, dict(more, context=method), facts)

    return run


def _watched(probe, makers, way, facts):
    """Run environments in workers, and see how these end."""
    env = None
    try:
        with opened(probe, "vector", lambda: probe.api.make_vector(makers, way, tell(probe, "vector"))) as env:
            _rollout(probe, env, facts)
    except BaseException as error:
        workers = processes(env, error)
        probe.workers = endings(workers, PATIENCE)
        finish(workers)
        raise
    workers = processes(env, None)
    probe.workers = endings(workers, PATIENCE)
    finish(workers)
    for ended in probe.workers:
        if ended["exit_code"] is None:
            probe.finding("vector.teardown", "a worker went on after close()")
        elif ended["exit_code"] != 0:
            probe.finding(
                "vector.teardown", "a worker ended with exit code {} after close()".format(ended["exit_code"])
            )


def _rollout(probe, env, facts):
    env.seed_actions(probe.case["seed"])
    facts.update(env.describe())
    env.reset(probe.case["seed"])
    for _ in range(probe.vector_steps):
        env.step(env.action())


CHECKS = {
    "vector.sync": sync,
    "vector.async.fork": _in_workers("vector.async.fork", "fork"),
    "vector.async.spawn": _in_workers("vector.async.spawn", "spawn"),
    "vector.async.forkserver": _in_workers("vector.async.forkserver", "forkserver"),
    "vector.async.unshared": _in_workers("vector.async.unshared", "fork", shared_memory=False),
    "vector.async.many": _in_workers("vector.async.many", "fork"),
}
FOLLOWERS = {}
