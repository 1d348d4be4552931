"""The same scene with lights, colours and a camera, and one planted change of what it looks like."""

import mujoco
import numpy as np

import planted

SHOWN = planted.SCENE.replace(
    "<worldbody>",
    """
  <asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".3 .4 .5" rgb2=".6 .6 .5" width="64" height="64"/>
    <material name="tiles" texture="tiles" texrepeat="8 8"/>
  </asset>
  <worldbody>
    <camera name="front" pos="0 -2.2 1.2" xyaxes="1 0 0 0 .4 1"/>
    <light pos="1 -1 3" dir="-.3 .3 -1" diffuse=".7 .7 .7"/>
""",
).replace('size="3 3 .1"/>', 'size="3 3 .1" material="tiles"/>')


class Shown(planted.Planted):
    """The scene, drawn, with at most one change of its looks."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012
    drawings = 0

    def __init__(self, change="", size=0.0, render_mode=None):
        super().__init__()
        self.model = mujoco.MjModel.from_xml_string(SHOWN)
        self.data = mujoco.MjData(self.model)
        self.look, self.size, self.render_mode = change, size, render_mode
        getattr(self, "plant_" + change, lambda: None)()
        self.renderer = None

    def plant_camera(self):
        self.model.cam_pos[0, 1] *= 1 + self.size

    def plant_turn(self):
        mujoco.mju_euler2Quat(self.model.cam_quat[0], [0.9 * (1 + self.size), 0, 0], "xyz")

    def plant_lens(self):
        self.model.cam_fovy[0] *= 1 + self.size

    def plant_light(self):
        self.model.light_diffuse[0] *= 1 + self.size

    def plant_lamp(self):
        self.model.light_pos[0, 0] += self.size

    def plant_colour(self):
        self.model.geom_rgba[1, 0] *= 1 - self.size

    def plant_texture(self):
        self.model.tex_data[:] = np.clip(self.model.tex_data * (1 + self.size), 0, 255).astype(np.uint8)

    def plant_thing(self):
        self.model.geom_size[1] *= 1 + self.size

    def plant_samples(self):
        self.model.vis.quality.offsamples = int(self.size)

    def render(self):
        if self.renderer is None:
            self.renderer = mujoco.Renderer(self.model, 240, 320)
        self.renderer.update_scene(self.data, camera="front")
        picture = self.renderer.render().copy()
        if self.look == "pixel":
            picture[100, 100] = (picture[100, 100].astype(int) + int(self.size)) % 256
        if self.look == "loose":
            Shown.drawings += 1
            picture[0, 0, 0] = Shown.drawings % 251
        return picture

    def close(self):
        if self.renderer is not None:
            self.renderer.close()


def make(change="", size=0.0, render_mode=None):
    """Make the scene with a change of some size."""
    return Shown(change, size, render_mode)
