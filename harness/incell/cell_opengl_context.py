"""Describe the OpenGL context that is current in this thread, using only libraries that are loaded already.

Nothing is loaded here that was not: a library under test may depend on it and have forgotten to say so.
"""

import ctypes
import os

STRINGS = (("vendor", 0x1F00), ("renderer", 0x1F01), ("version", 0x1F02))
EGL_DEVICE, EGL_EXTENSIONS, EGL_DRM_FILE, EGL_CUDA_DEVICE = 0x322C, 0x3055, 0x3233, 0x323A
LONGEST = 300


def current_context():
    """Return `api` (egl, osmesa, glx), vendor, renderer, version and, of EGL, `device`; empty without a context."""
    facts = first_answer(("libEGL.so", _egl), ("libOSMesa.so", _osmesa), ("libGLX.so", _glx), ("libGL.so", _glx))
    return {name: text[:LONGEST] for name, text in facts.items() if text}


def first_answer(*questions):
    """Return the first answer of a loaded library; a question is the beginning of a file name and a function."""
    mapped = _mapped()
    for stem, ask in questions:
        for path in mapped:
            if os.path.basename(path).startswith(stem):
                facts = _answer(ask, path)
                if facts:
                    return facts
    return {}


def _mapped():
    with open("/proc/self/maps", "rb") as file:
        paths = {line.split(None, 5)[5].strip() for line in file if b"/" in line}
    return sorted(os.fsdecode(path) for path in paths if b".so" in path)


def _answer(ask, path):
    """Return the answer of a library; None if it lacks the functions that its name promises, or is gone again."""
    try:
        return ask(ctypes.CDLL(path, mode=os.RTLD_NOLOAD | os.RTLD_LAZY))
    except (OSError, AttributeError):
        return None


def _egl(library):
    find, device = library.eglGetProcAddress, drawing_device(library)
    if device is None:
        return None
    return dict(_strings(find), api="egl", device=describe_device(find, device) if device else "")


def _osmesa(library):
    if not _pointer(library.OSMesaGetCurrentContext):
        return None
    return dict(_strings(library.OSMesaGetProcAddress), api="osmesa")


def _glx(library):
    if not _pointer(library.glXGetCurrentContext):
        return None
    return dict(_strings(library.glXGetProcAddressARB), api="glx")


def drawing_device(library):
    """Return the device of EGL's current context; 0 where it cannot be asked, None without a context."""
    display = _pointer(library.eglGetCurrentDisplay)
    if not display or not _pointer(library.eglGetCurrentContext):
        return None
    kinds = ctypes.c_uint, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p
    of_display = c_function(library.eglGetProcAddress, "eglQueryDisplayAttribEXT", *kinds)
    device = ctypes.c_void_p()
    answered = of_display and of_display(display, EGL_DEVICE, ctypes.byref(device))
    return device.value or 0 if answered else 0


def describe_device(find, device):
    """Describe a device: its file, the number by which CUDA knows it, or that it is no hardware."""
    text, extensions = _device_text(find), _extensions(find, device)
    facts = []
    if b"EGL_EXT_device_drm" in extensions:
        facts.append(_text(text(device, EGL_DRM_FILE)))
    cuda = cuda_number(find, device)
    if cuda is not None:
        facts.append("CUDA {}".format(cuda))
    if b"EGL_MESA_device_software" in extensions:
        facts.append("software")
    return ", ".join(filter(None, facts))


def cuda_number(find, device):
    """Return the number by which CUDA knows a device of EGL; None if CUDA does not know it."""
    kinds = ctypes.c_uint, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p
    of_device = c_function(find, "eglQueryDeviceAttribEXT", *kinds)
    if not of_device or b"EGL_NV_device_cuda" not in _extensions(find, device):
        return None  # to ask would leave an error behind, which a library may take for its own
    cuda = ctypes.c_void_p()
    return cuda.value or 0 if of_device(device, EGL_CUDA_DEVICE, ctypes.byref(cuda)) else None


def _extensions(find, device):
    """Return the extensions of a device."""
    text = _device_text(find)
    return (text(device, EGL_EXTENSIONS) or b"").split() if text else []


def _device_text(find):
    return c_function(find, "eglQueryDeviceStringEXT", ctypes.c_char_p, ctypes.c_void_p, ctypes.c_int)


def _strings(find):
    ask = c_function(find, "glGetString", ctypes.c_char_p, ctypes.c_uint)
    return {name: _text(ask(number)) for name, number in STRINGS} if ask else {}


def c_function(find, name, result, *arguments):
    """Return a C function, as these libraries find it by its name; None if they know none."""
    find.restype, find.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    address = find(name.encode())
    return ctypes.CFUNCTYPE(result, *arguments)(address) if address else None


def _pointer(function):
    """Call a C function without arguments and return the pointer that it gives."""
    function.restype = ctypes.c_void_p
    return function()


def _text(raw):
    return (raw or b"").decode("utf-8", "replace")
