"""Drive dm_control's suite: `dm_control:cheetah/run` is a domain and a task, and environments speak dm_env."""

import importlib

from .cell_adapter import Adapter, Environment
from .cell_callables import user_callable
from .cell_errors import library, skip, violate
from .cell_observation import inside, place
from .cell_values import check_array, check_number, describe_value

PACKAGES = {"dm-control": "dm_control"}
IDS = r"\w+/\w+"
EXAMPLE = "dm_control:cheetah/run"
DRAWS = ("dm_control",)
READS_MUJOCO_GL = ("dm-control",)

FIELDS = ("step_type", "reward", "discount", "observation")
UNBOUNDED = 1e9
"""A bound beyond this (MuJoCo's own largest is 1e10) is none."""


class Suite(Adapter):
    """The calls of a user: `suite.load`, reset, step, `physics.render`."""

    imports = ("dm_control.suite",)

    def modules(self, case):
        """Return the suite, or the module of a callable that makes an environment."""
        factory = user_callable(case)
        return [factory.module] if factory else list(self.imports)

    def has_environment(self, case):
        """Return whether the suite has the task, or it is a callable of the user's."""
        return user_callable(case) is not None or super().has_environment(case)

    def environment_names(self):
        """Return all tasks, as `domain/task`."""
        return ["/".join(task) for task in importlib.import_module("dm_control.suite").ALL_TASKS]

    def make(self, case, report, draw=False):
        """Load the task, which takes its randomness then; any task draws."""
        factory = user_callable(case)
        if factory:
            with library:
                return Task(factory.make(dict(case["kwargs"])), report)
        domain, _, task = case["env"].rpartition(":")[2].partition("/")
        options = dict(case["kwargs"])
        options["task_kwargs"] = dict({"random": case["seed"]}, **options.get("task_kwargs", {}))
        with library:
            raw = importlib.import_module("dm_control.suite").load(domain, task, **options)
        return Task(raw, report)


class Task(Environment):
    """An environment of dm_env whose physics can be asked and drawn."""

    def __init__(self, raw, report):
        super().__init__(report)
        self.raw = raw
        with library:
            if not hasattr(raw, "physics"):
                self.get_state = None
            self.specs = raw.observation_spec()
            self.actions = raw.action_spec()

    def reset(self, seed=None):
        """Start an episode; the seed is given to the generator that the task was loaded with."""
        with library:
            generator = self._random_generator()
            if seed is not None and generator is not None:
                generator.seed(seed)
            first = self.raw.reset()
        self._examine("reset()", first, ("FIRST",))
        if first.reward is not None or first.discount is not None:
            self.report("type", "dm_control.first_step")
        return first.observation

    def _random_generator(self):
        """Return the random generator of a task of the suite, or of an environment of composer."""
        generator = getattr(getattr(self.raw, "task", None), "random", None)
        return getattr(self.raw, "random_state", None) if generator is None else generator

    def step(self, action):
        """Make one step; the end of an episode with a discount is a truncation."""
        with library:
            result = self.raw.step(action)
        self._examine("step()", result, ("MID", "LAST"))
        check_number(result.reward, place("a reward", "step()"))
        check_number(result.discount, place("a discount", "step()"))
        if not 0 <= result.discount <= 1:
            violate("dm_control.discount", got=str(result.discount))
        ended = result.step_type.name == "LAST"
        return result.observation, result.reward, ended and result.discount == 0, ended and result.discount != 0

    def _examine(self, call, result, types):
        """Examine the parts of a time step, its observation against the specs."""
        if not isinstance(result, tuple) or getattr(result, "_fields", None) != FIELDS:
            violate("call.result", call=call, got=describe_value(result), promised="a time step of dm_env")
        named = getattr(result.step_type, "name", None)
        if named not in types:
            violate("dm_control.step_type", call=call, got=str(result.step_type), promised=" or ".join(types))
        observation, promised = result.observation, self.specs
        if not hasattr(observation, "keys") or set(observation) != set(promised):
            violate("call.observation", call=call, got=describe_value(observation), promised=", ".join(promised))
        remarks = []
        for name, spec in promised.items():
            where = inside(place("an observation", call), name)
            check_array(observation[name], spec.shape, spec.dtype, where, remarks, "spec")
        for kind, code, data in remarks:
            self.report(kind, code, **data)

    def draw(self):
        """Draw the view of the first camera of the model, or of the free one."""
        if not hasattr(self.raw, "physics"):
            skip("dm_control.no_physics")
        camera = 0 if self.raw.physics.model.ncam else -1
        return self.raw.physics.render(height=240, width=320, camera_id=camera)

    def call_where_drawn(self, ask):
        """Ask in the thread of its own in which dm_control draws by OSMesa."""
        with self.raw.physics.contexts.gl.make_current() as context:
            return context.call(ask)

    def get_state(self):
        """Return the state by dm_control, and the time and warm start that a simulation also goes on from."""
        with library:
            physics = self.raw.physics
            return physics.get_state(), physics.data.time, physics.data.qacc_warmstart.copy()

    def set_state(self, state):
        """Set a state in a reset of the physics, as documented, which derives all else again."""
        with library:
            physics = self.raw.physics
            with physics.reset_context():
                physics.set_state(state[0])
                physics.data.time = state[1]
                physics.data.qacc_warmstart[:] = state[2]
            physics.data.qacc_warmstart[:] = state[2]

    def action(self):
        """Draw an action within its bounds, from a normal distribution where it has none."""
        import numpy as np

        shape, unbounded = self.actions.shape, float("inf")
        low = np.broadcast_to(np.asarray(getattr(self.actions, "minimum", -unbounded), "d"), shape)
        high = np.broadcast_to(np.asarray(getattr(self.actions, "maximum", unbounded), "d"), shape)
        bounded = (abs(low) < UNBOUNDED) & (abs(high) < UNBOUNDED)
        values = self.random.standard_normal(shape)
        uniform = self.random.uniform(np.where(bounded, low, 0), np.where(bounded, high, 0))
        values = np.where(bounded, uniform, values)
        return values.astype(self.actions.dtype)

    def describe(self):
        """Return the specs as text."""
        with library:
            specs = {"observation_space": self.specs, "action_space": self.actions}
            return {name: str(spec)[:500] for name, spec in specs.items()}


API = Suite()
