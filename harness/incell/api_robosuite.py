"""Drive robosuite: `robosuite:Lift` as it is, `robosuite:GymWrapper(Lift)` through its own gym wrapper.

Vector environments are always made of the wrapped one, by the gym or gymnasium that the wrapper belongs to.
"""

import importlib
import re
import sys

from .cell_adapter import Adapter, Environment
from .cell_errors import library, skip, violate
from .cell_gym_classic import GymAdapter
from .cell_gym_modern import GymnasiumAdapter
from .cell_values import describe_value

PACKAGES = {"robosuite": "robosuite"}
IDS = r"(GymWrapper\()?[A-Z][A-Za-z]+\)?"
EXAMPLE = "robosuite:Lift"

ROBOT = "Panda"
"""The robot of a case that names none; environments of two arms need two."""

CAMERA = "agentview"
WRAPPED = re.compile(r"GymWrapper\((.*)\)")
GYM_ADAPTERS = {"gym": GymAdapter(), "gymnasium": GymnasiumAdapter("gymnasium")}


class Robosuite(Adapter):
    """Drive every release of robosuite: differences are read from the release itself."""

    imports = ("robosuite",)

    def local_name(self, case):
        """Return the name of the environment, without a wrapper around it."""
        return _task(case)[0]

    def environment_names(self):
        """Return all environments; None of a release that does not list them."""
        names = getattr(importlib.import_module("robosuite"), "ALL_ENVIRONMENTS", None)
        return None if names is None else sorted(map(str, names))

    def make(self, case, report, draw=False):
        """Make the environment of a case; pictures are those of a camera among its observations."""
        task, wrapped = _task(case)
        if wrapped and draw:
            skip("robosuite.no_pictures")
        with library:
            raw = self.make_raw(case) if wrapped else _make_task(task, case, draw)
        return _gym_adapter(raw).wrap(raw, report) if wrapped else Task(raw, report, case["seed"])

    def make_raw(self, case):
        """Make the environment in robosuite's gym wrapper."""
        task, _ = _task(case)
        raw = _gym_wrapper()(_make_task(task, case))
        _gym_adapter(raw).seeds_at_reset = names_argument(raw.reset, "seed")
        return raw

    def make_vector(self, makers, options, report):
        """Make the vector environment of the library that the wrapper belongs to."""
        return self._batch_adapter().make_vector(makers, options, report)

    def autoreset_modes(self):
        """Return the modes of the library that the wrapper belongs to."""
        return self._batch_adapter().autoreset_modes()

    def limit_steps(self, raw, steps):
        """Wrap the wrapper."""
        return _gym_adapter(raw).limit_steps(raw, steps)

    def _batch_adapter(self):
        """Return the library that the wrapper belongs to."""
        if not any(_is_installed(name) for name in GYM_ADAPTERS):
            skip("robosuite.no_batches")
        with library:
            return _gym_adapter(_gym_wrapper())

    def check_env(self, case):
        """Run the checker of the library that the wrapper belongs to."""
        if not _task(case)[1]:
            super().check_env(case)
        with library:
            raw = self.make_raw(case)
            importlib.import_module(_library(raw) + ".utils.env_checker").check_env(raw, skip_render_check=True)
            raw.close()

    def declares_pictures(self, case):
        """Return whether it draws any."""
        return not _task(case)[1]


class Task(Environment):
    """robosuite's own environment: reset() -> observation, step() -> four values, no spaces."""

    def __init__(self, raw, report, seed):
        super().__init__(report)
        self.raw = raw
        self.latest = {}
        self.first_seed = seed
        self.seed_actions(seed)
        with library:
            low, high = raw.action_spec
        self.low, self.high = low, high

    def begin(self, seed):
        """Seed numpy's global generator, which all releases before 1.5 draw from, and reset."""
        import numpy as np

        if seed is not None:
            np.random.seed(seed)
            self._report_seed(seed)
        self.latest = self._examine(self.raw.reset(), "reset()")
        return self.latest

    def advance(self, action):
        """Make one step."""
        result = self.raw.step(action)
        if not isinstance(result, tuple) or len(result) != 4:
            promised = "(observation, reward, done, info)"
            violate("call.result", call="step()", got=describe_value(result), promised=promised)
        observation, reward, done, info = result
        if not isinstance(info, dict):
            violate("call.info", call="step()", got=describe_value(info), promised="a dict")
        self.latest = self._examine(observation, "step()")
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

    def action(self):
        """Draw an action within the bounds that the environment gives."""
        return self.random.uniform(self.low, self.high)

    def describe(self):
        """Return the bounds of actions and the shapes of observations."""
        shapes = ", ".join("{} {}".format(name, getattr(part, "shape", "")) for name, part in self.latest.items())
        bounds = "{} to {}".format(self.low.tolist(), self.high.tolist())
        return {"action_spec": bounds[:500], "observation": shapes[:500]}

    def _report_seed(self, seed):
        """Report a seed that has no effect: since 1.5 robosuite has a generator of its own."""
        if seed != self.first_seed and getattr(self.raw, "rng", None) is not None:
            self.report("seed", "robosuite.seed")

    def _examine(self, observation, call):
        """Examine an observation: the same parts of the same shapes every time."""
        if not isinstance(observation, dict) or not observation:
            violate("call.observation", call=call, got=describe_value(observation), promised="a dict of arrays")
        for name, part in self.latest.items():
            new = observation.get(name)
            if getattr(new, "shape", None) != getattr(part, "shape", None):
                got, promised = describe_value(new), describe_value(part)
                violate("robosuite.changed", call=call, name=repr(name), got=got, promised=promised)
        return observation


def _task(case):
    """Return the name of the task, and whether the id names its gym wrapper."""
    name = case["env"]
    name = name[len("robosuite:") :] if name.startswith("robosuite:") else name
    wrapped = WRAPPED.match(name)
    return (wrapped.group(1), True) if wrapped else (name, False)


def _make_task(task, case, draw=False):
    """Make robosuite's own environment, without a window."""
    base = importlib.import_module("robosuite.environments.base")
    arguments = {"robots": ROBOT, "has_renderer": False, "has_offscreen_renderer": draw, "use_camera_obs": draw}
    if names_argument(base.REGISTERED_ENVS.get(task, base.MujocoEnv), "seed"):
        arguments["seed"] = case["seed"]
    if draw:
        arguments["camera_names"] = CAMERA
    arguments.update(case["kwargs"])
    if draw:  # the arguments of a case do not switch off what draws
        arguments.update(has_offscreen_renderer=True, use_camera_obs=True)
    return importlib.import_module("robosuite").make(task, **arguments)


def _gym_wrapper():
    """Import the wrapper from where it is made: robosuite.wrappers hides why it has none."""
    return importlib.import_module("robosuite.wrappers.gym_wrapper").GymWrapper


def _library(wrapper):
    """Return the name of the library whose environment a wrapper is."""
    kinds = wrapper.__mro__ if isinstance(wrapper, type) else type(wrapper).__mro__
    modules = [kind.__module__.partition(".")[0] for kind in kinds]
    return next(name for name in GYM_ADAPTERS if name in modules)


def _gym_adapter(wrapper):
    return GYM_ADAPTERS[_library(wrapper)]


def _is_installed(name):
    """Return whether a module could be imported; asked without importing anything."""
    finders = [finder for finder in sys.meta_path if hasattr(finder, "find_spec")]
    return any(finder.find_spec(name, None) is not None for finder in finders)


def names_argument(function, name):
    """Return whether a function names this argument."""
    import inspect

    return name in inspect.signature(function).parameters


API = Robosuite()
