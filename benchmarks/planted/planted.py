"""A small scene of MuJoCo with one planted change of a known size, to see what each comparison says of it."""

import gymnasium
import mujoco
import numpy as np

SCENE = """
<mujoco>
  <option timestep="0.005" integrator="Euler"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1"/>
    <body name="box" pos="0 0 .2"><freejoint/><geom name="box" type="box" size=".1 .1 .1" mass="1"/></body>
    <body name="lid" pos="0 0 .38"><freejoint/><geom name="lid" type="box" size=".08 .08 .06" mass=".5"/></body>
    <body name="arm" pos=".5 0 .5">
      <joint name="shoulder" axis="0 1 0" range="-1.5 1.5" limited="true" damping=".5"/>
      <geom name="upper" type="capsule" fromto="0 0 0 -.4 0 0" size=".04" mass=".6"/>
      <body name="hand" pos="-.4 0 0">
        <joint name="wrist" axis="0 1 0" range="-1.2 1.2" limited="true" damping=".2"/>
        <geom name="hand" type="sphere" size=".07" mass=".3"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder" gear="4"/><motor joint="wrist" gear="2"/></actuator>
</mujoco>
"""

ULP = 2.0**-52


class Planted(gymnasium.Env):
    """The scene, with at most one change of it."""

    frame_skip = 4
    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, change="", size=0.0):
        self.change, self.size = change, size
        self.model = mujoco.MjModel.from_xml_string(SCENE)
        self.data = mujoco.MjData(self.model)
        bound = 1.0 + (change == "bounds")
        self.action_space = gymnasium.spaces.Box(-bound, bound, (2,), np.float32)
        self.dtype = np.float32 if change == "dtype" else np.float64
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (self.model.nq + self.model.nv,), self.dtype)
        getattr(self, "plant_" + change, lambda: None)()

    def plant_gravity(self):
        self.model.opt.gravity[2] *= 1 + self.size

    def plant_mass(self):
        self.model.body_mass[1] *= 1 + self.size
        self.model.body_inertia[1] *= 1 + self.size

    def plant_integrator(self):
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4

    def plant_contact(self):
        self.model.geom_solref[:, 0] *= 1 + self.size

    def plant_pair(self):
        self.model.geom_friction[2, 0] *= 1 + self.size

    def plant_damping(self):
        self.model.dof_damping[:] *= 1 + self.size

    def plant_gear(self):
        self.model.actuator_gear[0, 0] *= 1 + self.size

    def plant_limit(self):
        self.model.jnt_range[2] *= 1 + self.size

    def plant_iterations(self):
        self.model.opt.iterations = int(self.size)

    def plant_tolerance(self):
        self.model.opt.tolerance = self.size

    def reset(self, seed=None, options=None):
        super().reset(seed=seed)
        random = np.random.RandomState(seed) if self.change == "generator" else self.np_random
        mujoco.mj_resetData(self.model, self.data)
        spread = 0.02 * (1 + (self.size if self.change == "spread" else 0.0))
        self.data.qpos[:3] += spread * (random.uniform(size=3) - 0.5)
        self.data.qpos[14:] += 10 * spread * (random.uniform(size=2) - 0.5)
        mujoco.mj_forward(self.model, self.data)
        return self.observation(), {}

    def observation(self):
        values = np.concatenate([self.data.qpos, self.data.qvel])
        if self.change == "order":
            values = values[::-1]
        return values.astype(self.dtype)

    def step(self, action):
        height = self.data.qpos[2]
        self.data.ctrl[:] = action
        if self.change == "ulp":  # each number is moved by one ulp, as rounding in another order would
            dice = np.random.RandomState(int(self.size))
            self.data.qpos[:] *= 1 + ULP * dice.choice([-1, 1], self.model.nq)
            self.data.qvel[:] *= 1 + ULP * dice.choice([-1, 1], self.model.nv)
        mujoco.mj_step(self.model, self.data, nstep=self.frame_skip)
        if self.change != "reward_before":
            height = self.data.qpos[2]
        reward = height - 0.1 * float(np.sum(np.square(action)))
        if self.change == "reward":
            reward *= 1 + self.size
        fallen = bool(self.data.qpos[2] < 0.05 + (self.size if self.change == "ending" else 0.0))
        info = {"height": height, **({"more": 1} if self.change == "info" else {})}
        return self.observation(), reward, fallen, False, info


def make(change="", size=0.0):
    """Make the scene with a change of some size."""
    return Planted(change, size)
