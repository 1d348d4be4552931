"""gym 0.26 and gymnasium from 0.26 on: one API under two names."""

import importlib

from .cell_adapter import Adapter, Environment
from .cell_errors import library
from .cell_own import own
from .cell_values import Examiner


class Family(Adapter):
    """The calls a user makes, made in a user's way: with the library's own checkers and wrappers in place."""

    one_reward = True

    def __init__(self, name):
        self.name = name

    def named(self, case):
        """Return the id as the library knows it: gym 0.22 and 0.23 do not know `gym:CartPole-v1`, which names us."""
        prefix, env = self.name + ":", case["env"] or ""
        return env[len(prefix) :] if env.startswith(prefix) else env

    def modules(self, case):
        """Return the library, and the module that an id such as `module:Name-v0` or `module:callable` names."""
        found = own(case)
        prefix, colon, _ = (found.module, ":", "") if found else self.named(case).partition(":")
        return [self.name] + ([prefix] if colon else [])

    def knows(self, case):
        """Return whether the environment of a case is registered, or a callable of the user's."""
        if self._own(case) is not None:
            return True
        name, ids = self.named(case).rpartition(":")[2], self.names()
        latest = name + "-v"  # an id without a version is its latest one
        return name in ids or any(one.startswith(latest) and one[len(latest) :].isdigit() for one in ids)

    def names(self):
        """Return all ids that are registered."""
        return [str(name) for name in list(self.ids())]

    def ids(self):
        """Return the ids that are registered."""
        return self._part("envs.registration").registry

    def make(self, case, tell, draw=False):
        """Make the environment of a case."""
        try:
            with library:
                raw = self.bare(case, **({"render_mode": "rgb_array"} if draw else {}))
        except TypeError as error:
            if not case["kwargs"] and _called_without(error):
                tell("arguments", "gym.arguments", text=error)
            raise
        return self.driven(raw, tell)

    def driven(self, raw, tell, batch=None):
        """Drive the library's object as users do; `batch` is how many environments it holds."""
        return Modern(raw, Examiner(self._part("spaces"), raw, tell, batch))

    def bare(self, case, **more):
        """Make the library's own object."""
        options = dict(case["kwargs"], **more)
        found = self._own(case)
        if found:
            return found.make(options)
        return importlib.import_module(self.name).make(self.named(case), **options)

    def make_vector(self, makers, way, tell):
        """Make a SyncVectorEnv or an AsyncVectorEnv with these arguments."""
        with library:
            vector = self._part("vector")
            raw = self._batch(vector, makers, way or {}, tell)
        return self.driven(raw, tell, batch=len(makers))

    def _batch(self, vector, makers, way, tell):
        """Make the environment of several; spaces that the library cannot lay into shared memory are sent by pipes."""
        if "context" not in way:
            return vector.SyncVectorEnv(makers, **way)
        try:
            return vector.AsyncVectorEnv(makers, **way)
        except Exception as error:
            causes = (error, error.__cause__)
            if "CustomSpaceError" not in [type(one).__name__ for one in causes] or "shared_memory" in way:
                raise
        tell("space", "gym.space_unshared")
        return vector.AsyncVectorEnv(makers, shared_memory=False, **way)

    def autoreset_modes(self):
        """Return the arguments that choose each autoreset mode, by its name; gymnasium since 1.1 offers a choice."""
        vector = self._part("vector")
        if hasattr(vector, "AutoresetMode"):
            return {mode.name: {"autoreset_mode": mode} for mode in vector.AutoresetMode}
        return {"SAME_STEP" if issubclass(vector.VectorEnv, self._part("core").Env) else "NEXT_STEP": {}}

    def limited(self, raw, steps):
        """Wrap the library's own object so that its episodes are no longer than this."""
        return self._part("wrappers").TimeLimit(raw, max_episode_steps=steps)

    def check_env(self, case):
        """Run the library's own checker."""
        with library:
            raw = self.bare(case)
            self._part("utils.env_checker").check_env(raw.unwrapped, skip_render_check=True)
            raw.close()

    def declares_pictures(self, case):
        """Return whether the environment names the render mode rgb_array."""
        try:
            raw = self.bare(case)
            modes = self.pictures(raw)
            raw.close()
        except Exception:
            return True
        return "rgb_array" in modes

    def pictures(self, raw):
        """Return the render modes that an environment names."""
        return raw.metadata.get("render_modes", ())

    def _own(self, case):
        """Return the callable that the id of a case names, unless it is one of the library's own ids."""
        found = own(case)
        if found is None or not found.exists():
            return None
        names = (case["env"], found.name)
        registered = any(one in names or one.startswith(found.name + "-v") for one in list(self.ids()))
        return None if registered else found

    def _part(self, name):
        return importlib.import_module("{}.{}".format(self.name, name))


class Modern(Environment):
    """An environment of the API of five: reset(seed=...) -> (observation, info), step -> five values."""

    def __init__(self, raw, examiner):
        self.raw = raw
        self.examiner = examiner

    def alike(self, raw):
        """Drive a single environment of those that are in a batch, without a word."""
        return Modern(raw, Examiner(self.examiner.spaces, raw, unheard))

    @property
    def processes(self):
        """Return the workers of a vector environment."""
        return getattr(self.raw, "processes", None) or ()

    def reset(self, seed=None):
        """Start an episode and return the observation."""
        return self._reset({} if seed is None else {"seed": seed})

    def reset_those(self, ended):
        """Start episodes of those environments of a batch whose episode has ended, and return all observations."""
        import numpy as np

        return self._reset({"options": {"reset_mask": np.array(ended)}})

    def _reset(self, arguments):
        with library:
            result = self.raw.reset(**arguments)
        self.examiner.arity("reset()", result, ("observation", "info"))
        self.examiner.info("reset()", result[1])
        self.examiner.observation("reset()", result[0])
        return result[0]

    def step(self, action):
        """Make one step and return (observation, reward, terminated, truncated)."""
        with library:
            result = self.raw.step(action)
        self.examiner.arity("step()", result, ("observation", "reward", "terminated", "truncated", "info"))
        self.examiner.info("step()", result[4])
        self.info = result[4]
        self.examiner.observation("step()", result[0])
        self.examiner.reward(result[1])
        ends = [self.examiner.flag(name, value) for name, value in zip(("terminated", "truncated"), result[2:4])]
        return (result[0], result[1], *ends)

    def rewards(self):
        """Return how many numbers a reward is: as measured before, else as declared."""
        if self.examiner.rewards is not None:
            return self.examiner.rewards
        number = self.examiner.agents or 1
        for length in self.examiner.reward_shape:
            number *= length
        return number

    def render(self):
        """Return the result of render()."""
        with library:
            return self.raw.render()

    def seed_actions(self, seed):
        """Seed the action space."""
        with library:
            self.raw.action_space.seed(seed)

    def action(self):
        """Sample the action space."""
        with library:
            return self.raw.action_space.sample()

    def describe(self):
        """Return the spaces."""
        with library:
            return {name: str(getattr(self.raw, name))[:500] for name in ("observation_space", "action_space")}

    def close(self):
        """Close the library's object."""
        self.raw.close()


def _called_without(error):
    """Tell whether make() called the environment itself without an argument that it requires."""
    if " missing " not in str(error):
        return False
    step = error.__traceback__
    while step.tb_next is not None:
        step = step.tb_next
    return step.tb_frame.f_code.co_filename.replace("\\", "/").endswith("/envs/registration.py")


def unheard(_kind, _code, **_data):
    """Tell nobody."""
