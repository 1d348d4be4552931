"""The adapter of robosuite: `robosuite:Lift` as it is, `robosuite:GymWrapper(Lift)` through its own gym wrapper.

Vector environments are always made of the wrapped one, by the gym or gymnasium that the wrapper is of.
"""

import importlib
import re
import sys

from .cell_adapter import Adapter, Environment
from .cell_classic import Gym
from .cell_errors import library, skip, violate
from .cell_family import Family
from .cell_values import shown

PACKAGES = {"robosuite": "robosuite"}
IDS = r"(GymWrapper\()?[A-Z][A-Za-z]+\)?"
EXAMPLE = "robosuite:Lift"

ROBOT = "Panda"
"""The robot of a case that names none; environments of two arms need two."""

CAMERA = "agentview"
WRAPPED = re.compile(r"GymWrapper\((.*)\)")
FAMILIES = {"gym": Gym(), "gymnasium": Family("gymnasium")}


class Robosuite(Adapter):
    """robosuite, every release: what differs between them is asked of the release itself."""

    imports = ("robosuite",)

    def named(self, case):
        """Return the name of the environment, without a wrapper around it."""
        return _task(case)[0]

    def names(self):
        """Return all environments; None of a release that does not list them."""
        found = getattr(importlib.import_module("robosuite"), "ALL_ENVIRONMENTS", None)
        return None if found is None else sorted(map(str, found))

    def make(self, case, tell, draw=False):
        """Make the environment of a case; pictures are those of a camera among its observations."""
        task, wrapped = _task(case)
        if wrapped and draw:
            skip("robosuite.no_pictures")
        with library:
            raw = self.bare(case) if wrapped else _made(task, case, draw)
        return _family(raw).driven(raw, tell) if wrapped else Task(raw, tell, case["seed"])

    def bare(self, case):
        """Make the environment in robosuite's gym wrapper."""
        task, _ = _task(case)
        raw = _wrapper()(_made(task, case))
        _family(raw).heeds = takes(raw.reset, "seed")
        return raw

    def make_vector(self, makers, way, tell):
        """Make the vector environment of the library that the wrapper is of."""
        return self._batching().make_vector(makers, way, tell)

    def autoreset_modes(self):
        """Say what the library offers that the wrapper is of."""
        return self._batching().autoreset_modes()

    def limited(self, raw, steps):
        """Wrap the wrapper."""
        return _family(raw).limited(raw, steps)

    def _batching(self):
        """Return the library that the wrapper is of."""
        if not any(_there(name) for name in FAMILIES):
            skip("robosuite.no_batches")
        with library:
            return _family(_wrapper())

    def check_env(self, case):
        """Run the checker of the library that the wrapper is of."""
        if not _task(case)[1]:
            super().check_env(case)
        with library:
            raw = self.bare(case)
            importlib.import_module(_library(raw) + ".utils.env_checker").check_env(raw, skip_render_check=True)
            raw.close()

    def declares_pictures(self, case):
        """Return whether it draws any."""
        return not _task(case)[1]


class Task(Environment):
    """robosuite's own environment: reset() -> observation, step() -> four values, no spaces."""

    def __init__(self, raw, tell, seed):
        super().__init__(tell)
        self.raw = raw
        self.latest = {}
        self.made_with = seed
        self.seed_actions(seed)
        with library:
            low, high = raw.action_spec
        self.low, self.high = low, high

    def begin(self, seed):
        """Seed numpy's global generator, which all releases before 1.5 draw from, and reset."""
        import numpy as np

        if seed is not None:
            np.random.seed(seed)
            self._seeded(seed)
        self.latest = self._kept(self.raw.reset(), "reset()")
        return self.latest

    def advance(self, action):
        """Make one step."""
        result = self.raw.step(action)
        if not isinstance(result, tuple) or len(result) != 4:
            violate("call.result", call="step()", got=shown(result), promised="(observation, reward, done, info)")
        observation, reward, done, info = result
        if not isinstance(info, dict):
            violate("call.info", call="step()", got=shown(info), promised="a dict")
        self.latest = self._kept(observation, "step()")
        return observation, reward, done, False

    def draw(self):
        """Return the picture of the first camera among the latest observations, as robosuite gives it."""
        return self.latest[self.raw.camera_names[0] + "_image"]

    def get_state(self):
        """Return the state of the simulation."""
        with library:
            return self.raw.sim.get_state()

    def set_state(self, state):
        """Put the simulation into a state."""
        with library:
            self.raw.sim.set_state(state)
            self.raw.sim.forward()

    def seed_actions(self, seed):
        """Seed a generator of our own: robosuite has none for actions."""
        import numpy as np

        self.random = np.random.RandomState(seed)

    def action(self):
        """Draw an action within the bounds that the environment gives."""
        return self.random.uniform(self.low, self.high)

    def describe(self):
        """Return the bounds of actions and the shapes of observations."""
        shapes = ", ".join("{} {}".format(name, getattr(part, "shape", "")) for name, part in self.latest.items())
        bounds = "{} to {}".format(self.low.tolist(), self.high.tolist())
        return {"action_spec": bounds[:500], "observation": shapes[:500]}

    def close(self):
        """Close it."""
        self.raw.close()

    def _seeded(self, seed):
        """Tell of a seed that is not heeded: since 1.5 robosuite has a generator of its own."""
        if seed != self.made_with and getattr(self.raw, "rng", None) is not None:
            self.tell("seed", "robosuite.seed")

    def _kept(self, observation, call):
        """Examine an observation: the same parts of the same shapes every time."""
        if not isinstance(observation, dict) or not observation:
            violate("call.observation", call=call, got=shown(observation), promised="a dict of arrays")
        for name, part in self.latest.items():
            now = observation.get(name)
            if getattr(now, "shape", None) != getattr(part, "shape", None):
                violate("robosuite.changed", call=call, name=repr(name), got=shown(now), promised=shown(part))
        return observation


def _task(case):
    """Return the name of the task, and whether it is asked for in its gym wrapper."""
    name = case["env"]
    name = name[len("robosuite:") :] if name.startswith("robosuite:") else name
    wrapped = WRAPPED.match(name)
    return (wrapped.group(1), True) if wrapped else (name, False)


def _made(task, case, draw=False):
    """Make robosuite's own environment, without a window."""
    base = importlib.import_module("robosuite.environments.base")
    arguments = {"robots": ROBOT, "has_renderer": False, "has_offscreen_renderer": draw, "use_camera_obs": draw}
    if takes(base.REGISTERED_ENVS.get(task, base.MujocoEnv), "seed"):
        arguments["seed"] = case["seed"]
    if draw:
        arguments["camera_names"] = CAMERA
    arguments.update(case["kwargs"])
    if draw:
        arguments.update(has_offscreen_renderer=True, use_camera_obs=True)
    return importlib.import_module("robosuite").make(task, **arguments)


def _wrapper():
    """Import the wrapper from where it is made: robosuite.wrappers hides why it has none."""
    return importlib.import_module("robosuite.wrappers.gym_wrapper").GymWrapper


def _library(wrapper):
    """Return the name of the library whose environment a wrapper is."""
    kinds = wrapper.__mro__ if isinstance(wrapper, type) else type(wrapper).__mro__
    found = [kind.__module__.partition(".")[0] for kind in kinds]
    return next(name for name in FAMILIES if name in found)


def _family(wrapper):
    return FAMILIES[_library(wrapper)]


def _there(name):
    """Return whether a module could be imported; asked without importing anything."""
    finders = [finder for finder in sys.meta_path if hasattr(finder, "find_spec")]
    return any(finder.find_spec(name, None) is not None for finder in finders)


def takes(function, name):
    """Return whether a function names this argument."""
    import inspect

    return name in inspect.signature(function).parameters


API = Robosuite()
