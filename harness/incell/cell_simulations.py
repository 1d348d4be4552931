"""Find MuJoCo's model and data in an environment, and make its step forget all that came before a set state."""

from collections import namedtuple

import numpy as np

from .cell_task_memory import TaskMemory

Simulation = namedtuple("Simulation", "model data step substeps unset memory")
"""MuJoCo's model and data of an environment, its step, the simulator's steps in it, the names of what is not set, and
the memory of its task or None."""

FARAMA_ROBOTS = ("gymnasium_robotics", "metaworld")
"""Packages whose environments keep goals, objects' places and earlier observations outside of MuJoCo's data."""


def simulation_of(env, raw):
    """Return the simulation of an opened environment, which was reset; `raw` is the library's own object.

    Environments of Gymnasium and its kin have model and data as attributes, those of robosuite in `sim`, of dm_control
    in `physics`. The last two count steps and end episodes, so the count is set back before each step.
    """
    if hasattr(raw, "sim") and hasattr(raw, "model_timestep"):
        raw.hard_reset = False  # a hard one makes another model
        model, data = (getattr(raw.sim.model, "_model", None), getattr(raw.sim.data, "_data", None))
        substeps = round(raw.control_timestep / raw.model_timestep)
        return Simulation(model, data, _robosuite_step(raw), substeps, ("interpolators of controllers",), None)
    if hasattr(raw, "physics") and hasattr(raw, "action_spec"):

        def step_dm_control(action):
            raw._step_count, raw._reset_next_step = 0, False
            result = raw.step(action)
            return result.observation, result.reward, result.step_type.name == "LAST", {}

        model, data = (getattr(getattr(raw.physics, name, None), "ptr", None) for name in ("model", "data"))
        substeps = int(getattr(raw, "_n_sub_steps", 1))
        return Simulation(model, data, step_dm_control, substeps, ("state of the task",), None)
    model, data, step, memory = (*(getattr(raw, name, None) for name in ("model", "data", "step")), None)
    inner = getattr(raw, "robot_env", raw)  # the kitchen's robot is an environment of its own
    substeps = getattr(inner, "frame_skip", None) or getattr(inner, "n_substeps", None) or 1
    is_farama = any(kind.__module__.partition(".")[0] in FARAMA_ROBOTS for kind in type(raw).__mro__)
    if is_farama and hasattr(model, "body_pos"):  # mazes have their model elsewhere
        step, memory = _farama_step(raw, inner), TaskMemory(env, (raw,) if inner is raw else (raw, inner), model, data)
    return Simulation(model, data, step, int(substeps), (), memory)


def _farama_step(raw, inner):
    """Return the step of an environment of these packages that begins a new episode at the state that was set.

    Noise of observations is drawn from a generator that is seeded anew.
    """

    def step(action):
        if hasattr(raw, "curr_path_length"):  # Meta-World raises once an episode is over
            raw.curr_path_length = 0
        if hasattr(raw, "tasks_to_complete"):
            raw.tasks_to_complete = set(raw.goal)
            raw.episode_task_completions.clear()
        if inner is not raw:
            inner.np_random = np.random.Generator(np.random.PCG64(0))
        return raw.step(action)

    return step


CONTROLLER_MEMORY = ("last_err", "summed_err", "last_joint_vel")
"""Arrays in which controllers of robosuite remember the steps before."""


def _robosuite_step(raw):
    """Return the step of an environment of robosuite that forgets what came before the state that was set.

    Its observations are taken from the state after the step: those that the environment returns may be older.
    """

    def step(action):
        raw.timestep, raw.done = 0, False
        for robot in raw.robots:
            _forget_steps(robot)
        _, reward, done, info = raw.step(action)
        return raw._get_observations(force_update=True), reward, done, info

    return step


def _forget_steps(robot):
    """Set the memory of a robot's controller and gripper to that of one that has not moved yet."""
    controller, gripper = getattr(robot, "controller", None), getattr(robot, "gripper", None)
    if hasattr(controller, "reset_goal"):  # since 1.5 controllers are parts of one that has another form
        controller.update(force=True)
        controller.reset_goal()
        for name, memory in vars(controller).items():
            if name in CONTROLLER_MEMORY and memory is not None:
                setattr(controller, name, np.zeros_like(memory))
            elif hasattr(memory, "buf") and hasattr(memory, "clear"):
                memory.clear()
    if hasattr(gripper, "current_action"):  # it closes and opens by and by
        gripper.current_action = np.zeros_like(gripper.current_action)
