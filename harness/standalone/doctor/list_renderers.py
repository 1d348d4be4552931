"""List the rendering libraries that can be loaded, and the devices: `python -B list_renderers.py FILE`.

Run by the interpreter of an environment, since it decides which libraries are found. Nothing is drawn.
"""

from __future__ import annotations

import sys

HERE = __file__.rpartition("/")[0]
sys.path[:] = [entry for entry in sys.path if entry != HERE]

import ctypes  # noqa: E402 - not from the folder of this file
import glob  # noqa: E402
import json  # noqa: E402
import os  # noqa: E402
from typing import Any  # noqa: E402

LIBRARIES = {
    "egl": ("libEGL.so.1", "libEGL.so"),
    "osmesa": ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"),
    "gl": ("libGL.so.1", "libOpenGL.so.0"),
}


def document() -> Any:
    """Return each library with the reason why it cannot be loaded (None if it can), and the device files."""
    libraries = {way: _loaded(names) for way, names in LIBRARIES.items()}
    devices = sorted(glob.glob("/dev/dri/render*") + glob.glob("/dev/nvidia[0-9]*"))
    return {"libraries": libraries, "devices": devices}


def _loaded(names: Any) -> Any:
    """Return None if one of these libraries can be loaded, else the first error."""
    why = ""
    for name in names:
        try:
            ctypes.CDLL(name)
            return None
        except OSError as error:
            why = why or str(error)
    return why


if __name__ == "__main__":
    with open(sys.argv[1], "w", encoding="ascii") as target:
        target.write(json.dumps(document()))
    sys.stdout.flush()
    os._exit(0)  # a driver that was loaded may not end well
