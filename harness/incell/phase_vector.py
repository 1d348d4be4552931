"""Phase vector: several environments as one, in this process and in workers."""

import multiprocessing

from .cell_episode import opened, tell
from .cell_errors import Skip, library
from .cell_values import Examiner
from .cell_workers import Maker, endings, finish, processes

PATIENCE = 3.0
"""Seconds given to workers to end by themselves after a failure or a close."""


def sync(probe, facts):
    """All environments in this process."""
    makers = [Maker(probe, "vector.sync")] * probe.num_envs
    with opened(probe, "vector", lambda: probe.api.vector.SyncVectorEnv(makers)) as env:
        _rollout(probe, env, facts)


def async_fork(probe, facts):
    """One forked worker for each environment."""
    if "fork" not in multiprocessing.get_all_start_methods():
        reason = "this system cannot fork"
        raise Skip(reason)
    makers = [Maker(probe, "vector.async.fork")] * probe.num_envs
    env = None
    try:
        with opened(probe, "vector", lambda: probe.api.vector.AsyncVectorEnv(makers, context="fork")) as env:
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
    seed = probe.case["seed"]
    examiner = Examiner(probe.api.spaces, env, tell(probe, "vector"), batch=probe.num_envs)
    with library:
        facts["observation_space"] = str(env.observation_space)[:500]
        env.action_space.seed(seed)
        result = env.reset(seed=seed)
    examiner.reset(result)
    for _ in range(probe.vector_steps):
        with library:
            result = env.step(env.action_space.sample())
        examiner.step(result)


CHECKS = {"vector.sync": sync, "vector.async.fork": async_fork}
FOLLOWERS = {}
