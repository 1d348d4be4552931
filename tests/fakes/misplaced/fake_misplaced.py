import gymnasium
import mujoco
import numpy


class Robot(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-9, 9, (2,), numpy.float64)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, render_mode=None, forgets=False, settles=False):
        """Make a robot.

        Args:
            forgets (bool): whether a reset leaves the joints where the model has them.
            settles (bool): whether a reset steps the simulation.
            initial_qpos (np.ndarray): initial position value of the joints in the simulation.
        """
        self.model = mujoco.MjModel()
        self.data = mujoco.MjData(self.model)
        self.initial_qpos = numpy.array([0.4, 0.48])
        self.forgets, self.settles = forgets, settles

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.data.qpos[:] = 0 if self.forgets else self.initial_qpos
        if self.settles:
            mujoco.mj_step(self.model, self.data)
        return self.data.qpos.copy(), {}

    def step(self, action):
        mujoco.mj_step(self.model, self.data, nstep=2)
        return self.data.qpos.copy(), 0.0, False, False, {}


gymnasium.register("Robot-v0", Robot)
