"""Play a part of the class Gym: bodies that fall to the ground, cameras that fail as was reported."""

import numpy as np

from . import machine

LINEAR, ANGULAR = [(axis, "<f4") for axis in "xyz"], [(axis, "<f4") for axis in "xyzw"]
STATE = np.dtype([("pose", [("p", LINEAR), ("r", ANGULAR)]), ("vel", [("linear", LINEAR), ("angular", LINEAR)])])
"""RigidBodyState.dtype of the stubs."""

SKY, GROUND = (130, 170, 220), (90, 90, 90)
ALIVE = []
"""Simulations: there can be one (https://github.com/RoboVerseOrg/RoboVerse/pull/294)."""


class Buffer:
    """Memory that a tensor is wrapped around."""

    def __init__(self, memory):
        self.memory = memory


class Environment:
    """One environment of a simulation."""

    def __init__(self, sim):
        self.sim = sim


class Asset:
    """A shape."""

    def __init__(self, options):
        self.fixed = options.fix_base_link


class Simulation:
    """Bodies under gravity above a ground, each a row of 13 numbers."""

    def __init__(self, compute, graphics, params):
        self.graphics = graphics
        self.step = params.dt
        self.on_gpu = params.use_gpu_pipeline
        self.gravity = np.array([params.gravity.x, params.gravity.y, params.gravity.z], dtype="f4")
        self.failure = machine.failure(f"c{compute}g{graphics}")
        self.rows, self.fixed, self.colours, self.cameras = [], [], [], []
        self.states = None
        self.drawn = self.open = False

    def reported(self, camera=None):
        """Return the report on the way that a camera's pictures go; of any way before there is one."""
        ways = ("tensor", "cpu") if camera is None else ("tensor" if camera.enable_tensors else "cpu",)
        return next((self.failure[way] for way in ways if way in self.failure), {})


def create_sim(compute_device, graphics_device, type, params):
    if ALIVE:
        return None
    sim = Simulation(compute_device, graphics_device, params)
    ALIVE.append(sim)
    machine.say(sim.reported().get("create_sim", ()))
    return sim


def create_actor(env, asset, pose, *_):
    sim = env.sim
    place = [pose.p.x, pose.p.y, pose.p.z, pose.r.x, pose.r.y, pose.r.z, pose.r.w]
    sim.rows.append(place + [0.0] * 6)
    sim.fixed.append(asset.fixed)
    sim.colours.append((255, 255, 255))
    return len(sim.rows) - 1


def set_rigid_body_color(env, actor, body, mesh, colour):
    env.sim.colours[actor] = tuple(int(255 * part) for part in (colour.x, colour.y, colour.z))


def create_camera_sensor(env, properties):
    sim = env.sim
    told = sim.reported(properties)
    machine.say(told.get("create_camera_sensor", ()))
    if told.get("image") == "crash":
        machine.crash()
    if told.get("image") == "no camera" or sim.graphics < 0:
        return -1
    sim.cameras.append(properties)
    return len(sim.cameras) - 1


def prepare_sim(sim):
    sim.states = np.array(sim.rows, dtype="f4")
    for camera in sim.cameras:
        machine.say(sim.reported(camera).get("prepare_sim", ()))
    return True


def simulate(sim):
    moving = ~np.array(sim.fixed)
    sim.states[moving, 7:10] += sim.gravity * sim.step
    sim.states[moving, :3] += sim.states[moving, 7:10] * sim.step
    below = moving & (sim.states[:, 2] < 0.15)
    sim.states[below, 2], sim.states[below, 7:10] = 0.15, 0.0
    sim.drawn = False


def render_all_camera_sensors(sim):
    sim.drawn = True


def start_access_image_tensors(sim):
    sim.open = True


def end_access_image_tensors(sim):
    sim.open = False


def get_camera_image_gpu_tensor(sim, env, camera, kind):
    seen = image(sim, sim.cameras[camera]) if sim.cameras[camera].enable_tensors and sim.open else None
    return None if seen is None else Buffer(seen)


def get_camera_image(sim, env, camera, kind):
    seen = image(sim, sim.cameras[camera])
    return None if seen is None else seen.reshape(len(seen), -1)


def image(sim, camera):
    """Sky, ground, and a square for each body of the first environment: (height, width, 4) of uint8."""
    fate = sim.reported(camera).get("image")
    if fate == "none":
        return None
    picture = np.zeros((camera.height, camera.width, 4), dtype=np.uint8)
    if fate != "black" and sim.drawn:
        picture[:, :] = (*SKY, 255)
        picture[camera.height * 4 // 5 :, :, :3] = GROUND
        for row, colour in zip(sim.states[:3], sim.colours):
            across, down = int(camera.width * (0.5 + 0.2 * row[0])), int(camera.height * (0.8 - 0.35 * row[2]))
            picture[max(down - 12, 0) : down + 12, across - 12 : across + 12, :3] = colour
    return picture


def set_sim_rigid_body_states(sim, states, flags):
    if sim.on_gpu:
        return False
    sim.states[:] = states.view("f4").reshape(sim.states.shape)
    return True


PLAYS = {
    "create_sim": create_sim,
    "destroy_sim": ALIVE.remove,
    "add_ground": lambda sim, params: None,
    "create_env": lambda sim, lower, upper, per_row: Environment(sim),
    "create_box": lambda sim, width, height, depth, options: Asset(options),
    "create_sphere": lambda sim, radius, options: Asset(options),
    "create_actor": create_actor,
    "set_rigid_body_color": set_rigid_body_color,
    "create_camera_sensor": create_camera_sensor,
    "set_camera_location": lambda camera, env, place, target: None,
    "prepare_sim": prepare_sim,
    "simulate": simulate,
    "fetch_results": lambda sim, wait: None,
    "step_graphics": lambda sim: None,
    "render_all_camera_sensors": render_all_camera_sensors,
    "start_access_image_tensors": start_access_image_tensors,
    "end_access_image_tensors": end_access_image_tensors,
    "get_camera_image": get_camera_image,
    "get_camera_image_gpu_tensor": get_camera_image_gpu_tensor,
    "acquire_rigid_body_state_tensor": lambda sim: Buffer(sim.states),
    "acquire_actor_root_state_tensor": lambda sim: Buffer(sim.states),
    "refresh_rigid_body_state_tensor": lambda sim: True,
    "refresh_actor_root_state_tensor": lambda sim: True,
    "set_actor_root_state_tensor": lambda sim, tensor: True,
    "get_sim_rigid_body_states": lambda sim, flags: sim.states.copy().view(STATE).reshape(-1),
    "set_sim_rigid_body_states": set_sim_rigid_body_states,
}
"""By the names of the stubs."""
