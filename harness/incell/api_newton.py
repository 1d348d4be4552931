"""Drive Newton: `newton:sphere` is a scene of ours, under the solver that `kwargs.solver` names."""

import importlib

from .cell_batched_worlds import Worlds, WorldsAdapter
from .cell_errors import library
from .cell_observation import place
from .cell_scenes import model_source

PACKAGES = {"newton": "newton"}
IDS = r".+\.xml"
EXAMPLE = "newton:sphere"

SOLVER = "mujoco"
TIMESTEP = 0.002
TORQUE = 1.0


class Newton(WorldsAdapter):
    """The calls of a user: a builder, replicated worlds, a solver between two states."""

    name = "Newton"
    imports = ("warp", "newton")

    def simulate(self, case, report, worlds=None):
        """Build a model and its solver."""
        return Simulation(case, report, worlds)


class Simulation(Worlds):
    """A model whose last joint is driven by random torques; the same start each time."""

    def __init__(self, case, report, worlds):
        import numpy as np

        super().__init__(report, worlds, np.array([-TORQUE]), np.array([TORQUE]))
        newton = importlib.import_module("newton")
        kwargs = dict(case["kwargs"])
        solver = _solver(newton, kwargs.pop("solver", SOLVER))
        with library:
            world = newton.ModelBuilder()
            world.add_mjcf(model_source(case))
            builder = newton.ModelBuilder()
            builder.replicate(world, worlds or 1)
            self.model = builder.finalize()
            self.solver = solver(self.model, **kwargs)
            self.control = self.model.control()
            self.state, self.next = self.model.state(), self.model.state()
            self.collide = _collider(newton, solver, self.model)
        self.newton = newton
        self.bodies = self.model.body_count // (worlds or 1)

    def begin(self, seed):
        """Begin with the state that the model has."""
        self.state, self.next = self.model.state(), self.model.state()
        self.newton.eval_fk(self.model, self.model.joint_q, self.model.joint_qd, self.state)
        return self._observed()

    def advance(self, action):
        """Make one step of all worlds."""
        import numpy as np

        forces = np.zeros((action.size, self.control.joint_f.size // action.size), dtype=np.float32)
        forces[:, -1] = action.reshape(-1)
        self.control.joint_f.assign(forces.reshape(-1))
        self.state.clear_forces()
        self.solver.step(self.state, self.next, self.control, self.collide(self.state), TIMESTEP)
        self.state, self.next = self.next, self.state
        return self.complete_step(self._observed())

    def _observed(self):
        parts = {"body_q": 7, "body_qd": 6}
        arrays = {name: getattr(self.state, name).numpy() for name in parts}
        shaped = {name: array.reshape((*self.shape, self.bodies, -1)) for name, array in arrays.items()}
        return {name: self.copy_array(place(name), shaped[name], (self.bodies, size)) for name, size in parts.items()}

    def describe(self):
        """Return the device, and the sizes of the model."""
        with library:
            return {"device": str(self.model.device), "solver": type(self.solver).__name__, "bodies": self.bodies}


def _solver(newton, name):
    solvers = {each[len("Solver") :].lower(): each for each in dir(newton.solvers) if each.startswith("Solver")}
    solvers.pop("base", None)
    if name not in solvers:
        message = "Newton has no solver {!r}: it has {}".format(name, ", ".join(sorted(solvers)))
        raise LookupError(message)
    with library:
        return getattr(newton.solvers, solvers[name])


def _collider(newton, solver, model):
    """Return a function that finds contacts; with MuJoCo's solver, which finds its own, that returns None."""
    if solver.__name__ == "SolverMuJoCo":
        return lambda state: None
    pipeline = newton.CollisionPipeline(model)
    contacts = pipeline.contacts()

    def collide(state):
        pipeline.collide(state, contacts)
        return contacts

    return collide


API = Newton()
