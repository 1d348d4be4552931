"""Ask a way of rendering to describe itself, by really making a context: `python -I -S gl_probe.py WAY ANSWER`.

WAY is `egl`, `osmesa`, `display`, `glu`, `vulkan`, or `device` with a place in EGL's list: `device:1`. The answer is a
JSON object in the file ANSWER: what the driver says of itself, or `missing`: why there is none. Standard library only;
run in a process of its own, since drivers crash, hang and print.
"""

from __future__ import annotations

import ctypes
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from ctypes import POINTER, byref, c_char_p, c_int, c_uint, c_void_p
from typing import Any

EGL_NONE, EGL_PLATFORM_DEVICE, EGL_OPENGL_API = 0x3038, 0x313F, 0x30A2
EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT = 0x3033, 1, 0x3040, 8
EGL_RED, EGL_GREEN, EGL_BLUE, EGL_ALPHA, EGL_DEPTH, EGL_STENCIL = 0x3024, 0x3023, 0x3022, 0x3021, 0x3025, 0x3026
EGL_EXTENSIONS, EGL_DRM_FILE, EGL_CUDA_DEVICE = 0x3055, 0x3233, 0x323A
OSMESA_RGBA, GL_UNSIGNED_BYTE = 0x1908, 0x1401
GLX_DRAWABLE_TYPE, GLX_PBUFFER_BIT, GLX_RENDER_TYPE, GLX_RGBA_BIT, GLX_RGBA_TYPE = 0x8010, 4, 0x8011, 1, 0x8014
GLX_PBUFFER_WIDTH, GLX_PBUFFER_HEIGHT = 0x8041, 0x8040
MOST_DEVICES = 32
VK_APPLICATION_INFO, VK_INSTANCE_CREATE_INFO, VK_API_1_1 = 0, 1, 1 << 22 | 1 << 12
VK_PROPERTIES_2, VK_DRIVER_PROPERTIES = 1000059001, 1000196000
STRINGS = {"vendor": 0x1F00, "renderer": 0x1F01, "version": 0x1F02}


class MissingError(Exception):
    """This way of rendering is not to be had here."""


def load(*files: str) -> ctypes.CDLL:
    """Return the first of these shared libraries that the linker finds. Raises MissingError."""
    for file in files:
        try:
            return ctypes.CDLL(file, mode=ctypes.RTLD_GLOBAL)
        except OSError:
            continue
    message = f"no {files[0]}"
    raise MissingError(message)


def function(address: int | None, result: Any, *arguments: Any) -> Callable[..., Any]:
    """Return the C function at an address. Raises MissingError."""
    if not address:
        message = "an entry point is missing"
        raise MissingError(message)
    return ctypes.CFUNCTYPE(result, *arguments)(address)


def strings(get: Callable[[int], bytes | None]) -> dict[str, str]:
    """Return the answers of glGetString in the current context: vendor, renderer, version."""
    answers = {name: (get(number) or b"").decode("utf-8", "replace") for name, number in STRINGS.items()}
    if not answers["version"]:
        message = "a context without a version"
        raise MissingError(message)
    return answers


class Egl:
    """The EGL library with the types of the calls that we make."""

    def __init__(self) -> None:
        self.library = load("libEGL.so.1")
        # ctypes takes a result without a declared type for an int, and cuts a pointer to 32 bits.
        self.library.eglGetProcAddress.restype = c_void_p
        self.library.eglCreateContext.restype = c_void_p
        self.library.eglCreateContext.argtypes = [c_void_p, c_void_p, c_void_p, c_void_p]
        self.library.eglMakeCurrent.argtypes = [c_void_p] * 4
        self.library.eglInitialize.argtypes = [c_void_p] * 3
        self.library.eglChooseConfig.argtypes = [c_void_p, c_void_p, c_void_p, c_int, c_void_p]

    def entry(self, name: str, result: Any, *arguments: Any) -> Callable[..., Any]:
        """Return a function of an extension, or of GL."""
        return function(self.library.eglGetProcAddress(name.encode()), result, *arguments)

    def devices(self) -> list[int]:
        """Return the devices in the driver's order."""
        query = self.entry("eglQueryDevicesEXT", c_uint, c_int, c_void_p, POINTER(c_int))
        devices, count = (c_void_p * MOST_DEVICES)(), c_int()
        query(MOST_DEVICES, devices, byref(count))
        return [device or 0 for device in devices[: count.value]]

    def display(self, device: int) -> int | None:
        """Return the display of a device; None if it cannot be initialised."""
        platform_display = self.entry("eglGetPlatformDisplayEXT", c_void_p, c_uint, c_void_p, c_void_p)
        display: int | None = platform_display(EGL_PLATFORM_DEVICE, device, None)
        return display if display and self.library.eglInitialize(display, None, None) else None

    def displays(self) -> Iterator[int]:
        """Yield an initialised display for each device, as MuJoCo tries them."""
        yield from filter(None, map(self.display, self.devices()))

    def kind(self, device: int) -> dict[str, str]:
        """Return its file, its CUDA number, or that it is not hardware, as far as the driver tells."""
        text = self.entry("eglQueryDeviceStringEXT", c_char_p, c_void_p, c_int)
        extensions = (text(device, EGL_EXTENSIONS) or b"").split()
        facts = {}
        if b"EGL_EXT_device_drm" in extensions:
            facts["file"] = (text(device, EGL_DRM_FILE) or b"").decode("utf-8", "replace")
        if b"EGL_NV_device_cuda" in extensions:
            number = c_void_p()
            ask = self.entry("eglQueryDeviceAttribEXT", c_uint, c_void_p, c_int, c_void_p)
            if ask(device, EGL_CUDA_DEVICE, byref(number)):
                facts["cuda"] = str(number.value or 0)
        if b"EGL_MESA_device_software" in extensions:
            facts["software"] = "yes"
        return {name: value for name, value in facts.items() if value}

    def describe(self, display: int) -> dict[str, str]:
        """Make a context without a surface current, and return its strings."""
        wanted = (EGL_RED, 8, EGL_GREEN, 8, EGL_BLUE, 8, EGL_ALPHA, 8, EGL_DEPTH, 24, EGL_STENCIL, 8)
        kind = (EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_NONE)
        config, count = c_void_p(), c_int()
        attributes = array((*wanted, *kind))
        self.library.eglChooseConfig(display, attributes, byref(config), 1, byref(count))
        self.library.eglBindAPI(EGL_OPENGL_API)
        context = self.library.eglCreateContext(display, config, None, None) if count.value else None
        if not context or not self.library.eglMakeCurrent(display, None, None, context):
            message = "no device makes an OpenGL context"
            raise MissingError(message)
        return strings(self.entry("glGetString", c_char_p, c_uint))


def array(values: Sequence[int]) -> Any:
    """Return a C array of int."""
    return (c_int * len(values))(*values)


def egl() -> dict[str, str]:
    """Describe the first EGL device that makes an OpenGL context."""
    library = Egl()
    reason = MissingError("no device that can be initialised")
    for display in library.displays():
        try:
            return library.describe(display)
        except MissingError as error:
            reason = error
    raise reason


def device(place: str) -> dict[str, str]:
    """Describe the EGL device at a place of the list; `count` is their number, `missing` why it makes no context."""
    library = Egl()
    devices = library.devices()
    answer = {"count": str(len(devices))}
    try:
        handle = devices[int(place)]
    except IndexError:
        return {**answer, "missing": "there is no such device"}
    answer |= library.kind(handle)
    display = library.display(handle)
    try:
        return {**answer, **(library.describe(display) if display else {"missing": "it cannot be initialised"})}
    except MissingError as error:
        return {**answer, "missing": str(error)}


def osmesa() -> dict[str, str]:
    """Describe OSMesa, Mesa's rendering into memory."""
    library = load("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
    library.OSMesaCreateContextExt.restype = c_void_p
    library.OSMesaCreateContextExt.argtypes = [c_uint, c_int, c_int, c_int, c_void_p]
    library.OSMesaMakeCurrent.argtypes = [c_void_p, c_void_p, c_uint, c_int, c_int]
    library.OSMesaGetProcAddress.restype = c_void_p
    context = library.OSMesaCreateContextExt(OSMESA_RGBA, 24, 8, 0, None)
    pixels = ctypes.create_string_buffer(64 * 64 * 4)
    if not context or not library.OSMesaMakeCurrent(context, pixels, GL_UNSIGNED_BYTE, 64, 64):
        message = "OSMesa makes no context"
        raise MissingError(message)
    return strings(function(library.OSMesaGetProcAddress(b"glGetString"), c_char_p, c_uint))


def display() -> dict[str, str]:
    """Describe OpenGL at the X server that DISPLAY names."""
    if not os.environ.get("DISPLAY"):
        message = "DISPLAY is not set"
        raise MissingError(message)
    library = load("libX11.so.6")
    library.XOpenDisplay.restype = c_void_p
    library.XDefaultScreen.argtypes = [c_void_p]
    server = library.XOpenDisplay(None)
    if not server:
        message = f"nothing answers at DISPLAY={os.environ['DISPLAY']}"
        raise MissingError(message)
    return glx(server, library.XDefaultScreen(server))


def glx(server: int, screen: int) -> dict[str, str]:
    """Make a context that draws into memory current, and return its strings."""
    library = load("libGL.so.1", "libGLX.so.0")
    library.glXChooseFBConfig.restype = POINTER(c_void_p)
    library.glXChooseFBConfig.argtypes = [c_void_p, c_int, c_void_p, c_void_p]
    library.glXCreateNewContext.restype = c_void_p
    library.glXCreateNewContext.argtypes = [c_void_p, c_void_p, c_int, c_void_p, c_int]
    library.glXCreatePbuffer.restype = c_void_p
    library.glXCreatePbuffer.argtypes = [c_void_p, c_void_p, c_void_p]
    library.glXMakeContextCurrent.argtypes = [c_void_p] * 4
    library.glXGetProcAddress.restype = c_void_p
    count = c_int()
    wanted = array((GLX_DRAWABLE_TYPE, GLX_PBUFFER_BIT, GLX_RENDER_TYPE, GLX_RGBA_BIT, 0))
    configs = library.glXChooseFBConfig(server, screen, wanted, byref(count))
    context = library.glXCreateNewContext(server, configs[0], GLX_RGBA_TYPE, None, 1) if count.value else None
    size = array((GLX_PBUFFER_WIDTH, 64, GLX_PBUFFER_HEIGHT, 64, 0))
    surface = library.glXCreatePbuffer(server, configs[0], size) if context else None
    if not surface or not library.glXMakeContextCurrent(server, surface, surface, context):
        message = "its server makes no OpenGL context"
        raise MissingError(message)
    return strings(function(library.glXGetProcAddress(b"glGetString"), c_char_p, c_uint))


def glu() -> dict[str, str]:
    """Load the library of utilities that pyglet 1 loads beside OpenGL; return nothing about it."""
    load("libGLU.so.1", "libGLU.so")
    return {}


class Application(ctypes.Structure):
    """VkApplicationInfo: which version of Vulkan is spoken."""

    _fields_ = (
        ("kind", c_uint),
        ("next", c_void_p),
        ("name", c_char_p),
        ("version", c_uint),
        ("engine", c_char_p),
        ("engine_version", c_uint),
        ("api", c_uint),
    )


class Instance(ctypes.Structure):
    """VkInstanceCreateInfo, without layers or extensions."""

    _fields_ = (
        ("kind", c_uint),
        ("next", c_void_p),
        ("flags", c_uint),
        ("application", POINTER(Application)),
        ("layers", c_uint),
        ("layer_names", c_void_p),
        ("extensions", c_uint),
        ("extension_names", c_void_p),
    )


class Driver(ctypes.Structure):
    """VkPhysicalDeviceDriverProperties: the driver's own words."""

    _fields_ = (
        ("kind", c_uint),
        ("next", c_void_p),
        ("id", c_uint),
        ("name", ctypes.c_char * 256),
        ("info", ctypes.c_char * 256),
        ("conformance", ctypes.c_ubyte * 4),
    )


class Properties(ctypes.Structure):
    """VkPhysicalDeviceProperties2; the limits at its end are not read."""

    _fields_ = (
        ("kind", c_uint),
        ("next", c_void_p),
        ("numbers", c_uint * 5),
        ("device", ctypes.c_char * 256),
        ("rest", ctypes.c_ubyte * 1024),
    )


def vulkan() -> dict[str, str]:
    """Describe the first device of Vulkan's, be it a GPU or software."""
    library = load("libvulkan.so.1")
    application = Application(kind=VK_APPLICATION_INFO, api=VK_API_1_1)
    instance, count = c_void_p(), c_uint()
    wanted = Instance(kind=VK_INSTANCE_CREATE_INFO, application=ctypes.pointer(application))
    if library.vkCreateInstance(byref(wanted), None, byref(instance)):
        message = "no driver makes a Vulkan instance"
        raise MissingError(message)
    library.vkEnumeratePhysicalDevices(instance, byref(count), None)
    devices = (c_void_p * max(count.value, 1))()
    library.vkEnumeratePhysicalDevices(instance, byref(count), devices)
    if not count.value:
        message = "no driver has a Vulkan device"
        raise MissingError(message)
    driver = Driver(kind=VK_DRIVER_PROPERTIES)
    properties = Properties(kind=VK_PROPERTIES_2, next=ctypes.addressof(driver))
    library.vkGetPhysicalDeviceProperties2(c_void_p(devices[0]), byref(properties))
    texts = {"vendor": driver.name, "renderer": properties.device, "version": driver.info}
    return {name: text.decode("utf-8", "replace") for name, text in texts.items()}


WAYS = {"egl": egl, "osmesa": osmesa, "display": display, "glu": glu, "vulkan": vulkan}


def main(way: str, answer: str) -> None:
    """Ask, and write the answer."""
    way, _, place = way.partition(":")
    try:
        result = device(place) if place else WAYS[way]()
    except (MissingError, AttributeError) as error:  # AttributeError: a library without the function
        result = {"missing": str(error)}
    with open(answer, "w") as file:  # noqa: PTH123 - nothing else here needs pathlib
        json.dump(result, file)


if __name__ == "__main__":
    main(*sys.argv[1:])
    os._exit(0)  # a driver that crashes at unloading says nothing about rendering
