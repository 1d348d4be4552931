"""Record a data set with Minari, read it again, and compare."""

import os
import tempfile

from .cell_episode import count_steps
from .cell_errors import library, violate
from .cell_interop import close, import_trainer, make_environment

EPISODES, LENGTH = 2, 20
"""Recorded episodes, and the steps after which each is cut short."""

FOLDER = "MINARI_DATASETS_PATH"
PARTS = ("observations", "actions", "rewards", "terminations", "truncations")


def run(probe, facts):
    """Record episodes into a temporary folder; what is loaded has to be what was recorded."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ[FOLDER] = folder  # read when a data set is written or loaded
        minari = import_trainer("minari", "minari")
        facts["version"] = {"library": str(minari.__version__)}
        name, recorded = _record(probe, minari)
        with library:
            dataset = minari.load_dataset(name)
            loaded = list(dataset.iterate_episodes())
        facts["episodes"], facts["steps"] = len(loaded), int(dataset.total_steps)
        _compare(loaded, recorded)
        _recover(probe, dataset)


def _record(probe, minari):
    """Record with Minari's wrapper; return the name of the data set, and the same values as we saw them."""
    new = hasattr(minari, "DataCollector")
    with library:
        collector = minari.DataCollector if new else minari.DataCollectorV0
        env = collector(probe.api.limit_steps(make_environment(probe), LENGTH))
        env.action_space.seed(probe.case["seed"])
    try:
        episodes = [_play(env, probe.case["seed"] + number) for number in range(EPISODES)]
        name = "simmatrix/recorded-v0" if new else "recorded-v0"
        words = {"algorithm_name": "random", "code_permalink": "none", "author": "simmatrix", "author_email": "none"}
        with library:
            if hasattr(env, "create_dataset"):
                env.create_dataset(name, **words)
            else:
                minari.create_dataset_from_collector_env(name, env, **words)
    finally:
        close(env)
    return name, episodes


def _play(env, seed):
    """Play one episode with sampled actions, and return its parts as lists."""
    with library:
        observation, _ = env.reset(seed=seed)
    episode = {part: [] for part in PARTS}
    episode["observations"].append(observation)
    for _ in count_steps(LENGTH):
        with library:
            action = env.action_space.sample()
            values = env.step(action)
        for part, value in zip(PARTS, (values[0], action, *values[1:4])):
            episode[part].append(value)
        if values[2] or values[3]:
            break
    return episode


def _compare(loaded, recorded):
    """Raise a violation where an episode is missing, or has other values than were recorded."""
    if len(loaded) != len(recorded):
        violate("minari.episodes", got=len(loaded), promised=len(recorded))
    for number, (episode, values) in enumerate(zip(loaded, recorded)):
        for part in PARTS:
            if not _same(getattr(episode, part), values[part]):
                violate("minari.differs", part=part, number=number)


def _same(stored, steps):
    """Return whether a stored part holds the values of all steps; a part may be a dict of parts."""
    import numpy as np

    if isinstance(stored, dict):
        return all(_same(stored[key], [step[key] for step in steps]) for key in stored)
    if isinstance(stored, tuple):
        return all(_same(part, [step[place] for step in steps]) for place, part in enumerate(stored))
    return np.array_equal(np.asarray(stored), np.asarray(steps))


def _recover(probe, dataset):
    """Make the environment of the data set again, and make a step; its spaces are those that were recorded."""
    with library:
        env = dataset.recover_environment()
        env.reset(seed=probe.case["seed"])
        env.step(env.action_space.sample())
        spaces = str(env.observation_space), str(env.action_space)
    close(env)
    promised = str(dataset.observation_space), str(dataset.action_space)
    if spaces != promised:
        violate("minari.spaces", got=", ".join(spaces), promised=", ".join(promised))
