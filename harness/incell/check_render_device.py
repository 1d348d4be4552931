"""Compare the device that draws with the one that settings name, and measure whose memory it takes.

A device is known by its place in what eglQueryDevicesEXT lists. That order is the driver's: CUDA counts otherwise.
"""

import ctypes
import json
import os

from .cell_batch import open_batch
from .cell_callables import local_name
from .cell_episode import open_single
from .cell_errors import Skip, observed_error, skip, summary, violate
from .cell_opengl_context import c_function, cuda_number, current_context, describe_device, drawing_device, first_answer
from .cell_originals import getpid
from .cell_workers import Maker, end_workers

ARGUMENT = "render_gpu_device_id"
VARIABLES = EGL_ID, CUDA = "MUJOCO_EGL_DEVICE_ID", "CUDA_VISIBLE_DEVICES"
MOST = 32
CAMERA = {"has_offscreen_renderer": True, "use_camera_obs": True, "camera_names": "agentview"}
"""Arguments with which robosuite draws whenever it observes."""

PATIENCE = 5.0


def run(probe, facts):
    """Draw one picture; it has to be drawn by the device that each setting names."""
    wanted = device_settings(probe.case)
    measurements = facts["told"] = {"asked": wanted}
    memory = Memory()
    memory.note("before")
    try:
        with open_single(probe, draw=True) as env:
            env.seed_actions(probe.case["seed"])
            env.reset(probe.case["seed"])
            env.render()
            got = measurements["got"] = env.call_where_drawn(renderer_in_use)
            measurements["devices"], ordinals = got.pop("devices", []), got.pop("ordinals", [])
            memory.note("after")
        if memory.gpus:
            measurements["workers"] = _workers(probe, memory)
    finally:
        measurements["memory"] = memory.by_gpu()
    _compare_devices(probe, wanted, got, ordinals)


def device_settings(case):
    """Return the settings that choose a device, by name; one that is empty is included, too."""
    settings = {name: os.environ[name] for name in VARIABLES if name in os.environ}
    if ARGUMENT in case["kwargs"]:
        settings[ARGUMENT] = case["kwargs"][ARGUMENT]
    return settings


def renderer_in_use():
    """Describe the renderer in use (see `cell_opengl_context`); for EGL add `index` and `cuda` number of its device.

    `devices` are all, in EGL's order, and `ordinals` the numbers that CUDA gives them.
    """
    return dict(current_context(), **first_answer(("libEGL.so", _egl_devices)))


def _egl_devices(library):
    drawing = drawing_device(library)
    if not drawing:
        return None
    find = library.eglGetProcAddress
    query = c_function(find, "eglQueryDevicesEXT", ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    listed, count = (ctypes.c_void_p * MOST)(), ctypes.c_int()
    if not query or not query(MOST, listed, ctypes.byref(count)):
        return None
    devices = list(listed[: count.value])
    ordinals = [cuda_number(find, device) for device in devices]
    facts = {"devices": [describe_device(find, device) for device in devices], "cuda": cuda_number(find, drawing)}
    facts["ordinals"] = [number for number in ordinals if number is not None]
    if drawing in devices:
        facts["index"] = devices.index(drawing)
    return {name: value for name, value in facts.items() if value is not None}


def _compare_devices(probe, wanted, got, ordinals):
    """Raise where a setting names another device than the one that drew."""
    numbers = {name: device_numbers(name, value) for name, value in wanted.items()}
    requested = {name: devices for name, devices in numbers.items() if devices}
    if not got:
        if requested:
            skip("device.unknown")
        return
    index, cuda = got.get("index"), got.get("cuda")
    if got["api"] == "egl" and index is None:
        skip("device.untold")
    matching = [name for name in requested if _can_mean(name, requested, (index, cuda), ordinals)]
    if cuda is None and CUDA in requested and CUDA not in matching:
        del requested[CUDA]  # it does not concern devices that are not CUDA's
    for name in (ARGUMENT, EGL_ID, CUDA):
        if name in requested and name not in matching:
            promised = " or ".join(str(number) for number in requested[name])
            drew = _drawing_place(got, [(each, wanted[each]) for each in matching])
            violate("device.other", promised=promised, setting=format_setting(name, wanted[name]), got=drew)
    if set(matching) - {CUDA} and cuda is not None and cuda != index:
        names = " or ".join(name for name in matching if name != CUDA)
        probe.finding("render.device", "device.either", index=index, cuda=cuda, names=names)


def _can_mean(name, requested, place, ordinals):
    """Return whether a setting can mean the device at this place, (EGL's, CUDA's).

    CUDA_VISIBLE_DEVICES counts as CUDA does.

    Another number may be a place among the devices that CUDA sees, as it is for CUDA itself and for MuJoCo 4. A driver
    may number those devices alone: no number is then as large as their count.
    """
    index, cuda = place
    visible = requested.get(CUDA, [])
    if name == CUDA and cuda is not None:
        physical = any(number >= len(visible) for number in ordinals)
        return cuda in (visible if physical else ordinals)
    counted = requested[name] + [
        visible[number] for number in requested[name] if number < len(visible) and name != CUDA
    ]
    return any(number in counted for number in (index, cuda) if number is not None)


def device_numbers(name, value):
    """Return the numbers of devices that a setting names; none if it leaves the choice open or names them otherwise."""
    parts = str(value).split(",") if name == CUDA else [str(value)]
    return [int(part) for part in parts if part.strip().isdigit()]


def format_setting(name, value):
    """Return a setting as it is typed."""
    return "{}={}".format(name, value)


def _drawing_place(got, matching):
    """Return the place where the picture was drawn, and the settings that name that place."""
    if got["api"] != "egl":
        return {"api": got["api"]}
    place = {"index": got["index"], "by": " and ".join(format_setting(*setting) for setting in matching) or "nothing"}
    return place if got.get("cuda") is None else dict(place, cuda=got["cuda"])


# --- memory ----------------------------------------------------------------------------------------------------


class Memory:
    """The memory in use on each NVIDIA GPU, by all processes of the machine.

    The numbers come from NVML, which the driver brings.
    """

    def __init__(self):
        self.gpus = []
        self.missing = ""
        try:
            self.library = ctypes.CDLL("libnvidia-ml.so.1")
        except OSError:
            self.missing = "no libnvidia-ml.so.1: no NVIDIA driver here"
            return
        try:
            self._find()
        except (OSError, AttributeError) as error:
            self.missing = summary(error)

    def _find(self):
        self._call("nvmlInit_v2")
        count = ctypes.c_uint()
        self._call("nvmlDeviceGetCount_v2", ctypes.byref(count))
        for number in range(min(count.value, MOST)):
            handle, name = ctypes.c_void_p(), ctypes.create_string_buffer(96)
            self._call("nvmlDeviceGetHandleByIndex_v2", ctypes.c_uint(number), ctypes.byref(handle))
            self._call("nvmlDeviceGetName", handle, name, ctypes.c_uint(len(name)))
            self.gpus.append((handle, {"name": name.value.decode("utf-8", "replace")}))

    def _call(self, name, *arguments):
        code = getattr(self.library, name)(*arguments)
        if code:
            message = "{} returned {}".format(name, code)
            raise OSError(message)

    def note(self, when):
        """Keep how many MiB are in use now."""
        used = (ctypes.c_ulonglong * 3)()  # total, free, used
        for handle, gpu in self.gpus:
            try:
                self._call("nvmlDeviceGetMemoryInfo", handle, ctypes.byref(used))
                gpu[when] = used[2] >> 20
            except OSError as error:
                gpu[when] = str(error)

    def by_gpu(self):
        """Return the MiB by GPU, in NVML's order (that of the PCI bus), or the reason why there are none."""
        return [gpu for _, gpu in self.gpus] or "unavailable: " + (self.missing or "NVML names no GPU")


# --- workers ---------------------------------------------------------------------------------------------------


class DrawingMaker(Maker):
    """Make an environment that draws; a worker writes into a file which renderer drew after its reset."""

    def make(self):
        """Make the library's own object, as it draws."""
        env = make_drawing_environment(self.api, self.case)
        if getpid() != self.parent:
            self._watch(env)
        return env

    def _watch(self, env):
        reset, path = env.reset, os.path.join(self.folder, "drew-{}.json".format(getpid()))

        def reset_and_draw(*args, **kwargs):
            result = reset(*args, **kwargs)
            if self.case["api"] != "robosuite":  # which draws what it observes
                env.render()
            with open(path, "w", encoding="utf-8") as file:
                json.dump(renderer_in_use(), file)
            return result

        env.reset = reset_and_draw


def make_drawing_environment(api, case):
    """Make the library's own object, as it draws."""
    if case["api"] == "robosuite":
        name = local_name(case)
        wrapped = name if name.startswith("GymWrapper(") else "GymWrapper({})".format(name)
        return api.make_raw(dict(case, env="robosuite:" + wrapped, kwargs=dict(CAMERA, **case["kwargs"])))
    return api.make_raw(case, render_mode="rgb_array")


def _workers(probe, memory):
    """Draw in the workers of a vector environment, too; return their devices, or why there are none."""
    makers = [DrawingMaker(probe, "render.device")] * probe.num_envs
    env = None
    try:
        with open_batch(probe, makers, {"context": "spawn"}) as env:
            env.reset(probe.case["seed"])
            memory.note("with {} workers".format(len(makers)))
            names = sorted(name for name in os.listdir(probe.folder) if name.startswith("drew-"))
            return [_read_device(os.path.join(probe.folder, name)) for name in names]
    except Skip as skipped:
        return {"skipped": skipped.observed}
    except Exception as error:
        return {"failed": observed_error(error)}
    finally:
        end_workers(env, None, PATIENCE)


def _read_device(path):
    with open(path, encoding="utf-8") as file:
        renderer = json.load(file)
    return {name: renderer[name] for name in ("api", "index", "cuda") if name in renderer}
