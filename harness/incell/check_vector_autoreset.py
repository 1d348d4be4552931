"""Compare episode ends in a batch with those of single environments: same seeds, same actions."""

from .cell_batch import open_batch, skip_several_rewards, use_workers
from .cell_errors import library, skip
from .cell_workers import Maker

LENGTH = 5
"""Steps of an episode at most, so that each environment comes to its end several times."""

STEPS = 3 * LENGTH + 2

FINAL = ("final_obs", "final_observation", "terminal_observation")
"""Where an info has the last observation of an episode: gymnasium 1.1, gym 0.25, gym 0.22."""

NEXT, SAME, BY_HAND = "NEXT_STEP", "SAME_STEP", "DISABLED"
"""When a new episode begins after an end: with the next step, within the same step, when it is asked for."""


def run(probe, facts):
    """Go over the ends of episodes, in this process and in workers, in each way that the library has."""
    check = "vector.autoreset"
    skip_several_rewards(probe)
    modes = probe.api.autoreset_modes()
    facts["modes"] = list(modes)
    makers = [ShortEpisodes(probe, check)] * probe.num_envs
    for name, options in modes.items():

        def go_over(env, mode=name):
            difference, lost = compare_with_single(probe, env, mode, makers[0])
            if difference:
                at = difference["step"]
                probe.finding(check, "vector.autoreset.differs", at=at, difference=difference, mode=mode)
            if lost:
                probe.finding(check, "vector.autoreset.lost", level="note")

        with open_batch(probe, makers, dict(options)) as env:
            go_over(env)
        use_workers(probe, makers, dict(options, context="fork"), go_over)


class ShortEpisodes(Maker):
    """Make environments whose episodes are short."""

    def make(self):
        """Make one."""
        return self.api.limit_steps(super().make(), LENGTH)


def compare_with_single(probe, env, mode, maker):
    """Go over episode ends; return the difference to single environments or None, and whether an end was lost."""
    spaces, raw = env.examiner.spaces, env.raw
    if not _has_parts(spaces, raw.single_observation_space) or not _is_plain(spaces, raw.single_action_space):
        skip("vector.autoreset.no_parts")
    env.seed_actions(probe.case["seed"])
    batch = Batch(env, mode)
    batch.begin(probe.case["seed"])
    for _ in range(STEPS):
        batch.advance(env.action())
    for number, (results, actions) in enumerate(zip(batch.results, batch.actions)):
        with library:
            raw = maker()
        single = env.wrap_single(raw)
        expected = single_results(single, probe.case["seed"] + number, actions, mode)
        single.close()
        for step, (values, other) in enumerate(zip(results, expected)):
            part = _differing(values, other)
            if part:
                return {"number": number, "environments": len(batch.results), "part": part, "step": step}, batch.lost
    return None, batch.lost


class Batch:
    """The results of each environment of a batch, by step.

    A result is (observation, reward, ended, last observation of the episode).
    """

    def __init__(self, env, mode):
        self.env = env
        self.mode = mode
        self.number = env.examiner.batch
        self.results = [[] for _ in range(self.number)]
        self.actions = [[] for _ in range(self.number)]
        self.lost = False

    def begin(self, seed):
        """Start all episodes."""
        observation = self.env.reset(seed)
        for number, results in enumerate(self.results):
            results.append((_part(observation, number), None, None, None))

    def advance(self, action):
        """Make one step, and begin episodes where the mode leaves that to the user."""
        observation, reward, terminated, truncated = self.env.step(action)
        ended = [bool(end) or bool(cut) for end, cut in zip(terminated, truncated)]
        for number, results in enumerate(self.results):
            last = self._last(number) if ended[number] and self.mode == SAME else None
            self.actions[number].append(action[number])
            results.append((_part(observation, number), reward[number], ended[number], last))
        if self.mode == BY_HAND and any(ended):
            observation = self.env.reset_some(ended)
            for number, results in enumerate(self.results):
                if ended[number]:
                    results.append((_part(observation, number), None, None, None))

    def _last(self, number):
        """Find the last observation of an episode in the info, as this release has it."""
        info = self.env.info
        if isinstance(info, (tuple, list)):
            last = info[number].get(FINAL[-1])
        else:
            last = next((_part(info[name], number) for name in FINAL if name in info), None)
        self.lost = self.lost or last is None
        return last


def single_results(env, seed, actions, mode):
    """Return the results that one environment of a batch should have."""
    results = [(env.reset(seed), None, None, None)]
    ended = False
    for action in actions:
        if ended and mode == NEXT:
            ended = False
            results.append((env.reset(), 0.0, False, None))
            continue
        observation, reward, terminated, truncated = env.step(action)
        ended, last = bool(terminated) or bool(truncated), None
        if ended and mode == SAME:
            last, observation = observation, env.reset()
        results.append((observation, reward, ended, last))
        if ended and mode == BY_HAND:
            results.append((env.reset(), None, None, None))
    return results


def _has_parts(spaces, space):
    """Return whether a batch of it is arrays, or dicts and tuples of them."""
    if isinstance(space, (spaces.Dict, spaces.Tuple)):
        parts = space.spaces.values() if isinstance(space, spaces.Dict) else space.spaces
        return all(_has_parts(spaces, part) for part in parts)
    return _is_plain(spaces, space)


def _is_plain(spaces, space):
    return isinstance(space, (spaces.Box, spaces.Discrete, spaces.MultiDiscrete, spaces.MultiBinary))


def _part(values, number):
    """Return the part of one environment: observations of a batch are arrays, or dicts and tuples of them."""
    if hasattr(values, "items"):
        return {key: _part(value, number) for key, value in values.items() if not str(key).startswith("_")}
    if isinstance(values, tuple):
        return tuple(_part(value, number) for value in values)
    return values[number]


def _differing(values, other):
    """Name the part that differs; a batch may have another dtype, and may have lost the last observation."""
    for name, left, right in zip(("observation", "reward", "end", "last observation"), values, other):
        if left is not None and right is not None and not _equal(left, right):
            return name
    return None


def _equal(left, right):
    import numpy as np

    if hasattr(right, "items"):
        return all(_equal(left[key], value) for key, value in right.items())
    if isinstance(right, tuple):
        return all(_equal(values, other) for values, other in zip(left, right))
    left = np.asarray(left)
    return bool((left == np.asarray(right).astype(left.dtype)).all())
