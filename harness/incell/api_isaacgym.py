"""Drive NVIDIA's Isaac Gym: `isaacgym:boxes` is a scene of ours with a camera in each environment.

Arguments of make: `compute_device` and `graphics_device` as create_sim takes them, `pipeline` (`gpu` or `cpu`),
`envs`, and `path`, the way of a picture to the user: `tensor` leaves it on the GPU for PyTorch, `cpu` copies it.

Written against the calls that NVIDIA's documentation and examples show, and checked against isaacgym-stubs.
"""

import importlib

from .cell_adapter import Adapter, Environment
from .cell_callables import local_name
from .cell_errors import library, skip, violate
from .cell_gpus import list_devices
from .cell_observation import place
from .cell_values import as_numbers

PACKAGES = {"isaacgym": "isaacgym"}
NOT_IMPORTED = {"isaacgym": "it compiles itself when it is imported"}
NATIVE_ERRORS = (
    r"\[(?:Error|Fatal)\] \[[\w.-]+\] .+",
    r"\*\*\* Can't create empty tensor.*",
    r"Failed to fill .+ tensor",
)
"""The first is of carb, the framework below Isaac Gym and Isaac Sim."""

SCENE = "boxes"
DEFAULTS = {"compute_device": 0, "graphics_device": 0, "path": "tensor", "pipeline": "gpu", "envs": 2}
HEIGHT, WIDTH = 240, 320
CHANNELS = 4
STATE = 13
"""Numbers of a body's state: place, orientation, linear and angular velocity."""

NO_GRAPHICS = -1
RED, BLUE, GREEN = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
BODIES = ((RED, (0.0, 0.3, 1.6), True), (BLUE, (0.0, 0.3, 0.4), True), (GREEN, (0.7, 0.0, 1.8), False))
"""Colour, place and whether it is fixed: a box above another one, and a sphere that falls next to them."""

FROM, AT = (2.4, -3.1, 1.9), (0.2, 0.1, 0.9)
"""Where the camera is and looks to: one along an axis has drawn black (iamlab-cmu/isaacgym-utils, issue 1)."""

DRIVERS = {"compute": ("cuda", "CUDA"), "graphics": ("vulkan", "Vulkan")}


class IsaacGym(Adapter):
    """The calls of a user: create_sim, create_camera_sensor, simulate, and either way to the picture."""

    def modules(self, case):
        """Return Isaac Gym, which goes before PyTorch, and for tensors its gymtorch, which imports PyTorch."""
        chosen = arguments(case)
        tensors = chosen["path"] == "tensor" or chosen["pipeline"] == "gpu"
        return ["isaacgym.gymapi"] + (["isaacgym.gymtorch"] if tensors else [])

    def make(self, case, report, draw=False):
        """Make a simulation on the requested devices, with graphics only for drawing."""
        name = local_name(case)
        if name != SCENE:
            message = "no scene {!r}; write isaacgym:{}".format(name, SCENE)
            raise LookupError(message)
        chosen = arguments(case)
        devices = available_devices(chosen, ("compute", "graphics") if draw else ("compute",))
        return Simulation(chosen, devices, report, draw)


def arguments(case):
    """Return the arguments of a case, completed."""
    unknown = sorted(set(case["kwargs"]) - set(DEFAULTS))
    chosen = dict(DEFAULTS, **case["kwargs"])
    if unknown or chosen["path"] not in ("tensor", "cpu") or chosen["pipeline"] not in ("gpu", "cpu"):
        message = "arguments are {}, path tensor or cpu, pipeline gpu or cpu; not {}"
        raise LookupError(message.format(", ".join(sorted(DEFAULTS)), case["kwargs"]))
    return chosen


def available_devices(chosen, needed):
    """Return the devices that CUDA and Vulkan see; skip where one that is needed is not there."""
    devices = {role: list_devices(driver) for role, (driver, _) in DRIVERS.items()}
    for role in needed:
        wanted, present = chosen[role + "_device"], devices[role]
        if present is not None and wanted >= len(present):
            skip("isaacgym.no_device", role=role, promised=wanted, driver=DRIVERS[role][1], got=len(present))
    return devices


def device_facts(devices):
    """Return the names of the devices in the order of their numbers, and which of both are the same device."""
    facts = {role: present and list(map(device_name, present)) for role, present in devices.items()}
    graphics = {device["uuid"]: number for number, device in enumerate(devices["graphics"] or ()) if device["uuid"]}
    facts["same"] = [graphics.get(device["uuid"]) for device in devices["compute"] or ()]
    return facts


def device_name(device):
    """Return the name of a device, marked if it is no hardware."""
    return device["name"] + (" (software)" if device.get("kind") == "software" else "")


class Simulation(Environment):
    """Environments side by side in one simulation, no action, no reward, no end; the same start each time."""

    def __init__(self, chosen, devices, report, draw):
        super().__init__(report)
        self.chosen = chosen
        self.devices = devices
        with library:
            gymapi = importlib.import_module("isaacgym.gymapi")
            self.gymapi = gymapi
            self.gym = gymapi.acquire_gym()
        self.tensors = importlib.import_module("isaacgym.gymtorch") if chosen["pipeline"] == "gpu" else None
        self.sim = self._create_simulation(draw)
        self.envs = [self._create_environment(number) for number in range(chosen["envs"])]
        self.cameras = [self._create_camera(env) for env in self.envs] if draw else []
        with library:
            prepared = self.gym.prepare_sim(self.sim)
        if not prepared:
            report("simulation", "isaacgym.prepare")
        self.states = self._acquire_states()

    def _create_simulation(self, draw):
        chosen = self.chosen
        gymapi = self.gymapi
        graphics = chosen["graphics_device"] if draw else NO_GRAPHICS
        gpu = chosen["pipeline"] == "gpu"
        with library:
            params = gymapi.SimParams()
            params.dt = 1.0 / 60.0
            params.up_axis = gymapi.UP_AXIS_Z
            params.gravity = gymapi.Vec3(0.0, 0.0, -9.81)
            params.physx.use_gpu = gpu
            params.use_gpu_pipeline = gpu
            sim = self.gym.create_sim(chosen["compute_device"], graphics, gymapi.SIM_PHYSX, params)
            if sim is not None:
                ground = gymapi.PlaneParams()
                ground.normal = gymapi.Vec3(0.0, 0.0, 1.0)
                self.gym.add_ground(sim, ground)
        if sim is None:
            violate("isaacgym.no_simulation", compute=chosen["compute_device"], graphics=graphics)
        return sim

    def _create_environment(self, group):
        gym = self.gym
        gymapi = self.gymapi
        with library:
            env = gym.create_env(
                self.sim, gymapi.Vec3(-2.0, -2.0, 0.0), gymapi.Vec3(2.0, 2.0, 4.0), self.chosen["envs"]
            )
            for colour, place, stays in BODIES:
                options = gymapi.AssetOptions()
                options.fix_base_link = stays
                if stays:
                    asset = gym.create_box(self.sim, 0.6, 0.1, 0.4, options)
                else:
                    asset = gym.create_sphere(self.sim, 0.15, options)
                pose = gymapi.Transform(gymapi.Vec3(*place), gymapi.Quat(0.0, 0.0, 0.0, 1.0))
                actor = gym.create_actor(env, asset, pose, "body", group, 0)
                gym.set_rigid_body_color(env, actor, 0, gymapi.MESH_VISUAL_AND_COLLISION, gymapi.Vec3(*colour))
        return env

    def _create_camera(self, env):
        gymapi = self.gymapi
        with library:
            properties = gymapi.CameraProperties()
            properties.width = WIDTH
            properties.height = HEIGHT
            properties.enable_tensors = self.chosen["path"] == "tensor"
            camera = self.gym.create_camera_sensor(env, properties)
            if camera == gymapi.INVALID_HANDLE:
                violate("isaacgym.no_camera", got=str(camera))
            self.gym.set_camera_location(camera, env, gymapi.Vec3(*FROM), gymapi.Vec3(*AT))
        return camera

    def _acquire_states(self):
        """Return the states of all bodies before the first step: a tensor on the GPU, an array else."""
        with library:
            if self.tensors is None:
                self.start = self.gym.get_sim_rigid_body_states(self.sim, self.gymapi.STATE_ALL).copy()
                return None
            bodies = self.gym.acquire_rigid_body_state_tensor(self.sim)
            self.roots = self.gym.acquire_actor_root_state_tensor(self.sim)
        if bodies is None or self.roots is None:
            violate("isaacgym.no_state", name="rigid_body" if bodies is None else "actor_root")
        with library:
            self.gym.refresh_actor_root_state_tensor(self.sim)
            self.root = self.tensors.wrap_tensor(self.roots)
            self.start = self.root.clone()
            return self.tensors.wrap_tensor(bodies)

    def begin(self, seed):
        """Put all bodies back, and make the step with which that takes effect."""
        if self.tensors is None:
            done = self.gym.set_sim_rigid_body_states(self.sim, self.start, self.gymapi.STATE_ALL)
        else:
            self.root.copy_(self.start)
            done = self.gym.set_actor_root_state_tensor(self.sim, self.roots)
        if not done:
            violate("isaacgym.set_state")
        return self._step()

    def advance(self, action):
        """Make one step of the simulation, of 1/60 s."""
        return self._step(), 0.0, False, False

    def _step(self):
        gym, sim = self.gym, self.sim
        gym.simulate(sim)
        gym.fetch_results(sim, True)
        if self.tensors is None:
            states = gym.get_sim_rigid_body_states(sim, self.gymapi.STATE_ALL).copy().view("f4")
        else:
            if not gym.refresh_rigid_body_state_tensor(sim):
                violate("isaacgym.refresh")
            states = self.states.cpu().numpy().copy()
        expected = self.chosen["envs"] * len(BODIES)
        if states.size != expected * STATE:
            violate("isaacgym.states", got=int(states.size), promised=STATE, bodies=expected)
        return {"bodies": states.reshape(expected, STATE)}

    def draw(self):
        """Draw the views of all cameras, each of which has to have a picture, and return the first."""
        gym, sim = self.gym, self.sim
        gym.fetch_results(sim, True)
        gym.step_graphics(sim)
        gym.render_all_camera_sensors(sim)
        if self.chosen["path"] == "cpu":
            pictures = [self._picture(number, copied=True) for number in range(len(self.envs))]
        else:
            gym.start_access_image_tensors(sim)
            try:
                pictures = [self._picture(number, copied=False) for number in range(len(self.envs))]
            finally:
                gym.end_access_image_tensors(sim)
        return pictures[0]

    def _picture(self, number, copied):
        """Return the colours of a picture, copied by Isaac Gym or left on the GPU for PyTorch; drop the fourth channel.

        The picture is an array (HEIGHT, WIDTH, 3) of uint8.
        """
        env = self.envs[number]
        camera = self.cameras[number]
        if copied:
            raw = self.gym.get_camera_image(self.sim, env, camera, self.gymapi.IMAGE_COLOR)
        else:
            raw = self.gym.get_camera_image_gpu_tensor(self.sim, env, camera, self.gymapi.IMAGE_COLOR)
        if raw is None:
            call = "get_camera_image()" if copied else "get_camera_image_gpu_tensor()"
            violate("isaacgym.no_picture", call=call, number=number)
        if not copied:
            raw = importlib.import_module("isaacgym.gymtorch").wrap_tensor(raw).cpu().numpy()
        picture = as_numbers(raw, place("the camera image of environment {}".format(number)))
        if picture.size != HEIGHT * WIDTH * CHANNELS or picture.dtype.name != "uint8":
            got = "{} values of {}".format(picture.size, picture.dtype)
            violate("isaacgym.picture", number=number, got=got, promised="{} x {} x {}".format(HEIGHT, WIDTH, CHANNELS))
        return picture.reshape(HEIGHT, WIDTH, CHANNELS)[:, :, :3].copy()

    def describe(self):
        """Return the release, and the devices of this machine."""
        with library:
            version = self.gym.get_version()
        return {"told": dict(device_facts(self.devices), version="{}.{}".format(version.major, version.minor))}

    def close(self):
        """End the simulation."""
        self.gym.destroy_sim(self.sim)


API = IsaacGym()
