"""Open a display as a library does, in the library's own environment, and print its device: `LIBRARY ARGUMENT`."""

import ctypes
import json
import os
import sys

library, argument = sys.argv[1], int(sys.argv[2])
stage, place, error = "import", None, None
try:
    import mujoco  # noqa: F401 - the import itself may fail

    if library == "robosuite":
        import robosuite  # noqa: F401
        from robosuite.renderers.context import egl_context as opened

        stage = "make"
        context = opened.EGLGLContext(1, 1, device_id=argument)
    else:
        from mujoco import egl as opened

        stage = "make"
        context = opened.GLContext(1, 1)
    egl = ctypes.CDLL("libEGL.so.1")
    find = egl.eglGetProcAddress
    find.restype = ctypes.c_void_p
    answer = ctypes.c_uint
    of_display = ctypes.CFUNCTYPE(answer, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p)
    query = ctypes.CFUNCTYPE(answer, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    device, listed, count = ctypes.c_void_p(), (ctypes.c_void_p * 32)(), ctypes.c_int()
    display = ctypes.cast(opened.EGL_DISPLAY, ctypes.c_void_p).value
    of_display(find(b"eglQueryDisplayAttribEXT"))(display, 0x322C, ctypes.byref(device))
    query(find(b"eglQueryDevicesEXT"))(32, listed, ctypes.byref(count))
    place = list(listed).index(device.value)
except Exception as raised:
    error = f"{type(raised).__name__}: {raised}"
print("WITNESS", json.dumps([place, error, stage]), flush=True)
os._exit(0)  # the context is left open
