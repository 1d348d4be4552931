"""Drive MuJoCo's own bindings: `mujoco:markers` is a scene of ours, `mujoco:FILE.xml` a model of one's own."""

import importlib

from .cell_adapter import Adapter, Environment
from .cell_callables import local_name
from .cell_errors import library
from .cell_scenes import PICTURES, load_model

PACKAGES = {"mujoco": "mujoco"}
IDS = r".+\.xml|markers"
EXAMPLE = "mujoco:markers"
DRAWS = ("mujoco",)
DRAWING_CODE = (r"/mujoco/(?:egl|osmesa|glfw|gl_context|rendering|renderer)\b",)
READS_MUJOCO_GL = ("mujoco",)

HEIGHT, WIDTH = 240, 320
STATE = ("qpos", "qvel", "act", "ctrl", "qacc_warmstart", "qfrc_applied", "xfrc_applied", "mocap_pos", "mocap_quat")
"""The parts of a state besides the time, where the bindings have no mj_getState."""


class Bindings(Adapter):
    """The calls of a user: MjModel, MjData, mj_step, Renderer."""

    imports = ("mujoco",)

    def make(self, case, report, draw=False):
        """Make a model, its data and a renderer."""
        mujoco = importlib.import_module("mujoco")
        model = load_model(mujoco, case)
        return Simulation(mujoco, model, report, draw)

    def picture_colours(self, case):
        """Return the colours of those scenes of ours that have some above and others below."""
        return PICTURES.get(local_name(case))


class Simulation(Environment):
    """A model that is stepped with random controls; the same start each time, no reward, no end."""

    def __init__(self, mujoco, model, report, draw):

        super().__init__(report)
        self.mujoco = mujoco
        self.model = model
        self.drawer = None
        with library:
            self.data = mujoco.MjData(model)
            if draw:
                self.drawer = (Renderer if hasattr(mujoco, "Renderer") else Context)(mujoco, model)
            self.integration = getattr(getattr(mujoco, "mjtState", None), "mjSTATE_INTEGRATION", None)

    def begin(self, seed):
        """Go back to where the model starts."""
        self.mujoco.mj_resetData(self.model, self.data)
        self.mujoco.mj_forward(self.model, self.data)
        return self._observed()

    def advance(self, action):
        """Make one step of the simulation."""
        self.data.ctrl[:] = action
        self.mujoco.mj_step(self.model, self.data)
        for number, warning in enumerate(self.data.warning):
            if warning.number:
                text = self.mujoco.mju_warningText(number, warning.lastinfo)
                self.report("simulation", "mujoco.warned", text=text)
        return self._observed(), 0.0, False, False

    def _observed(self):
        return {name: getattr(self.data, name).copy() for name in ("qpos", "qvel", "sensordata")}

    def draw(self):
        """Draw the view of the first camera of the model, or of the free one."""
        return self.drawer.draw(self.data, 0 if self.model.ncam else -1)

    def get_state(self):
        """Return all that a simulation goes on from."""
        import numpy as np

        with library:
            if self.integration is None:
                return self.data.time, {name: getattr(self.data, name).copy() for name in STATE}
            state = np.empty(self.mujoco.mj_stateSize(self.model, self.integration))
            self.mujoco.mj_getState(self.model, self.data, state, self.integration)
            return state

    def set_state(self, state):
        """Go back to where a state was taken."""
        with library:
            if self.integration is None:
                self.data.time = state[0]
                for name, value in state[1].items():
                    getattr(self.data, name)[:] = value
            else:
                self.mujoco.mj_setState(self.model, self.data, state, self.integration)

    def action(self):
        """Draw controls within their ranges, from a normal distribution where they have none."""
        low, high = self.model.actuator_ctrlrange.T
        limited = self.model.actuator_ctrllimited.astype(bool)
        values = self.random.standard_normal(self.model.nu)
        uniform = self.random.uniform(low * limited, high * limited)
        values[limited] = uniform[limited]
        return values

    def describe(self):
        """Return the sizes of the model."""
        return {name: int(getattr(self.model, name)) for name in ("nq", "nv", "nu", "nbody", "ngeom", "nsensordata")}

    def close(self):
        """Close the renderer."""
        if self.drawer is not None:
            self.drawer.close()


class Renderer:
    """Renderer of MuJoCo 2.3 and later."""

    def __init__(self, mujoco, model):
        self.raw = mujoco.Renderer(model, HEIGHT, WIDTH)

    def draw(self, data, camera):
        """Return a picture."""
        self.raw.update_scene(data, camera)
        return self.raw.render()

    def close(self):
        """Free the context, where the release can."""
        if hasattr(self.raw, "close"):
            self.raw.close()


class Context:
    """Renderer before MuJoCo 2.3: an OpenGL context, whose pictures begin at the bottom."""

    def __init__(self, mujoco, model):
        self.mujoco = mujoco
        self.model = model
        self.raw = mujoco.GLContext(WIDTH, HEIGHT)
        self.raw.make_current()
        self.drawn = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self.drawn)
        self.scene = mujoco.MjvScene(model, maxgeom=1000)
        self.option = mujoco.MjvOption()
        self.camera = mujoco.MjvCamera()
        self.camera.lookat[:] = model.stat.center
        self.camera.distance = 1.5 * model.stat.extent

    def draw(self, data, camera):
        """Return a picture, turned over as a user has to."""
        import numpy as np

        mujoco = self.mujoco
        if camera >= 0:
            self.camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self.camera.fixedcamid = camera
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self.model, data, self.option, None, self.camera, everything, self.scene)
        place = mujoco.MjrRect(0, 0, WIDTH, HEIGHT)
        mujoco.mjr_render(place, self.scene, self.drawn)
        picture = np.empty((HEIGHT, WIDTH, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(picture, None, place, self.drawn)
        return np.flipud(picture)

    def close(self):
        """Free both."""
        self.drawn.free()
        self.raw.free()


API = Bindings()
