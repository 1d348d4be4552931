"""Drive Isaac Lab 3, which needs no Isaac Sim: `isaaclab:Isaac-Cartpole` is a task under Newton on a CPU.

An environment of Isaac Lab is always a batch, of torch tensors: `kwargs.num_envs` worlds, whose next episodes begin
by themselves. `kwargs.overrides` are those of its configuration, such as `physics=newton_kamino`. A robot that lies on
NVIDIA's servers and no file here stands in for has to be fetched from there.
"""

import importlib
from time import monotonic

from .cell_batched_worlds import TensorWorlds, WorldsAdapter
from .cell_callables import local_name
from .cell_cartpole import use_local_cartpole
from .cell_errors import library, skip, violate
from .cell_values import describe_value

PACKAGES = {"isaaclab": "isaaclab"}
NOT_IMPORTED = {
    "isaaclab": "it starts a simulator when it is imported",
    "isaacsim": "it starts a simulator when it is imported",
}
IDS = r"Isaac-[\w-]+"
EXAMPLE = "isaaclab:Isaac-Cartpole-Direct"
NATIVE_ERRORS = (r"\[(?:Error|Fatal)\] \[[\w.-]+\] .+",)

CHOSEN = {"num_envs": 4, "device": "cpu", "overrides": ()}
"""Arguments of a case that configure its task, with their defaults."""

COLOURS = "rgb"


class IsaacLab(WorldsAdapter):
    """The calls of a user: the task's configuration, for the CPU and so many worlds, and gymnasium's make."""

    name = "Isaac Lab"
    imports = ("isaaclab", "isaaclab_tasks")

    def make(self, case, report, draw=False):
        """Make the environment of a case; its pictures are those of a camera in its scene."""
        if draw:
            with library:
                settings = self.configured(case)
            if not any(COLOURS in getattr(part, "data_types", ()) for part in vars(settings.scene).values()):
                skip("isaaclab.no_camera")
        return self.simulate(case, report)

    def simulate(self, case, report, worlds=None):
        """Make a task, of this many worlds unless that is None."""
        more = {} if worlds is None else {"num_envs": worlds}
        began = monotonic()
        with library:
            raw = self.make_raw(case, **more)
        return Task(raw, report, monotonic() - began)

    def make_raw(self, case, **more):
        """Make the library's own object; only one may be open at a time in a process."""
        options = {name: value for name, value in case["kwargs"].items() if name not in CHOSEN}
        settings = self.configured(case, **more)
        return importlib.import_module("gymnasium").make(local_name(case), cfg=settings, **options)

    def configured(self, case, **more):
        """Make the configuration of a task as it can be run here."""
        given = dict(case["kwargs"], **more)
        chosen = dict(CHOSEN, **{name: value for name, value in given.items() if name in CHOSEN})
        settings = importlib.import_module("isaaclab_tasks.utils").parse_env_cfg(local_name(case), **chosen)
        _use_local_parts(settings, chosen["device"])
        settings.seed = case["seed"]
        return settings


class Task(TensorWorlds):
    """A task of Isaac Lab, driven by random actions within -1 and 1 where it bounds them no closer.

    `seconds` are those that making it took, then those of each step.
    """

    def __init__(self, raw, report, seconds):
        import numpy as np

        task = raw.unwrapped
        space = task.single_action_space
        super().__init__(raw, task, report, *np.clip([space.low, space.high], -1, 1))
        self.seconds = [seconds]

    def call_step(self, action):
        """Call the library's own step, and note the seconds that it took."""
        began = monotonic()
        result = self.raw.step(action)
        self.seconds.append(monotonic() - began)
        return result

    def as_array(self, where, tensor):
        """Return the values of a tensor, which has to lie where the task computes, as a numpy array."""
        if not isinstance(tensor, self.torch.Tensor):
            violate("isaaclab.not_tensor", where=where, got=describe_value(tensor))
        if tensor.device != self.torch.device(self.task.device):
            violate("isaaclab.device", where=where, got=str(tensor.device), promised=str(self.task.device))
        return tensor.detach().cpu().numpy().copy()

    def compare(self, where, array, space):
        """Report another dtype, and spaces of the batch that have no parts."""
        whole = self.task.observation_space
        if not hasattr(whole, "spaces"):
            self.report("space", "isaaclab.observation_space", got=type(whole).__name__)
        if array.dtype != space.dtype:
            got, promised = str(array.dtype), str(space.dtype)
            self.report("type", "value.dtype", where=where, got=got, promise="space", promised=promised)

    def draw(self):
        """Return the picture of a camera in the first world."""
        outputs = [sensor.data.output for sensor in self.task.scene.sensors.values() if hasattr(sensor.data, "output")]
        pictures = next(output[COLOURS] for output in outputs if COLOURS in output)
        return getattr(pictures, "torch", pictures)[0].cpu().numpy()

    def get_state(self):
        """Return the state of the scene."""
        with library:
            return self.task.scene.get_state(is_relative=True)

    def set_state(self, state):
        """Put the scene into a state."""
        with library:
            self.task.scene.reset_to(state, is_relative=True)
            self.task.sim.forward()

    def describe(self):
        """Return the device, the spaces and the physics; once it was driven, how long that took."""
        facts = super().describe()
        with library:
            names = ("observation_space", "action_space")
            facts.update((name, str(getattr(self.task, name))[:500]) for name in names)
            physics = self.task.cfg.sim.physics
            facts["physics"] = type(getattr(physics, "solver_cfg", physics)).__name__
        if len(self.seconds) > 2:
            making, first, *others = self.seconds
            seconds = {"making": making, "first_step": first, "step": sum(others) / len(others)}
            facts["told"] = dict(facts, seconds={name: round(value, 4) for name, value in seconds.items()})
        return facts


def _use_local_parts(settings, device):
    """Replace parts of a task's configuration that need NVIDIA's servers or a GPU by local ones, where there are any.

    The ground is a picture from there, and the cart and pole never touch it.
    """
    import tempfile

    folder = tempfile.gettempdir()
    for name, part in vars(settings.scene).items():
        use_local_cartpole(getattr(part, "spawn", None), folder)
        if type(getattr(part, "spawn", None)).__name__ == "GroundPlaneCfg":
            setattr(settings.scene, name, None)
    if device == "cpu" and hasattr(settings.sim.physics, "use_cuda_graph"):
        settings.sim.physics.use_cuda_graph = False


API = IsaacLab()
