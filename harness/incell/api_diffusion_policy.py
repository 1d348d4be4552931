"""Drive Diffusion Policy: `diffusion_policy:kitchen`, as its own `KitchenLowdimRunner` makes and drives it.

The runner itself cannot be had without torch and wandb; what it does before a policy comes in is done here with the
same classes of the checkout, in its order. `kwargs` are arguments of the runner, with its defaults, and `dummy`: false
leaves out the `dummy_env_fn` by which the runner's parent process learns the spaces without making an environment.
"""

import importlib
import os

from .cell_adapter import Adapter, Environment
from .cell_callables import local_name
from .cell_errors import library, skip, violate
from .cell_gym_classic import ClassicEnvironment
from .cell_values import Examiner

PACKAGES = {"diffusion-policy": "diffusion_policy"}

NAME = "kitchen"
VARIABLE = "DIFFUSION_POLICY"
DATA = ("data", "kitchen")
"""Where the runner's settings have the data set, below the checkout."""

RUNNER = {
    "abs_action": False,
    "robot_noise_ratio": 0.1,
    "n_obs_steps": 2,
    "n_action_steps": 8,
    "max_steps": 280,
    "render_hw": (240, 360),
    "fps": 12.5,
    "crf": 22,
}
OBSERVED, ACTED, BOUND = 60, 9, 8
"""What the runner's stand-in for the environment promises: sizes of observation and action, and their bound."""

STATES, SPREAD = 10, 0.01
"""How many initial states are generated, and how far around the environment's own (standard deviation)."""


class DiffusionPolicy(Adapter):
    """The Kitchen, one and several, whose modules the runner imports first; the environment's come in with it."""

    imports = (
        "diffusion_policy.gym_util.async_vector_env",
        "diffusion_policy.gym_util.sync_vector_env",
        "diffusion_policy.gym_util.multistep_wrapper",
        "diffusion_policy.gym_util.video_recording_wrapper",
    )

    def has_environment(self, case):
        """Return whether it is the environment that this adapter makes."""
        return local_name(case) == NAME

    def make(self, case, report, draw=False):
        """Make one environment."""
        with library:
            raw = self.make_raw(case)
        return Kitchen(raw, report)

    def make_raw(self, case):
        """Make the library's own object in the way of the runner's `env_fn`."""
        if not self.has_environment(case):
            violate("diffusion_policy.environment", got=repr(local_name(case)), promised=repr(NAME))
        arguments = _runner_arguments(case)
        kitchen = _part("env.kitchen.v0").KitchenAllV0(use_abs_action=arguments["abs_action"])
        kitchen.robot_noise_ratio = arguments["robot_noise_ratio"]
        observed = _part("env.kitchen.kitchen_lowdim_wrapper").KitchenLowdimWrapper(
            env=kitchen, init_qpos=None, init_qvel=None, render_hw=tuple(arguments["render_hw"])
        )
        video = _part("gym_util.video_recording_wrapper")
        recorder = video.VideoRecorder.create_h264(
            fps=arguments["fps"],
            codec="h264",
            input_pix_fmt="rgb24",
            crf=arguments["crf"],
            thread_type="FRAME",
            thread_count=1,
        )
        filmed = video.VideoRecordingWrapper(observed, video_recoder=recorder, file_path=None, steps_per_render=1)
        return _with_several_steps(filmed, arguments)

    def make_vector(self, makers, options, report):
        """Make Diffusion Policy's own vector environments, in workers with a stand-in for the spaces unless refused."""
        with library:
            case = makers[0].case
            arguments = _runner_arguments(case)
            if options is None:
                raw = _part("gym_util.sync_vector_env").SyncVectorEnv(makers)
            else:
                dummy = None if case["kwargs"].get("dummy") is False else DummyFactory(arguments)
                raw = _part("gym_util.async_vector_env").AsyncVectorEnv(makers, dummy_env_fn=dummy, **options)
        return Kitchens(raw, report, len(makers), arguments)

    def autoreset_modes(self):
        """Skip: none of them begins episodes anew."""
        skip("diffusion_policy.no_autoreset")


class DummyFactory:
    """The runner's `dummy_env_fn`: spaces without an environment."""

    def __init__(self, arguments):
        self.arguments = arguments

    def __call__(self):
        """Make an empty environment that has the spaces."""
        import numpy as np

        gym = importlib.import_module("gym")
        spaces = importlib.import_module("gym.spaces")
        env = gym.Env()
        env.observation_space = spaces.Box(-BOUND, BOUND, shape=(OBSERVED,), dtype=np.float32)
        env.action_space = spaces.Box(-BOUND, BOUND, shape=(ACTED,), dtype=np.float32)
        env.metadata = {"render.modes": ["human", "rgb_array", "depth_array"], "video.frames_per_second": 12}
        return _with_several_steps(env, self.arguments)


class StartState:
    """The runner's `init_fn`: the start state of an episode, set in the process that has the environment."""

    def __init__(self, seed):
        self.seed = seed

    def __call__(self, env):
        """Set an initial state, and a seed, which decides the noise of observations."""
        observed = env.env.env
        env.env.video_recoder.stop()
        env.env.file_path = None
        states = recorded_states() or generated_states(observed.env)
        observed.init_qpos, observed.init_qvel = [part[self.seed % len(part)] for part in states]
        env.seed(self.seed)


def recorded_states():
    """Return the initial positions and velocities of the data set; None where the checkout has none."""
    import numpy as np

    folder = os.path.join(os.environ.get(VARIABLE, ""), *DATA)
    files = [os.path.join(folder, "all_init_{}.npy".format(part)) for part in ("qpos", "qvel")]
    return [np.load(path) for path in files] if all(map(os.path.isfile, files)) else None


def generated_states(env):
    """Return initial positions around the environment's own, and its own velocities."""
    import numpy as np

    random = np.random.RandomState(0)
    qpos, qvel = [np.tile(np.asarray(part, float), (STATES, 1)) for part in (env.init_qpos, env.init_qvel)]
    return [qpos + SPREAD * random.standard_normal(qpos.shape), qvel]


class Kitchen(ClassicEnvironment):
    """One environment: each of its steps takes several actions and gives the last observations."""

    def __init__(self, raw, report, batch=None):
        super().__init__(raw, Examiner(importlib.import_module("gym.spaces"), raw, report, batch), seeds_at_reset=False)

    def reset(self, seed=None):
        """Start an episode, with a seed also from another state, and return the observation."""
        with library:
            if seed is not None:
                self.choose_start(seed)
            observation = self.raw.reset()
        self.examiner.observation("reset()", observation)
        return observation

    def choose_start(self, seed):
        """Choose the start state of the next episodes."""
        self.raw.run_dill_function(importlib.import_module("dill").dumps(StartState(seed)))

    def render(self):
        """Return the picture that a video is made of."""
        with library:
            return self.raw.env.env.render(mode="rgb_array")

    def call_where_drawn(self, ask):
        """Ask in the thread in which dm_control draws."""
        with self.raw.env.env.env.sim.contexts.gl.make_current() as context:
            return context.call(ask)

    def describe(self):
        """Return the spaces, and where the initial states are from."""
        generated = "generated: {} around the environment's own, standard deviation {}".format(STATES, SPREAD)
        return dict(super().describe(), told={"initial states": "of the data set" if recorded_states() else generated})


class Kitchens(Kitchen):
    """Several kitchens, driven as the runner drives them: each gets its start state in its own process."""

    def __init__(self, raw, report, number, arguments):
        super().__init__(raw, report, number)
        self.number = number
        self.arguments = arguments

    def choose_start(self, seed):
        """Choose another start state for each kitchen."""
        dill = importlib.import_module("dill")
        starts = [(dill.dumps(StartState(seed + place)),) for place in range(self.number)]
        self.raw.call_each("run_dill_function", args_list=starts)

    seed_actions = Environment.seed_actions  # the space of the runner's stand-in is wider than the environment's

    def action(self):
        """Draw actions within the bounds of the environment itself: float32 (number, steps, size)."""
        bound = BOUND if self.arguments["abs_action"] else 1
        shape = (self.number, self.arguments["n_action_steps"], ACTED)
        return self.random.uniform(-bound, bound, shape).astype("float32")


def _with_several_steps(env, arguments):
    return _part("gym_util.multistep_wrapper").MultiStepWrapper(
        env,
        n_obs_steps=arguments["n_obs_steps"],
        n_action_steps=arguments["n_action_steps"],
        max_episode_steps=arguments["max_steps"],
    )


def _runner_arguments(case):
    """Return the runner's arguments."""
    arguments = {name: value for name, value in case["kwargs"].items() if name != "dummy"}
    for name in arguments:
        if name not in RUNNER:
            violate("diffusion_policy.argument", got=repr(name), promised=", ".join(RUNNER))
    return dict(RUNNER, **arguments)


def _part(name):
    return importlib.import_module("diffusion_policy." + name)


API = DiffusionPolicy()
