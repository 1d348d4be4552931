"""Phase vector: several environments as one, in this process and in workers."""

import multiprocessing
import os

import numpy as np

from .cell_autoreset import Short, beside_single
from .cell_episode import opened, single, tell
from .cell_errors import Skip
from .cell_trace import Trace
from .cell_workers import Maker, endings, finish, processes

PATIENCE = 3.0
"""Seconds given to workers to end by themselves after a failure or a close."""

FEWEST, MOST = 4, 16
"""How many environments `vector.async.many` has at least and at most."""


def sync(probe, facts):
    """All environments in this process."""
    _numbers(probe)
    facts["environments"] = probe.num_envs
    makers = [Maker(probe, "vector.sync")] * probe.num_envs
    with _opened(probe, makers, None) as env:
        _rollout(probe, env, "vector.sync", facts)


def autoreset(probe, facts):
    """Over the ends of episodes, in this process and in workers, in each way that the library has."""
    check = "vector.autoreset"
    _numbers(probe)
    modes = probe.api.autoreset_modes()
    facts["modes"] = list(modes)
    makers = [Short(probe, check)] * probe.num_envs
    for name, chosen in modes.items():

        def go_over(env, mode=name):
            difference, lost = beside_single(probe, env, mode, makers[0])
            if difference:
                probe.finding(check, "{}, episodes that begin in mode {}".format(difference, mode))
            if lost:
                text = "the last observation of an episode is not handed out: the next one's first stands in its place"
                probe.finding(check, text, level="note")

        with _opened(probe, makers, dict(chosen)) as env:
            go_over(env)
        _watched(probe, makers, dict(chosen, context="fork"), go_over)


def _numbers(probe):
    """Skip a check of environments whose rewards are several numbers: a batch has room for one of each."""
    if not probe.api.one_reward:
        return
    if "rewards" not in probe.memo:
        with single(probe) as env:  # made and no more: what it draws with must not be there before workers are forked
            probe.memo["rewards"] = env.rewards()
    number = probe.memo["rewards"]
    if number > 1:
        message = "its rewards are {} numbers, and environments in batches hold one of each".format(number)
        raise Skip(message)


def many():
    """More environments than this process may use cores."""
    return min(max(FEWEST, 2 * len(os.sched_getaffinity(0))), MOST)


def _in_workers(check, method, **more):
    """Return the check of one worker for each environment."""

    def run(probe, facts):
        if method not in multiprocessing.get_all_start_methods():
            message = "this system has no start method {}".format(method)
            raise Skip(message)
        _numbers(probe)
        number = many() if check.endswith(".many") else probe.num_envs
        facts["environments"] = number
        way = dict(more, context=method)
        _watched(probe, [Maker(probe, check)] * number, way, lambda env: _rollout(probe, env, check, facts))

    return run


def _watched(probe, makers, way, drive):
    """Run environments in workers, and see how these end."""
    env = None
    try:
        with _opened(probe, makers, way) as env:
            drive(env)
    except BaseException as error:
        workers = processes(env, error)
        probe.workers += endings(workers, PATIENCE)
        finish(workers)
        raise
    workers = processes(env, None)
    done = endings(workers, PATIENCE)
    probe.workers += done
    finish(workers)
    for ended in done:
        if ended["exit_code"] is None:
            probe.finding("vector.teardown", "a worker went on after close()")
        elif ended["exit_code"] != 0:
            probe.finding(
                "vector.teardown", "a worker ended with exit code {} after close()".format(ended["exit_code"])
            )


def _opened(probe, makers, way):
    return opened(probe, "vector", lambda: probe.api.make_vector(makers, way, tell(probe, "vector")))


def _rollout(probe, env, check, facts):
    """Make some steps; the same seed and actions should give the same in this process and in workers."""
    trace = Trace()
    env.seed_actions(probe.case["seed"])
    facts.update(env.describe())
    trace.add(env.reset(probe.case["seed"]))
    for _ in range(probe.vector_steps):
        observation, reward, terminated, truncated = env.step(env.action())
        trace.add(observation, np.asarray(reward, float), terminated, truncated)  # integers in old workers
    known, first = probe.memo.setdefault("vector of {}".format(facts.get("environments")), (trace, check))
    difference = known.difference(trace)
    if difference:
        text = "the same seed and actions give other values in {} than in {}, {}"
        probe.finding("vector.repeat", text.format(check, first, difference))


CHECKS = {
    "vector.sync": sync,
    "vector.async.fork": _in_workers("vector.async.fork", "fork"),
    "vector.async.spawn": _in_workers("vector.async.spawn", "spawn"),
    "vector.async.forkserver": _in_workers("vector.async.forkserver", "forkserver"),
    "vector.async.unshared": _in_workers("vector.async.unshared", "fork", shared_memory=False),
    "vector.async.many": _in_workers("vector.async.many", "fork"),
    "vector.autoreset": autoreset,
}
FOLLOWERS = {}
