"""A kitchen of one arm and one kettle with the four defects of Diffusion Policy's, for machines without a checkout.

The kettle's file, which another one includes, names a top-level default class: MuJoCo refuses that since 3.2. The
simulation is loaded by dm_control, whose index of a model's fields fits MuJoCo of its day. The vector environment
calls helpers of gym in the order of arguments that they had before 0.22, and `collections.Mapping` went with Python
3.10.

`make` gives the environment alone, loaded by MuJoCo itself, of gymnasium or gym, whichever is there. The other classes
have the names and calls of Diffusion Policy's; nothing here is a copy of its code.
"""

import collections
import multiprocessing
from copy import deepcopy

import numpy as np

try:
    import gymnasium as gym
except ImportError:
    import gym

KITCHEN = """
<mujoco model="kitchen">
  <include file="counter.xml"/>
  <include file="kettle.xml"/>
  <option timestep="0.005"/>
  <visual><global offwidth="640" offheight="480"/></visual>
  <worldbody>
    <light pos="0 -1 3" dir="0 0.3 -1"/>
    <geom class="counter" name="counter" type="plane" size="2 2 .1"/>
    <body name="arm" pos="-.4 0 .3">
      <joint name="shoulder" axis="0 0 1" damping="2" range="-1.5 1.5" limited="true"/>
      <geom type="capsule" fromto="0 0 0 .5 0 0" size=".04" rgba=".7 .7 .7 1"/>
    </body>
    <body name="kettle" pos=".4 .2 .12">
      <freejoint/>
      <geom class="kettle" name="pot"/>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder" ctrlrange="-1 1" ctrllimited="true" gear="5"/></actuator>
</mujoco>
"""
COUNTER = b"""
<mujocoinclude>
  <default><default class="counter"><geom rgba=".5 .35 .2 1" friction="1 .1 .1"/></default></default>
</mujocoinclude>
"""
KETTLE = b"""
<mujocoinclude>
  <default class="kettle"><geom type="sphere" size=".1" rgba=".8 .1 .1 1"/></default>
</mujocoinclude>
"""
MENDED = KETTLE.replace(b"<default class", b"<default><default class").replace(b"</default>", b"</default></default>")

CLASSIC = hasattr(gym.Env, "seed")
LONGEST = 280


def assets(mended):
    """Return the files that the scene includes; `mended` is what a maintainer would do: the class nested."""
    return {"counter.xml": COUNTER, "kettle.xml": MENDED if mended else KETTLE}


class ByMuJoCo:
    """The simulation, loaded by MuJoCo's own bindings."""

    def __init__(self, mended):
        import mujoco

        self.mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_string(KITCHEN, assets(mended))
        self.data = mujoco.MjData(self.model)

    def reset(self):
        self.mujoco.mj_resetData(self.model, self.data)
        self.mujoco.mj_forward(self.model, self.data)

    def forward(self):
        self.mujoco.mj_forward(self.model, self.data)

    def step(self, number):
        for _ in range(number):
            self.mujoco.mj_step(self.model, self.data)


class ByControl:
    """The simulation, loaded by dm_control."""

    def __init__(self, mended):
        from dm_control import mujoco

        self.physics = mujoco.Physics.from_xml_string(KITCHEN, assets(mended))
        self.model, self.data = self.physics.model, self.physics.data

    def reset(self):
        self.physics.reset()

    def forward(self):
        self.physics.forward()

    def step(self, number):
        self.physics.step(number)


class Kitchen(gym.Env):
    """The base of all environments: positions and velocities are observed, the shoulder is turned."""

    metadata = {"render_modes": []}  # noqa: RUF012 - as in every user's environment

    def __init__(self, loader, mended=False):
        self.simulation = loader(mended)
        self.data = self.simulation.data
        self.init_qpos = np.array(self.data.qpos)
        self.init_qvel = np.array(self.data.qvel)
        self.noise = np.random.RandomState(0)
        self.steps = 0
        size = len(self.init_qpos) + len(self.init_qvel)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.action_space = gym.spaces.Box(-1, 1, (1,), np.float32)

    def observed(self):
        return np.concatenate([self.data.qpos, self.data.qvel]).astype(np.float32)

    def start(self, seed=None):
        if seed is not None:
            self.noise = np.random.RandomState(seed)
        self.steps = 0
        self.simulation.reset()
        self.data.qpos[0] = 0.1 * self.noise.standard_normal()
        self.simulation.forward()
        return self.observed()

    def turn(self, action):
        self.steps += 1
        self.data.ctrl[:] = action
        self.simulation.step(4)
        return self.observed(), float(-abs(self.data.qpos[0])), self.steps >= LONGEST


class Modern(Kitchen):
    """The API of five values, of gymnasium and gym 0.26."""

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.start(seed), {}

    def step(self, action):
        observation, reward, over = self.turn(action)
        return observation, reward, False, over, {}


class Classic(Kitchen):
    """The API of four values, of gym before 0.26."""

    def seed(self, seed=None):
        self.noise = np.random.RandomState(seed)
        return [seed]

    def reset(self):
        return self.start()

    def step(self, action):
        return (*self.turn(action), {})


class Empty(gym.Env):
    """Spaces without a simulation: what a process makes that only has to know them."""

    metadata = {"render_modes": []}  # noqa: RUF012
    observation_space = gym.spaces.Box(-np.inf, np.inf, (15,), np.float32)
    action_space = gym.spaces.Box(-1, 1, (1,), np.float32)

    def reset(self, **_):
        message = "there is no simulation in this process"
        raise RuntimeError(message)

    step = reset


def make(mended=False, masked=False):
    """Make the environment; `masked`, the process that starts workers makes an empty one and sees no error."""
    if masked and multiprocessing.current_process().name == "MainProcess":
        return Empty()
    return (Classic if CLASSIC else Modern)(ByMuJoCo, mended)


# --- the calls of Diffusion Policy ---------------------------------------------------------------------------------


class KitchenAllV0(Classic):
    """As in `diffusion_policy.env.kitchen.v0`."""

    robot_noise_ratio = 0.1

    def __init__(self, use_abs_action=False):
        super().__init__(ByControl)
        self.sim = self.simulation.physics
        if isinstance(self.observed(), collections.Mapping):
            message = "observations are arrays"
            raise TypeError(message)
        self.observation_space = gym.spaces.Box(-8, 8, (60,), np.float32)
        self.action_space = gym.spaces.Box(-1, 1, (9,), np.float32)

    def set_state(self, qpos, qvel):
        self.data.qpos[:] = qpos
        self.data.qvel[:] = qvel
        self.simulation.forward()

    def observed(self):
        values = super().observed()
        return np.concatenate([values, np.zeros(60 - len(values), np.float32)])

    def step(self, action):
        return super().step(action[:1])


class KitchenLowdimWrapper(gym.Env):
    """As in `diffusion_policy.env.kitchen.kitchen_lowdim_wrapper`."""

    def __init__(self, env, init_qpos=None, init_qvel=None, render_hw=(240, 360)):
        self.env = env
        self.init_qpos = init_qpos
        self.init_qvel = init_qvel
        self.render_hw = render_hw
        self.observation_space = env.observation_space
        self.action_space = env.action_space

    def seed(self, seed=None):
        return self.env.seed(seed)

    def reset(self):
        observation = self.env.reset()
        if self.init_qpos is None:
            return observation
        self.env.set_state(self.init_qpos, self.init_qvel)
        return self.env.observed()

    def step(self, action):
        return self.env.step(action)

    def render(self, mode="rgb_array"):
        height, width = self.render_hw
        return self.env.sim.render(height, width)


class VideoRecorder:
    """As in `diffusion_policy.real_world.video_recorder`; nothing is filmed here."""

    @classmethod
    def create_h264(cls, **_):
        return cls()

    def stop(self):
        pass


class VideoRecordingWrapper(gym.Wrapper):
    """As in `diffusion_policy.gym_util.video_recording_wrapper`."""

    def __init__(self, env, video_recoder, file_path=None, steps_per_render=1):
        super().__init__(env)
        self.video_recoder = video_recoder
        self.file_path = file_path


class MultiStepWrapper(gym.Wrapper):
    """As in `diffusion_policy.gym_util.multistep_wrapper`: several actions a step, the last observations of it."""

    def __init__(self, env, n_obs_steps, n_action_steps, max_episode_steps):
        super().__init__(env)
        self.observation_space = repeated(env.observation_space, n_obs_steps)
        self.action_space = repeated(env.action_space, n_action_steps)
        self.kept = n_obs_steps
        self.longest = max_episode_steps

    def reset(self):
        self.seen, self.done = [self.env.reset()] * self.kept, []
        return np.array(self.seen)

    def step(self, actions):
        rewards = []
        for action in actions:
            if any(self.done):
                break
            observation, reward, done, _ = self.env.step(action)
            self.seen = [*self.seen[1:], observation]
            self.done.append(bool(done) or len(self.done) + 1 >= self.longest)
            rewards.append(reward)
        return np.array(self.seen), max(rewards, default=0.0), any(self.done), {}

    def run_dill_function(self, dilled):
        import dill

        return dill.loads(dilled)(self)


def repeated(space, number):
    """Return the space of so many environments as one."""
    return gym.spaces.Box(np.stack([space.low] * number), np.stack([space.high] * number), dtype=space.dtype)


class SyncVectorEnv:
    """As in `diffusion_policy.gym_util.sync_vector_env`."""

    def __init__(self, env_fns):
        self.envs = [env_fn() for env_fn in env_fns]
        self.observation_space = repeated(self.envs[0].observation_space, len(env_fns))
        self.action_space = repeated(self.envs[0].action_space, len(env_fns))

    def call_each(self, name, args_list):
        return [getattr(env, name)(*arguments) for env, arguments in zip(self.envs, args_list)]

    def reset(self):
        return np.stack([env.reset() for env in self.envs])

    def step(self, actions):
        return batch([env.step(action) for env, action in zip(self.envs, actions)])

    def close(self):
        for env in self.envs:
            env.close()


def batch(results):
    """Return the steps of several environments as one."""
    observations, rewards, done, infos = zip(*results)
    return np.stack(observations), np.array(rewards), np.array(done), infos


class AsyncVectorEnv(gym.vector.VectorEnv):
    """As in `diffusion_policy.gym_util.async_vector_env`: spaces from a dummy, workers that are told what to call."""

    def __init__(self, env_fns, dummy_env_fn=None, shared_memory=True, context=None):
        from gym.vector import utils

        dummy = (dummy_env_fn or env_fns[0])()
        self.metadata = dummy.metadata
        gym.vector.VectorEnv.__init__(self, len(env_fns), dummy.observation_space, dummy.action_space)
        dummy.close()
        started = multiprocessing.get_context(context)
        self.observations = np.zeros(self.observation_space.shape, np.float32)
        if shared_memory:
            space, number = self.single_observation_space, self.num_envs
            buffer = utils.create_shared_memory(space, n=number, ctx=started)
            try:
                self.observations = utils.read_from_shared_memory(buffer, space, n=number)
            except gym.error.CustomSpaceError:
                message = "Using `shared_memory=True` in `AsyncVectorEnv` is incompatible with non-standard Gym "
                raise ValueError(message + "observation spaces")  # noqa: B904 - as it is there
        self.parent_pipes, self.processes = [], []
        for env_fn in env_fns:
            here, there = started.Pipe()
            self.parent_pipes.append(here)
            pickled_fn = utils.CloudpickleWrapper(env_fn)
            self.processes.append(started.Process(target=serve, args=(pickled_fn, there, here), daemon=True))
            self.processes[-1].start()
            there.close()
        self._all("observation_space", [None] * len(env_fns))

    def _all(self, name, arguments):
        for pipe, argument in zip(self.parent_pipes, arguments):
            pipe.send((name, argument))
        return [pipe.recv() for pipe in self.parent_pipes]

    def call_each(self, name, args_list):
        return self._all(name, args_list)

    def reset(self):
        self.observations[:] = np.stack(self._all("reset", [()] * self.num_envs))
        return deepcopy(self.observations)

    def step(self, actions):
        observations, rewards, done, infos = batch(self._all("step", [(action,) for action in actions]))
        self.observations[:] = observations
        return deepcopy(self.observations), rewards, done, infos

    def close_extras(self, terminate=False):
        if not terminate:
            self._all("close", [()] * self.num_envs)
        for process in self.processes:
            if terminate:
                process.terminate()
            process.join()


def serve(env_fn, pipe, other):
    """Run a worker: make an environment, and answer requests for its attributes and calls until `close`."""
    env = env_fn()
    other.close()
    while True:
        name, arguments = pipe.recv()
        attribute = getattr(env, name)
        pipe.send(attribute(*arguments) if arguments is not None else attribute)
        if name == "close":
            return
