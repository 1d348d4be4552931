"""Drive several environments as one, in this process or in workers."""

import multiprocessing
import os

import numpy as np

from .cell_episode import count_steps, open_environment, open_single, reporter
from .cell_errors import skip
from .cell_trace import Trace
from .cell_workers import Maker, end_workers

PATIENCE = 3.0
"""Seconds given to workers to end by themselves after a failure or a close."""

FEWEST, MOST = 4, 16
"""The least and the largest number of environments of `vector.async.many`."""


def worker_check(check, method, **more):
    """Return a check of environments that each have a worker, which this start method starts."""

    def run(probe, facts):
        if method not in multiprocessing.get_all_start_methods():
            skip("vector.no_method", method=method)
        skip_several_rewards(probe)
        number = probe.num_envs
        if check.endswith(".many"):  # more than this process may use cores
            number = min(max(FEWEST, 2 * len(os.sched_getaffinity(0))), MOST)
        facts["environments"] = number
        options = dict(more, context=method)
        makers = [Maker(probe, check)] * number
        use_workers(probe, makers, options, lambda env: compare_rollout(probe, env, check, facts))

    return run


def use_workers(probe, makers, options, use):
    """Use environments in workers, and report workers that stay or end with an error."""
    env = None
    try:
        with open_batch(probe, makers, options) as env:
            use(env)
    except BaseException as error:
        probe.workers += end_workers(env, error, PATIENCE)
        raise
    exits = end_workers(env, None, PATIENCE)
    probe.workers += exits
    for worker in exits:
        if worker["exit_code"] is None:
            probe.finding("vector.teardown", "vector.teardown.stays")
        elif worker["exit_code"] != 0:
            probe.finding("vector.teardown", "vector.teardown.exit", got=worker["exit_code"])


def open_batch(probe, makers, options):
    """Open several environments as one, made with these options."""
    return open_environment(probe, "vector", lambda: probe.api.make_vector(makers, options, reporter(probe, "vector")))


def skip_several_rewards(probe):
    """Skip a check of environments whose rewards are several numbers: a batch has room for one of each."""
    if not probe.api.single_reward:
        return
    if "rewards" not in probe.memo:
        with open_single(probe) as env:  # no more than made: what it draws with must not be there before a fork
            probe.memo["rewards"] = env.reward_size()
    number = probe.memo["rewards"]
    if number > 1:
        skip("vector.rewards", got=number)


def compare_rollout(probe, env, check, facts):
    """Make some steps; the same seed and actions should give the same in this process and in workers."""
    trace = Trace()
    env.seed_actions(probe.case["seed"])
    facts.update(env.describe())
    trace.add(env.reset(probe.case["seed"]))
    for _ in count_steps(probe.vector_steps):
        observation, reward, terminated, truncated = env.step(env.action())
        trace.add(observation, np.asarray(reward, float), terminated, truncated)  # integers in old workers
    earlier, first = probe.memo.setdefault("vector of {}".format(facts.get("environments")), (trace, check))
    difference = earlier.difference(trace)
    if difference:
        at = difference["step"]
        probe.finding("vector.repeat", "vector.repeat", at=at, here=check, there=first, difference=difference)
