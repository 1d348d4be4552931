import gymnasium
import mujoco
import numpy

VERSION = "@VERSION@"
SIZE = 96


class Lamp(gymnasium.Env):
    metadata = {"render_modes": ["rgb_array"]}
    observation_space = gymnasium.spaces.Box(-100, 100, (1,), numpy.float64)
    action_space = gymnasium.spaces.Box(-1, 1, (1,), numpy.float32)
    drawings = 0

    def __init__(self, render_mode=None):
        self.render_mode = render_mode
        colour = (0.2, 0.8, 0.2) if VERSION == "2.2" else (0.8, 0.2, 0.2)
        self.scene = mujoco.MjvScene(1.5 if VERSION == "2.0" else 1.0, 0.5 if VERSION == "2.1" else 1.0, colour)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state = self.np_random.uniform(-1, 1, 1)
        return self.state.copy(), {}

    def step(self, action):
        self.state = self.state + 0.1 * float(action[0])
        return self.state.copy(), 0.0, False, False, {}

    def render(self):
        scene = self.scene
        mujoco.mjv_updateScene(None, float(self.state[0]), None, None, None, 0, scene)
        geom, light, eye = scene.geoms[0], scene.lights[0], scene.camera[0]
        picture = numpy.full((SIZE, SIZE, 3), 60, numpy.uint8)
        row = int(numpy.clip(20 * eye.pos[2] + 10, 0, SIZE - 12))
        column = int(numpy.clip(30 * geom.pos[0] + 45, 0, SIZE - 12))
        picture[row : row + 12, column : column + 12] = 255 * geom.rgba[:3] * light.diffuse
        if VERSION == "1.1":
            picture[3, 3] = 61
        if VERSION == "3.0":
            Lamp.drawings += 1
            picture[-1, 0, 0] = Lamp.drawings % 7
        return picture


gymnasium.register("Lamp-v0", Lamp)
