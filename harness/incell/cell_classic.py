"""gym before 0.26: reset() returns the observation alone, step() four values, and `seed()` seeds."""

import importlib

from .cell_errors import library, skip, violate
from .cell_family import Family, Modern, unheard
from .cell_own import takes
from .cell_values import Examiner, shown

TRUNCATED = "TimeLimit.truncated"


class Gym(Family):
    """gym of every generation; what the library has tells which one it is."""

    heeds = True
    """Whether reset() of the environment made last takes a seed; false of those written before gym 0.22."""

    def __init__(self):
        super().__init__("gym")

    def ids(self):
        """Return the ids that are registered."""
        registry = super().ids()
        return registry if isinstance(registry, dict) else registry.env_specs

    def bare(self, case, **more):
        """Make the library's own object; before 0.25 how it draws is said later, by `render`."""
        if self._classic() and not hasattr(self._part("core").Env, "render_mode"):
            more.pop("render_mode", None)
        try:
            raw = super().bare(case, **more)
        except TypeError as error:  # an environment written before
            if "'render_mode'" not in str(error) or not self._classic():
                raise
            raw = super().bare(case)
        self.heeds = self._classic() and self._heeds(raw)
        return raw

    def driven(self, raw, tell, batch=None):
        """Drive the library's object as users of its release do."""
        if not self._classic():
            return super().driven(raw, tell, batch)
        return Classic(raw, Examiner(self._part("spaces"), raw, tell, batch), self.heeds and takes(raw.reset, "seed"))

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

    def _heeds(self, raw):
        """Return whether every layer passes a seed on to reset()."""
        core = self._part("core")
        while takes(raw.reset, "seed"):
            if not isinstance(raw, core.Wrapper):
                return takes(core.Env.reset, "seed")
            raw = raw.env
        return False


class Classic(Modern):
    """An environment of the API of four: seed(), reset() -> observation, step() -> four values."""

    def __init__(self, raw, examiner, heeds):
        super().__init__(raw, examiner)
        self.heeds = heeds
        self.frame = None

    def alike(self, raw):
        """Drive a single environment of those that are in a batch, without a word."""
        return Classic(raw, Examiner(self.examiner.spaces, raw, unheard), self.heeds)

    def reset(self, seed=None):
        """Start an episode and return the observation."""
        self.frame = None
        with library:
            if seed is not None and not self.heeds:
                self.raw.seed(seed)
            observation = self.raw.reset(seed=seed) if seed is not None and self.heeds else self.raw.reset()
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
        """In a batch an info is a sequence of dicts, since 0.24 one dict: the time limit is then among the values."""
        batch = self.examiner.batch
        if batch and isinstance(info, (tuple, list)):
            if len(info) != batch or not all(isinstance(item, dict) for item in info):
                promised = "a dict for each of {} environments".format(batch)
                violate("call.info", call="step()", got=shown(info), promised=promised)
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
