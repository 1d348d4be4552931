"""Drive gym 0.26 and gymnasium from 0.26 on: one API under two names."""

import importlib

from .cell_adapter import Adapter, Environment
from .cell_callables import user_callable
from .cell_errors import library
from .cell_values import Examiner


class GymnasiumAdapter(Adapter):
    """Make the calls that a user makes, with the library's own checkers and wrappers in place."""

    single_reward = True

    def __init__(self, name):
        self.name = name

    def modules(self, case):
        """Return the library, and the module that an id such as `module:Name-v0` or `module:callable` names."""
        factory = user_callable(case)
        prefix, colon, _ = (factory.module, ":", "") if factory else self.local_name(case).partition(":")
        return [self.name] + ([prefix] if colon else [])

    def has_environment(self, case):
        """Return whether the environment of a case is registered, or a callable of the user's."""
        if self._user_callable(case) is not None:
            return True
        name, ids = self.local_name(case).rpartition(":")[2], self.environment_names()
        latest = name + "-v"  # an id without a version is its latest one
        return name in ids or any(each.startswith(latest) and each[len(latest) :].isdigit() for each in ids)

    def environment_names(self):
        """Return all ids that are registered."""
        return [str(name) for name in list(self.registered_ids())]

    def registered_ids(self):
        """Return the ids that are registered."""
        return self._part("envs.registration").registry

    def make(self, case, report, draw=False):
        """Make the environment of a case."""
        try:
            with library:
                raw = self.make_raw(case, **({"render_mode": "rgb_array"} if draw else {}))
        except TypeError as error:
            if not case["kwargs"] and _lacks_argument(error):
                report("arguments", "gym.arguments", text=error)
            raise
        return self.wrap(raw, report)

    def wrap(self, raw, report, batch=None):
        """Wrap the library's object to drive it as users do; `batch` is how many environments it holds."""
        return ModernEnvironment(raw, Examiner(self._part("spaces"), raw, report, batch))

    def make_raw(self, case, **more):
        """Make the library's own object."""
        options = dict(case["kwargs"], **more)
        factory = self._user_callable(case)
        if factory:
            return factory.make(options)
        return importlib.import_module(self.name).make(self.local_name(case), **options)

    def make_vector(self, makers, options, report):
        """Make a SyncVectorEnv or an AsyncVectorEnv with these arguments."""
        with library:
            vector = self._part("vector")
            raw = self._batch(vector, makers, options or {}, report)
        return self.wrap(raw, report, batch=len(makers))

    def _batch(self, vector, makers, options, report):
        """Make the environment of several; values that cannot be in shared memory are sent by pipes."""
        if "context" not in options:
            return vector.SyncVectorEnv(makers, **options)
        try:
            return vector.AsyncVectorEnv(makers, **options)
        except Exception as error:
            causes = (error, error.__cause__)
            if "CustomSpaceError" not in [type(cause).__name__ for cause in causes] or "shared_memory" in options:
                raise
        report("space", "gym.space_unshared")
        return vector.AsyncVectorEnv(makers, shared_memory=False, **options)

    def autoreset_modes(self):
        """Return the arguments that choose each autoreset mode, by its name; gymnasium since 1.1 offers a choice."""
        vector = self._part("vector")
        if hasattr(vector, "AutoresetMode"):
            return {mode.name: {"autoreset_mode": mode} for mode in vector.AutoresetMode}
        return {"SAME_STEP" if issubclass(vector.VectorEnv, self._part("core").Env) else "NEXT_STEP": {}}

    def limit_steps(self, raw, steps):
        """Wrap the library's own object so that its episodes are no longer than this."""
        return self._part("wrappers").TimeLimit(raw, max_episode_steps=steps)

    def check_env(self, case):
        """Run the library's own checker."""
        with library:
            raw = self.make_raw(case)
            self._part("utils.env_checker").check_env(raw.unwrapped, skip_render_check=True)
            raw.close()

    def declares_pictures(self, case):
        """Return whether the environment names the render mode rgb_array."""
        try:
            raw = self.make_raw(case)
            modes = self.pictures(raw)
            raw.close()
        except Exception:
            return True
        return "rgb_array" in modes

    def pictures(self, raw):
        """Return the render modes that an environment names."""
        return raw.metadata.get("render_modes", ())

    def _user_callable(self, case):
        """Return the callable that the id of a case names, unless it is one of the library's own ids."""
        factory = user_callable(case)
        if factory is None or not factory.exists():
            return None
        names = (case["env"], factory.name)
        registered = any(name in names or name.startswith(factory.name + "-v") for name in list(self.registered_ids()))
        return None if registered else factory

    def _part(self, name):
        return importlib.import_module("{}.{}".format(self.name, name))


class ModernEnvironment(Environment):
    """An environment of the API of five: reset(seed=...) -> (observation, info), step -> five values."""

    seeded = None
    """The action space that `seed_actions` seeded."""

    def __init__(self, raw, examiner):
        self.raw = raw
        self.examiner = examiner

    def wrap_single(self, raw):
        """Drive a single environment like those of a batch; its reports are ignored."""
        return ModernEnvironment(raw, Examiner(self.examiner.spaces, raw, ignore_report))

    @property
    def processes(self):
        """Return the workers of a vector environment."""
        return getattr(self.raw, "processes", None) or ()

    def reset(self, seed=None):
        """Start an episode and return the observation."""
        return self._reset({} if seed is None else {"seed": seed})

    def reset_some(self, ended):
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

    def reward_size(self):
        """Return how many numbers a reward is: as measured before, else as declared."""
        if self.examiner.reward_size is not None:
            return self.examiner.reward_size
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
            self.seeded = self.raw.action_space
            self.seeded.seed(seed)

    def action(self):
        """Sample the action space that was seeded: a reset may have put an equal one in its place, unseeded."""
        with library:
            space = self.raw.action_space
            return (self.seeded if self.seeded == space else space).sample()

    def describe(self):
        """Return the spaces."""
        with library:
            return {name: str(getattr(self.raw, name))[:500] for name in ("observation_space", "action_space")}


def _lacks_argument(error):
    """Return whether make() called the environment itself without an argument that it requires."""
    if " missing " not in str(error):
        return False
    step = error.__traceback__
    while step.tb_next is not None:
        step = step.tb_next
    return step.tb_frame.f_code.co_filename.replace("\\", "/").endswith("/envs/registration.py")


def ignore_report(_kind, _code, **_data):
    """Ignore a report."""
