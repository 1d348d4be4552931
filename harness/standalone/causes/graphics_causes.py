"""Explain that nothing can be drawn: no Vulkan driver, no display, no EGL, no OSMesa."""

from __future__ import annotations

import re

from .scene import Cause, Causes, Pattern, Scene

VULKAN = Pattern(
    r"vk::\w+(?:::\w+)*: Error\w+|ERROR_(?:INCOMPATIBLE_DRIVER|INITIALIZATION_FAILED|EXTENSION_NOT_PRESENT)"
    r"|VK_ERROR_\w+|[Ff]ailed to find a (?:rendering device|supported physical device)|loader_\w+: .*(?:ICD|vk\w+)"
    r"|vkCreateInstance|vkEnumeratePhysicalDevices|Vulkan ICD|icd.*(?:not found|missing)"
    r"|Vulkan is not (?:supported|available)"
    r"|[Ff]ailed to (?:create|initialize) (?:a )?[Vv]ulkan|No (?:Vulkan|rendering|compatible) (?:physical )?device"
    r"|[Cc]ould ?n.t find (?:a )?[Vv]ulkan|carb\.graphics-vulkan|required Vulkan extension is not present",
    "vk", "VK_", "ERROR_", "rendering device", "physical device", "ulkan", "loader_", "icd",
)  # fmt: skip
SURFACE = Pattern(r"vk::\w+::(?:get|create)\w*Surface\w*: Error", "urface")
MEMORY = re.compile(r"OutOf(?:Device|Host)Memory|OUT_OF_(?:DEVICE|HOST)_MEMORY|DeviceLost|DEVICE_LOST")
DISPLAY = Pattern(
    r"X11: The DISPLAY environment variable is missing|X11: Failed to open display|NoSuchDisplayException"
    r"|[Cc]annot connect to (?:X server|\W?None\W?)|[Cc]annot open display|could not connect to display|Authorization"
    r" required, but no authorization protocol|no display name and no \$DISPLAY|Wayland: Failed to connect to display"
    r"|Failed to (?:initialize|init) GLFW|could not initialize GLFW"
    r"|No available video device|Unable to open X display|X connection to \S+ broken",
    "isplay", "DISPLAY", "X server", "None", "Authorization", "GLFW", "xcb", "video device", "X connection",
)  # fmt: skip
EGL = Pattern(
    r"Cannot initialize a EGL device display|Failed to initialize EGL|eglInitialize|eglGetDisplay|EGL_NOT_INITIALIZED"
    r"|EGL_BAD_\w+|(?:Failed|unable|Could not|failed) to (?:get|create|make|open|initialize)\b.*\bEGL|EGLError"
    r"|has no attribute 'eglQueryString'|EGL: Failed|platform device extension|\berr = 12(?:289|29\d|30[0-2])\b",
    "EGL", "egl", "err = 12",
)  # fmt: skip
OSMESA = Pattern(
    r"OSMesaCreateContext\w*|libOSMesa|OSMesa: (?:Failed|could)|undefined symbol: glGetError"
    r"|has no attribute 'glGetError'",
    "OSMesa", "glGetError",
)  # fmt: skip
CONTEXT = Pattern(
    r"[Ff]ailed to initialize Pyglet window|[Ff]ailed to create (?:an? )?(?:OpenGL|GL|GLX|window|GLFW window)"
    r"|gladLoadGL error"
    r"|no OpenGL (?:context|\w+ context)|OpenGL .*version .*(?:not supported|or higher)"
    r"|GLX: (?:Failed|No GLX)|NoSuchConfigException|ContextException|could not create (?:GL|window)",
    "ontext", "glad", "OpenGL", "GLX", "NoSuchConfig", "window",
)  # fmt: skip
GLEW = Pattern(r"undefined symbol: __glew\w+", "__glew")
SOFTWARE = Pattern(
    r"(?i:libgl error: *(?:failed|unable) to load driver ?: ?\w+)|MESA-LOADER: failed to open \w+:? (?!.*No such file)"
    r"|using old-style GLX context",
    "ibGL error", "ibgl error", "MESA-LOADER", "old-style GLX",
)  # fmt: skip
SYSTEM_DRIVER = Pattern(
    r"MESA-LOADER: failed to open \w+: .*No such file or directory \(search paths [^)]*/usr/lib/x86_64-linux-gnu/dri",
    "MESA-LOADER",
)
"""The line names the last place that was tried. The system's own driver, tried before, did not load either."""

SERVER = (
    "On a machine without a screen set `MUJOCO_GL=egl` (or `osmesa`) before Python starts, or run it by `xvfb-run -a`."
)


CAUSES = (
    (
        GLEW,
        Cause(
            "libglew",
            "MuJoCo before 2.2 renders with functions from GLEW, and libGLEW was not loaded before it",
            {
                "environment": {"LD_PRELOAD": "/usr/lib/x86_64-linux-gnu/libGLEW.so"},
                "text": "Install it: `apt-get install libglew-dev`. Off screen use EGL or OSMesa, without LD_PRELOAD.",
            },
        ),
    ),
    (
        SOFTWARE,
        Cause(
            "libstdcxx-ng",
            "Mesa's driver did not load: an older libstdc++ than the system's was loaded first, as in an environment of"
            " conda, or the driver is not installed; `LIBGL_DEBUG=verbose` shows which",
            {"text": "`conda install -c conda-forge libstdcxx-ng`, or `apt-get install libgl1-mesa-dri`."},
        ),
    ),
    (
        SURFACE,
        Cause(
            "display",
            "the renderer wants a Vulkan surface for a window, and there is no display for it",
            {"text": "Render off screen: no viewer, and in old SAPIEN `VulkanRenderer(offscreen_only=True)`."},
        ),
    ),
    (
        VULKAN,
        Cause(
            "vulkan-driver",
            "Vulkan finds no usable driver for a GPU: the NVIDIA driver's Vulkan part (nvidia_icd.json) is missing, or"
            " a library that it loads",
            {
                "text": "Check `vulkaninfo --summary`. Install `apt-get install libvulkan1 libxext6 libegl1` and the"
                " whole nvidia-driver; in a container set NVIDIA_DRIVER_CAPABILITIES=all, and let VK_ICD_FILENAMES name"
                " nvidia_icd.json."
            },
        ),
    ),
    (
        OSMESA,
        Cause(
            "osmesa",
            "OSMesa, which draws without a GPU, is missing or too old for PyOpenGL",
            {
                "environment": {"PYOPENGL_PLATFORM": "osmesa", "MUJOCO_GL": "osmesa"},
                "text": "Install it: `apt-get install libosmesa6` or `conda install -c conda-forge mesalib`.",
            },
        ),
    ),
    (
        EGL,
        Cause(
            "egl",
            "EGL, which draws without a screen, finds no device that this user may open",
            {
                "environment": {"MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "egl"},
                "text": "Install `apt-get install libegl1 libgl1`; the user needs /dev/dri (groups render and video)."
                " Without a GPU use MUJOCO_GL=osmesa.",
            },
        ),
    ),
    (
        DISPLAY,
        Cause(
            "display",
            "the program opens a window, and no display can be reached",
            {"environment": {"MUJOCO_GL": "egl"}, "text": SERVER},
        ),
    ),
    (
        CONTEXT,
        Cause(
            "opengl",
            "no OpenGL context could be made: no display, or a driver without the requested features",
            {"environment": {"MUJOCO_GL": "egl"}, "text": SERVER},
        ),
    ),
)
"""The pattern of a line and its cause; the first pattern that fits decides."""


def of_mesa(line: str, scene: Scene) -> Causes:
    """Yield the cause where the system's driver is among those that Mesa tried in vain."""
    if SYSTEM_DRIVER.search(line):
        text = (
            "Mesa tried the system's driver, too, and names only the last place: mostly an older libstdc++, as in an"
            " environment of conda, was loaded first; else the driver is not installed"
        )
        way = "`conda install -c conda-forge libstdcxx-ng`, or `apt-get install libgl1-mesa-dri`."
        yield Cause("libstdcxx-ng", text, {"text": way})


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where a line says that a renderer, its driver or a display is missing."""
    for pattern, cause in CAUSES:
        if pattern.search(line) and not (pattern is VULKAN and MEMORY.search(line)):
            yield cause
            return
