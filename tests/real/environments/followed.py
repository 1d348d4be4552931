"""An environment that is drawn by a camera of its own: one that follows the ball, or a free one."""

import gymnasium
import mujoco
import numpy as np

MODEL = """
<mujoco>
  <worldbody>
    <light pos="0 0 4"/>
    <geom type="plane" size="9 9 .1" rgba=".3 .5 .3 1"/>
    <body name="runner" pos="4 0 1">
      <joint type="slide" axis="1 0 0"/>
      <geom type="sphere" size=".2" rgba=".8 .2 .2 1"/>
    </body>
    <body name="stander" pos="-4 0 1"><geom type="sphere" size=".2" rgba=".2 .2 .8 1"/></body>
  </worldbody>
</mujoco>
"""


class Followed(gymnasium.Env):
    """A ball that is drawn by a camera of one's own."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012 - as gymnasium has it
    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, render_mode=None, kind="tracking"):
        self.render_mode = render_mode
        self.model = mujoco.MjModel.from_xml_string(MODEL)
        self.data = mujoco.MjData(self.model)
        self.renderer = self.camera = None
        self.kind = kind

    def reset(self, *, seed=None, options=None):
        """Start where the model does."""
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)
        return self.data.qpos.copy(), {}

    def step(self, action):
        """Push the ball."""
        self.data.qfrc_applied[0] = 100 * (action + 1)
        mujoco.mj_step(self.model, self.data)
        return self.data.qpos.copy(), 0.0, False, False, {}

    def render(self):
        """Draw the ball."""
        if self.renderer is None:
            self.renderer, self.camera = mujoco.Renderer(self.model, 120, 160), mujoco.MjvCamera()
            mujoco.mjv_defaultFreeCamera(self.model, self.camera)
        if self.kind == "tracking":
            self.camera.type, self.camera.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, 1
            self.camera.distance = 3
        if self.kind == "written":
            self.camera.lookat[:] = self.data.body("runner").xpos
        self.renderer.update_scene(self.data, self.camera)
        return self.renderer.render()

    def close(self):
        """Close the renderer."""
        if self.renderer is not None:
            self.renderer.close()
