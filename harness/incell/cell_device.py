"""The device that draws: which one was asked for and which one it is, and whose memory it takes.

A device is known by its place in what eglQueryDevicesEXT lists. That order is the driver's: CUDA counts otherwise.
"""

import ctypes
import json
import os

from .cell_context import asked, current, described, drawing_device, entry, ordinal
from .cell_episode import opened, single, teller
from .cell_errors import Skip, raised, skip, summary, violate
from .cell_kept import getpid
from .cell_workers import Maker, endings, finish, processes

ARGUMENT = "render_gpu_device_id"
VARIABLES = EGL_ID, CUDA = "MUJOCO_EGL_DEVICE_ID", "CUDA_VISIBLE_DEVICES"
MOST = 32
CAMERA = {"has_offscreen_renderer": True, "use_camera_obs": True, "camera_names": "agentview"}
"""What makes robosuite draw whenever it observes."""

PATIENCE = 5.0


def device(probe, facts):
    """Draw one picture; the device that did it has to be the one that each setting asked for."""
    wanted = settings(probe.case)
    told = facts["told"] = {"asked": wanted}
    memory = Memory()
    memory.note("before")
    try:
        with single(probe, draw=True) as env:
            env.seed_actions(probe.case["seed"])
            env.reset(probe.case["seed"])
            env.render()
            got = told["got"] = env.where_drawn(seen)
            told["devices"], ordinals = got.pop("devices", []), got.pop("ordinals", [])
            memory.note("after")
        if memory.gpus:
            told["workers"] = _workers(probe, memory)
    finally:
        told["memory"] = memory.told()
    _compare(probe, wanted, got, ordinals)


def settings(case):
    """Return the settings that choose a device, by name; one that is empty is included, too."""
    found = {name: os.environ[name] for name in VARIABLES if name in os.environ}
    if ARGUMENT in case["kwargs"]:
        found[ARGUMENT] = case["kwargs"][ARGUMENT]
    return found


def seen():
    """Describe the renderer in use (see `cell_context`); of EGL also the `index` and the `cuda` number of its device.

    `devices` are all, in EGL's order, and `ordinals` the numbers that CUDA gives them.
    """
    return dict(current(), **asked(("libEGL.so", _place)))


def _place(library):
    drawing = drawing_device(library)
    if not drawing:
        return None
    find = library.eglGetProcAddress
    query = entry(find, "eglQueryDevicesEXT", ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    listed, count = (ctypes.c_void_p * MOST)(), ctypes.c_int()
    if not query or not query(MOST, listed, ctypes.byref(count)):
        return None
    devices = list(listed[: count.value])
    ordinals = [ordinal(find, one) for one in devices]
    found = {"devices": [described(find, one) for one in devices], "cuda": ordinal(find, drawing)}
    found["ordinals"] = [number for number in ordinals if number is not None]
    if drawing in devices:
        found["index"] = devices.index(drawing)
    return {name: value for name, value in found.items() if value is not None}


def _compare(probe, wanted, got, ordinals):
    """Fail where a setting names another device than the one that drew."""
    asking = {name: numbers for name, numbers in ((name, named(name, wanted[name])) for name in wanted) if numbers}
    if not got:
        if asking:
            skip("device.unknown")
        return
    index, cuda = got.get("index"), got.get("cuda")
    if got["api"] == "egl" and index is None:
        skip("device.untold")
    right = [name for name in asking if _means(name, asking, (index, cuda), ordinals)]
    if cuda is None and CUDA in asking and CUDA not in right:
        del asking[CUDA]  # it says nothing of devices that are not CUDA's
    for name in (ARGUMENT, EGL_ID, CUDA):
        if name in asking and name not in right:
            numbers = " or ".join(str(number) for number in asking[name])
            drew = _where(got, [(one, wanted[one]) for one in right])
            violate("device.other", promised=numbers, setting=written(name, wanted[name]), got=drew)
    if set(right) - {CUDA} and cuda is not None and cuda != index:
        names = " or ".join(name for name in right if name != CUDA)
        probe.finding("render.device", "device.either", index=index, cuda=cuda, names=names)


def _means(name, asking, place, ordinals):
    """Return whether a setting can mean the device at this place, (EGL's, CUDA's).

    CUDA_VISIBLE_DEVICES counts as CUDA does.

    Another number may be a place among the devices that CUDA sees, as it is for CUDA itself and for MuJoCo 4. A driver
    may number those devices alone: it has no number then that is larger than they are many.
    """
    index, cuda = place
    visible = asking.get(CUDA, [])
    if name == CUDA and cuda is not None:
        physical = any(number >= len(visible) for number in ordinals)
        return cuda in (visible if physical else ordinals)
    counted = asking[name] + [visible[number] for number in asking[name] if number < len(visible) and name != CUDA]
    return any(number in counted for number in (index, cuda) if number is not None)


def named(name, value):
    """Return the numbers of devices that a setting names; none if it leaves the choice open or names them otherwise."""
    parts = str(value).split(",") if name == CUDA else [str(value)]
    return [int(part) for part in parts if part.strip().isdigit()]


def written(name, value):
    """Return a setting as it is typed."""
    return "{}={}".format(name, value)


def _where(got, right):
    """Return the place where the picture was drawn, and the settings that name that place."""
    if got["api"] != "egl":
        return {"api": got["api"]}
    place = {"index": got["index"], "by": " and ".join(written(*one) for one in right) or "nothing"}
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

    def told(self):
        """Return the MiB by GPU, in NVML's order (that of the PCI bus), or the reason why there are none."""
        return [gpu for _, gpu in self.gpus] or "unavailable: " + (self.missing or "NVML names no GPU")


# --- workers ---------------------------------------------------------------------------------------------------


class Drawing(Maker):
    """Makes an environment that draws; a worker leaves in a file what drew after its reset."""

    def made(self):
        """Make the library's own object, as it draws."""
        env = drawing(self.api, self.case)
        if getpid() != self.parent:
            self._watch(env)
        return env

    def _watch(self, env):
        reset, path = env.reset, os.path.join(self.folder, "drew-{}.json".format(getpid()))

        def drawn(*args, **kwargs):
            result = reset(*args, **kwargs)
            if self.case["api"] != "robosuite":  # which draws what it observes
                env.render()
            with open(path, "w", encoding="utf-8") as file:
                json.dump(seen(), file)
            return result

        env.reset = drawn


def drawing(api, case):
    """Make the library's own object, as it draws."""
    if case["api"] == "robosuite":
        name = case["env"].partition(":")[2] or case["env"]
        wrapped = name if name.startswith("GymWrapper(") else "GymWrapper({})".format(name)
        return api.bare(dict(case, env="robosuite:" + wrapped, kwargs=dict(CAMERA, **case["kwargs"])))
    return api.bare(case, render_mode="rgb_array")


def _workers(probe, memory):
    """Draw in the workers of a vector environment, too: the devices that they drew on, or why there are none."""
    makers = [Drawing(probe, "render.device")] * probe.num_envs
    env = None
    try:
        way = {"context": "spawn"}
        with opened(probe, "vector", lambda: probe.api.make_vector(makers, way, teller(probe, "vector"))) as env:
            env.reset(probe.case["seed"])
            memory.note("with {} workers".format(len(makers)))
            names = sorted(name for name in os.listdir(probe.folder) if name.startswith("drew-"))
            return [_read(os.path.join(probe.folder, name)) for name in names]
    except Skip as skipped:
        return {"skipped": skipped.observed}
    except Exception as error:
        return {"failed": raised(error)}
    finally:
        workers = processes(env, None)
        endings(workers, PATIENCE)
        finish(workers)


def _read(path):
    with open(path, encoding="utf-8") as file:
        found = json.load(file)
    return {name: found[name] for name in ("api", "index", "cuda") if name in found}
