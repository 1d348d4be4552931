"""Drive gym before 0.26: reset() returns the observation alone, step() four values, and `seed()` seeds."""

import importlib

from .cell_callables import takes_argument
from .cell_errors import library, skip, violate
from .cell_gym_modern import GymnasiumAdapter, ModernEnvironment, ignore_report
from .cell_values import Examiner, describe_value

TRUNCATED = "TimeLimit.truncated"


class GymAdapter(GymnasiumAdapter):
    """Drive gym of every generation, which the attributes of the library show."""

    seeds_at_reset = True
    """Whether reset() of the environment made last takes a seed; false of those written before gym 0.22."""

    def __init__(self):
        super().__init__("gym")

    def registered_ids(self):
        """Return the ids that are registered."""
        registry = super().registered_ids()
        return registry if isinstance(registry, dict) else registry.env_specs

    def make_raw(self, case, **more):
        """Make the library's own object; before 0.25 `render` is given the render mode later."""
        if self._classic() and not hasattr(self._part("core").Env, "render_mode"):
            more.pop("render_mode", None)
        try:
            raw = super().make_raw(case, **more)
        except TypeError as error:  # an environment written before
            if "'render_mode'" not in str(error) or not self._classic():
                raise
            raw = super().make_raw(case)
        self.seeds_at_reset = self._classic() and self._seeds_at_reset(raw)
        return raw

    def wrap(self, raw, report, batch=None):
        """Wrap the library's object to drive it as users of its release do."""
        if not self._classic():
            return super().wrap(raw, report, batch)
        examiner = Examiner(self._part("spaces"), raw, report, batch)
        return ClassicEnvironment(raw, examiner, self.seeds_at_reset and takes_argument(raw.reset, "seed"))

    def check_env(self, case):
        """Run the library's own checker, which came with 0.19."""
        try:
            importlib.import_module("gym.utils.env_checker")
        except ModuleNotFoundError as error:
            if error.name != "gym.utils.env_checker":
                raise
            skip("gym.no_checker")
        super().check_env(case)

    def pictures(self, raw):
        """Return the render modes that an environment names."""
        return super().pictures(raw) or raw.metadata.get("render.modes", ())

    def _classic(self):
        return hasattr(self._part("core").Env, "seed")

    def _seeds_at_reset(self, raw):
        """Return whether every layer passes a seed on to reset()."""
        core = self._part("core")
        while takes_argument(raw.reset, "seed"):
            if not isinstance(raw, core.Wrapper):
                return takes_argument(core.Env.reset, "seed")
            raw = raw.env
        return False


class ClassicEnvironment(ModernEnvironment):
    """An environment of the API of four: seed(), reset() -> observation, step() -> four values."""

    def __init__(self, raw, examiner, seeds_at_reset):
        super().__init__(raw, examiner)
        self.seeds_at_reset = seeds_at_reset
        self.frame = None

    def wrap_single(self, raw):
        """Drive a single environment like those of a batch; its reports are ignored."""
        return ClassicEnvironment(raw, Examiner(self.examiner.spaces, raw, ignore_report), self.seeds_at_reset)

    def reset(self, seed=None):
        """Start an episode and return the observation."""
        self.frame = None
        with library:
            if seed is not None and not self.seeds_at_reset:
                self.raw.seed(seed)
            observation = self.raw.reset(seed=seed) if seed is not None and self.seeds_at_reset else self.raw.reset()
        self.examiner.observation("reset()", observation)
        return observation

    def step(self, action):
        """Make one step and return (observation, reward, terminated, truncated by a time limit); done is either."""
        self.frame = None
        with library:
            result = self.raw.step(action)
        self.examiner.arity("step()", result, ("observation", "reward", "done", "info"))
        observation, reward, done, info = result
        self.info = info
        truncated = self._truncated(info)
        self.examiner.observation("step()", observation)
        self.examiner.reward(reward)
        done = self.examiner.flag("done", done)
        return observation, reward, done and not truncated if self.examiner.batch is None else done, truncated

    def _truncated(self, info):
        """Return the flag of the time limit: a batch has a sequence of dicts as info, since 0.24 one dict of arrays."""
        batch = self.examiner.batch
        if batch and isinstance(info, (tuple, list)):
            if len(info) != batch or not all(isinstance(item, dict) for item in info):
                promised = "a dict for each of {} environments".format(batch)
                violate("call.info", call="step()", got=describe_value(info), promised=promised)
            return [bool(item.get(TRUNCATED)) for item in info]
        self.examiner.info("step()", info)
        return info.get(TRUNCATED, [False] * batch) if batch else bool(info.get(TRUNCATED))

    def render(self):
        """Return a picture; gym 0.25 may give all those since the last call, of which this is the last one."""
        with library:
            if not getattr(self.raw, "render_mode", None):
                return self.raw.render(mode="rgb_array")
            drawn = self.raw.render()
        if isinstance(drawn, list) and (drawn or self.frame is not None):
            drawn = self.frame = drawn[-1] if drawn else self.frame
        return drawn
