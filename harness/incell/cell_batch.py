"""Drives several environments as one, in this process or in workers."""

import multiprocessing
import os

import numpy as np

from .cell_episode import counted, opened, single, teller
from .cell_errors import skip
from .cell_trace import Trace
from .cell_workers import Maker, endings, finish, processes

PATIENCE = 3.0
"""Seconds given to workers to end by themselves after a failure or a close."""

FEWEST, MOST = 4, 16
"""The least and the largest number of environments of `vector.async.many`."""


def many():
    """More environments than this process may use cores."""
    return min(max(FEWEST, 2 * len(os.sched_getaffinity(0))), MOST)


def in_workers(check, method, **more):
    """Return the check of one worker for each environment."""

    def run(probe, facts):
        if method not in multiprocessing.get_all_start_methods():
            skip("vector.no_method", method=method)
        skip_several_rewards(probe)
        number = many() if check.endswith(".many") else probe.num_envs
        facts["environments"] = number
        way = dict(more, context=method)
        in_watched_workers(probe, [Maker(probe, check)] * number, way, lambda env: roll_out(probe, env, check, facts))

    return run


def in_watched_workers(probe, makers, way, use):
    """Run environments in workers, and see how these end."""
    env = None
    try:
        with opened_batch(probe, makers, way) as env:
            use(env)
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
            probe.finding("vector.teardown", "vector.teardown.stays")
        elif ended["exit_code"] != 0:
            probe.finding("vector.teardown", "vector.teardown.exit", got=ended["exit_code"])


def opened_batch(probe, makers, way):
    """Open several environments as one, in the way that is given."""
    return opened(probe, "vector", lambda: probe.api.make_vector(makers, way, teller(probe, "vector")))


def skip_several_rewards(probe):
    """Skip a check of environments whose rewards are several numbers: a batch has room for one of each."""
    if not probe.api.one_reward:
        return
    if "rewards" not in probe.memo:
        with single(probe) as env:  # made and no more: what it draws with must not be there before workers are forked
            probe.memo["rewards"] = env.rewards()
    number = probe.memo["rewards"]
    if number > 1:
        skip("vector.rewards", got=number)


def roll_out(probe, env, check, facts):
    """Make some steps; the same seed and actions should give the same in this process and in workers."""
    trace = Trace()
    env.seed_actions(probe.case["seed"])
    facts.update(env.describe())
    trace.add(env.reset(probe.case["seed"]))
    for _ in counted(probe.vector_steps):
        observation, reward, terminated, truncated = env.step(env.action())
        trace.add(observation, np.asarray(reward, float), terminated, truncated)  # integers in old workers
    known, first = probe.memo.setdefault("vector of {}".format(facts.get("environments")), (trace, check))
    difference = known.difference(trace)
    if difference:
        at = difference["step"]
        probe.finding("vector.repeat", "vector.repeat", at=at, here=check, there=first, difference=difference)
