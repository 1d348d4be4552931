"""Import modules one after the other, each within a time limit: `python -B import_modules.py FILE SECONDS MODULE...`.

Run by the interpreter of an environment. FILE gets one line of JSON when an import starts and one when it has ended;
what ends the process meanwhile, a crash or SIGALRM, is thereby known, too.
"""

from __future__ import annotations

import sys

HERE = __file__.rpartition("/")[0]
sys.path[:] = [entry for entry in sys.path if entry != HERE]

import faulthandler  # noqa: E402 - not from the folder of this file
import json  # noqa: E402
import os  # noqa: E402
import signal  # noqa: E402
import time  # noqa: E402
import traceback  # noqa: E402
from typing import Any  # noqa: E402

TEXT_LIMIT = 6000
WATCHED = (
    "libmujoco libstdc++ libgomp libomp libiomp libGL. libGLX libOpenGL libEGL libOSMesa libglfw libcudart".split()
)
"""How shared libraries begin of which there should be one."""


def main(target: Any, seconds: Any, names: Any) -> None:
    """Import each module, at most `seconds` for each, and write start and result of each to the file `target`."""
    descriptor = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.set_inheritable(descriptor, False)
    if not (getattr(sys.flags, "safe_path", False) or sys.flags.isolated):
        sys.path.insert(0, os.getcwd())
    faulthandler.enable()
    # The default action ends the process even in native code, where no Python handler would run.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    for name in names:
        _write(descriptor, {"module": name, "started": True})
        # The stacks come one second before the alarm, so that the output shows where an import hangs.
        faulthandler.dump_traceback_later(max(seconds - 1, 1))
        signal.alarm(seconds)
        began = time.time()
        result = _import_module(name)
        signal.alarm(0)
        faulthandler.cancel_dump_traceback_later()
        _write(descriptor, dict(result, module=name, started=False, seconds=round(time.time() - began, 3)))


def _import_module(name: Any) -> Any:
    try:
        __import__(name)
        module = sys.modules[name]
    except BaseException as error:  # what a library raises when it is imported is anything
        text = "".join(traceback.format_exception(type(error), error, error.__traceback__))
        error_line = traceback.format_exception_only(type(error), error)[-1].strip()
        return {"error": error_line[:TEXT_LIMIT], "traceback": text[-TEXT_LIMIT:], "libraries": _mapped()}
    result = {"error": None, "file": _file(module), "version": _version(module), "libraries": _mapped()}
    result["asked"] = _query_library(name, module)
    return result


def _file(module: Any) -> Any:
    return str(getattr(module, "__file__", None) or next(iter(getattr(module, "__path__", [])), None))


def _version(module: Any) -> Any:
    try:
        return str(getattr(module, "__version__", None) or "") or None
    except Exception:
        # A module may compute this attribute when it is asked for, and raise anything.
        return None


def _query_library(name: Any, module: Any) -> Any:
    """Return facts that only the library knows: MuJoCo's native version, or torch's CUDA version and device count."""
    try:
        if name == "mujoco":
            return {"native": str(module.mj_versionString())}
        if name == "torch":
            return {"cuda": str(module.version.cuda), "devices": str(module.cuda.device_count())}
    except Exception as error:
        return {"trouble": "{}: {}".format(type(error).__name__, error)[:TEXT_LIMIT]}
    return {}


def _mapped() -> Any:
    """Return the real paths of the loaded shared libraries of which a process should have only one."""
    try:
        with open("/proc/self/maps", encoding="utf-8", errors="replace") as file:
            paths = {line.split(None, 5)[5].strip() for line in file if "/" in line}
    except OSError:
        return []
    return sorted(path for path in paths if os.path.basename(path).startswith(tuple(WATCHED)))


def _write(descriptor: Any, record: Any) -> None:
    os.write(descriptor, (json.dumps(record) + "\n").encode("ascii"))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3:])
