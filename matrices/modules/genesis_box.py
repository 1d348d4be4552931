"""A box that falls on a plane in Genesis, as one Gymnasium environment: its observation is where the box is."""

import genesis as gs
import gymnasium
import numpy as np


class FallingBox(gymnasium.Env):
    """A scene of one plane and one box, which nothing drives."""

    def __init__(self, backend, render_mode=None):
        gs.init(backend=getattr(gs, backend), logging_level="warning")
        self.scene = gs.Scene(show_viewer=False, sim_options=gs.options.SimOptions(dt=0.01))
        self.scene.add_entity(gs.morphs.Plane())
        self.box = self.scene.add_entity(gs.morphs.Box(pos=(0, 0, 1), size=(0.2, 0.2, 0.2)))
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

    def _place(self):
        """Return the place of the box."""
        return self.box.get_pos().cpu().numpy().astype(np.float32)


def make(backend="gpu", render_mode=None):
    """Make the scene on a backend of Genesis."""
    return FallingBox(backend, render_mode)
