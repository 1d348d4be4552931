"""Find MuJoCo's model and data in an environment, and make its step forget all that came before a set state."""

import numpy as np


def simulation_of(raw):
    """Return MuJoCo's model and data of an environment, its step, the simulator's steps in it, and what is not set.

    Environments of Gymnasium and its kin have both as attributes, those of robosuite in `sim`, of dm_control in
    `physics`. The last two count steps and end episodes, so the count is set back before each step.
    """
    if hasattr(raw, "sim") and hasattr(raw, "model_timestep"):
        raw.hard_reset = False  # a hard one makes another model
        model, data = (getattr(raw.sim.model, "_model", None), getattr(raw.sim.data, "_data", None))
        substeps = round(raw.control_timestep / raw.model_timestep)
        return model, data, _robosuite_step(raw), substeps, ("interpolators of controllers",)
    if hasattr(raw, "physics") and hasattr(raw, "action_spec"):

        def step_dm_control(action):
            raw._step_count, raw._reset_next_step = 0, False
            result = raw.step(action)
            return result.observation, result.reward, result.step_type.name == "LAST", {}

        model, data = (getattr(getattr(raw.physics, name, None), "ptr", None) for name in ("model", "data"))
        return model, data, step_dm_control, int(getattr(raw, "_n_sub_steps", 1)), ("state of the task",)
    model, data = getattr(raw, "model", None), getattr(raw, "data", None)
    substeps = getattr(raw, "frame_skip", None) or getattr(raw, "n_substeps", None) or 1
    return model, data, getattr(raw, "step", None), int(substeps), ()


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
