"""Episode ends in a batch, beside the same episodes of single environments: same seeds, same actions."""

from .cell_errors import library, skip
from .cell_workers import Maker

LENGTH = 5
"""Steps of an episode at most, so that each environment comes to its end several times."""

STEPS = 3 * LENGTH + 2

FINAL = ("final_obs", "final_observation", "terminal_observation")
"""Where an info has the last observation of an episode: gymnasium 1.1, gym 0.25, gym 0.22."""

NEXT, SAME, BY_HAND = "NEXT_STEP", "SAME_STEP", "DISABLED"
"""When a new episode begins after an end: with the next step, within the same step, when it is asked for."""


class Short(Maker):
    """Makes environments whose episodes are short."""

    def made(self):
        """Make one."""
        return self.api.limited(super().made(), LENGTH)


def beside_single(probe, env, mode, maker):
    """Go over episode ends: what differs from single environments, if anything; and whether an end was missed."""
    spaces, raw = env.examiner.spaces, env.raw
    if not _divisible(spaces, raw.single_observation_space) or not _plain(spaces, raw.single_action_space):
        skip("vector.autoreset.no_parts")
    env.seed_actions(probe.case["seed"])
    batch = Batch(env, mode)
    batch.begin(probe.case["seed"])
    for _ in range(STEPS):
        batch.advance(env.action())
    for number, (seen, actions) in enumerate(zip(batch.seen, batch.actions)):
        with library:
            raw = maker()
        single = env.alike(raw)
        expected = alone(single, probe.case["seed"] + number, actions, mode)
        single.close()
        for step, (one, other) in enumerate(zip(seen, expected)):
            part = _differing(one, other)
            if part:
                return {"number": number, "environments": len(batch.seen), "part": part, "step": step}, batch.lost
    return None, batch.lost


class Batch:
    """The results of each environment of a batch, by step.

    A result is (observation, reward, ended, last observation of the episode).
    """

    def __init__(self, env, mode):
        self.env = env
        self.mode = mode
        self.number = env.examiner.batch
        self.seen = [[] for _ in range(self.number)]
        self.actions = [[] for _ in range(self.number)]
        self.lost = False

    def begin(self, seed):
        """Start all episodes."""
        observation = self.env.reset(seed)
        for number, seen in enumerate(self.seen):
            seen.append((_part(observation, number), None, None, None))

    def advance(self, action):
        """Make one step, and begin episodes where the mode leaves that to the user."""
        observation, reward, terminated, truncated = self.env.step(action)
        ended = [bool(one) or bool(other) for one, other in zip(terminated, truncated)]
        for number, seen in enumerate(self.seen):
            last = self._last(number) if ended[number] and self.mode == SAME else None
            self.actions[number].append(action[number])
            seen.append((_part(observation, number), reward[number], ended[number], last))
        if self.mode == BY_HAND and any(ended):
            observation = self.env.reset_those(ended)
            for number, seen in enumerate(self.seen):
                if ended[number]:
                    seen.append((_part(observation, number), None, None, None))

    def _last(self, number):
        """Find the last observation of an episode in the info, as this release has it."""
        info = self.env.info
        if isinstance(info, (tuple, list)):
            last = info[number].get(FINAL[-1])
        else:
            last = next((_part(info[name], number) for name in FINAL if name in info), None)
        self.lost = self.lost or last is None
        return last


def alone(env, seed, actions, mode):
    """Give what one environment of a batch should give."""
    seen = [(env.reset(seed), None, None, None)]
    ended = False
    for action in actions:
        if ended and mode == NEXT:
            ended = False
            seen.append((env.reset(), 0.0, False, None))
            continue
        observation, reward, terminated, truncated = env.step(action)
        ended, last = bool(terminated) or bool(truncated), None
        if ended and mode == SAME:
            last, observation = observation, env.reset()
        seen.append((observation, reward, ended, last))
        if ended and mode == BY_HAND:
            seen.append((env.reset(), None, None, None))
    return seen


def _divisible(spaces, space):
    """Return whether a batch of it is arrays, or dicts and tuples of them."""
    if isinstance(space, (spaces.Dict, spaces.Tuple)):
        parts = space.spaces.values() if isinstance(space, spaces.Dict) else space.spaces
        return all(_divisible(spaces, part) for part in parts)
    return _plain(spaces, space)


def _plain(spaces, space):
    return isinstance(space, (spaces.Box, spaces.Discrete, spaces.MultiDiscrete, spaces.MultiBinary))


def _part(values, number):
    """Take what is of one environment: observations of a batch are arrays, or dicts and tuples of them."""
    if hasattr(values, "items"):
        return {key: _part(value, number) for key, value in values.items() if not str(key).startswith("_")}
    if isinstance(values, tuple):
        return tuple(_part(value, number) for value in values)
    return values[number]


def _differing(one, other):
    """Name what differs; a batch may have it in another dtype, and may have lost the last observation."""
    for name, left, right in zip(("observation", "reward", "end", "last observation"), one, other):
        if left is not None and right is not None and not _equal(left, right):
            return name
    return None


def _equal(left, right):
    import numpy as np

    if hasattr(right, "items"):
        return all(_equal(left[key], value) for key, value in right.items())
    if isinstance(right, tuple):
        return all(_equal(one, other) for one, other in zip(left, right))
    left = np.asarray(left)
    return bool((left == np.asarray(right).astype(left.dtype)).all())
