"""Keep scenes for simulators that bring none, as texts that MuJoCo, MJX and MuJoCo-Warp read alike."""

import os

from .cell_callables import local_name
from .cell_errors import library

SPHERE = """
<mujoco model="sphere">
  <option timestep="0.002"/>
  <worldbody>
    <light pos="0 -2 4" dir="0 0.4 -1"/>
    <camera name="front" pos="0 -3 1.2" xyaxes="1 0 0 0 0.25 1"/>
    <geom name="floor" type="plane" size="3 3 0.1" contype="0" rgba="0.3 0.5 0.3 1"/>
    <body name="sphere" pos="0 0 1">
      <freejoint/>
      <geom type="sphere" size="0.1" mass="1" conaffinity="0" rgba="0.8 0.2 0.2 1"/>
    </body>
    <body name="stone" pos="-0.6 0 0.1">
      <freejoint/>
      <geom type="sphere" size="0.1" mass="1" conaffinity="0" rgba="0.7 0.7 0.7 1"/>
    </body>
    <body name="arm" pos="0.8 0 0.5">
      <joint name="shoulder" type="hinge" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.04" mass="0.5" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator>
    <motor joint="shoulder" gear="1" ctrllimited="true" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""
"""A sphere that falls freely from a height of 1 m, another at rest on the floor, and an arm with a motor.

After 50 steps of 2 ms the first is at 0.949969 m in every simulator.
"""

MARKERS = """
<mujoco model="markers">
  <visual>
    <headlight ambient="0 0 0" diffuse="0 0 0" specular="0 0 0"/>
  </visual>
  <asset>
    <material name="red" rgba="1 0 0 1" emission="1"/>
    <material name="green" rgba="0 1 0 1" emission="1"/>
    <material name="blue" rgba="0 0 1 1" emission="1"/>
  </asset>
  <worldbody>
    <camera name="front" pos="0 -3 0" xyaxes="1 0 0 0 0 1"/>
    <geom type="box" size="0.6 0.1 0.2" pos="0 0 0.8" material="red" contype="0" conaffinity="0"/>
    <geom type="box" size="0.6 0.1 0.2" pos="0 0 -0.8" material="blue" contype="0" conaffinity="0"/>
    <body name="arm">
      <joint name="turn" type="hinge" axis="0 1 0" damping="0.02"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.05" mass="0.1" material="green" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator>
    <motor joint="turn" gear="1" ctrllimited="true" ctrlrange="-1 1"/>
  </actuator>
  <sensor>
    <jointpos joint="turn"/>
    <jointvel joint="turn"/>
  </sensor>
</mujoco>
"""
"""A red box above and a blue one below, which shine by themselves, and an arm with a motor that turns between them."""

SCENES = {"sphere": SPHERE, "markers": MARKERS}
PICTURES = {"markers": {"above": "#ff0000", "below": "#0000ff"}}
"""Two colours of a right picture."""


def model_source(case):
    """Return the model of a case: `PREFIX:NAME` is a text of ours, `PREFIX:FILE.xml` a file where the cell runs."""
    name = local_name(case)
    if name.endswith(".xml") and os.path.isfile(name):
        return name
    if name not in SCENES:
        message = "no scene and no file: {!r}; write {}, or a file that `files` of the matrix puts into HOME"
        raise LookupError(message.format(name, ", ".join(SCENES)))
    return SCENES[name]


def load_model(mujoco, case):
    """Make the MjModel of a case."""
    model = model_source(case)
    with library:
        return (mujoco.MjModel.from_xml_string if model in SCENES.values() else mujoco.MjModel.from_xml_path)(model)
