"""Scenes for simulators that bring none, as texts that MuJoCo, MJX and MuJoCo-Warp read alike."""

SPHERE = """
<mujoco model="sphere">
  <option timestep="0.002"/>
  <worldbody>
    <light pos="0 -2 4" dir="0 0.4 -1"/>
    <camera name="front" pos="0 -3 1.2" xyaxes="1 0 0 0 0.25 1"/>
    <geom name="floor" type="plane" size="3 3 0.1" rgba="0.3 0.5 0.3 1"/>
    <body name="sphere" pos="0 0 1">
      <freejoint/>
      <geom type="sphere" size="0.1" mass="1" rgba="0.8 0.2 0.2 1"/>
    </body>
    <body name="stone" pos="-0.6 0 0.1">
      <freejoint/>
      <geom type="sphere" size="0.1" mass="1" rgba="0.7 0.7 0.7 1"/>
    </body>
    <body name="arm" pos="0.8 0 0.5">
      <joint name="shoulder" type="hinge" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.04" mass="0.5" rgba="0.2 0.3 0.8 1"/>
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

SCENES = {"sphere": SPHERE}


def load(mujoco, case):
    """Make the MjModel of a case: `PREFIX:NAME` is a scene of ours, `PREFIX:FILE.xml` a file where the cell runs."""
    name = case["env"].partition(":")[2] or case["env"]
    if name.endswith(".xml"):
        return mujoco.MjModel.from_xml_path(name)
    if name not in SCENES:
        message = "there is no scene {!r}: write {}, or the name of an .xml file".format(name, ", ".join(SCENES))
        raise LookupError(message)
    return mujoco.MjModel.from_xml_string(SCENES[name])
