"""A box that falls on a plane in Genesis, as one Gymnasium environment: its observation is where the box is."""

from functools import cache

import genesis as gs
import gymnasium
import numpy as np


@cache
def start(backend):
    """Start Genesis once in a process: it refuses a second time."""
    gs.init(backend=getattr(gs, backend), logging_level="warning")


class FallingBox(gymnasium.Env):
    """A scene of one plane and one box, which nothing drives."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - as Gymnasium has it

    def __init__(self, backend, render_mode=None):
        start(backend)
        self.scene = gs.Scene(show_viewer=False, sim_options=gs.options.SimOptions(dt=0.01))
        self.scene.add_entity(gs.morphs.Plane())
        self.box = self.scene.add_entity(gs.morphs.Box(pos=(0, 0, 1), size=(0.2, 0.2, 0.2)))
        self.camera = None
        if render_mode:
            self.camera = self.scene.add_camera(res=(320, 240), pos=(2.5, 0.0, 1.5), lookat=(0, 0, 0.5), fov=40)
        self.scene.build()
        self.render_mode = render_mode
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        """Put the box where it was."""
        super().reset(seed=seed)
        self.scene.reset()
        return self._place(), {}

    def step(self, action):
        """Make one step; the action has no effect."""
        self.scene.step()
        place = self._place()
        return place, float(place[2]), False, False, {}

    def render(self):
        """Return what the camera sees."""
        return np.asarray(self.camera.render(rgb=True)[0], np.uint8)

    def _place(self):
        """Return the place of the box."""
        return self.box.get_pos().cpu().numpy().astype(np.float32)


def make(backend="gpu", render_mode=None):
    """Make the scene on a backend of Genesis."""
    return FallingBox(backend, render_mode)
