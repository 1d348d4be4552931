"""Finds the installed packages that an environment really runs: code that is called, and files that it loads.

A package that only lies there, or that only we imported to look for environments, is none of them.
"""

import os
import re
import sys

PLUGINS = ("[gymnasium.envs]", "[gym.envs]")
"""Entry points that gymnasium and gym import by themselves, whatever environment is asked for."""

MOST, MOST_LOADED = 300, 1000
OURS = os.path.dirname(os.path.abspath(__file__))
STANDARD = os.path.dirname(os.path.abspath(os.__file__))


class Called:
    """Notes whose code runs in a block, in this thread: files of Python code, modules of functions written in C."""

    def __init__(self):
        self.files = set()
        self.modules = set()
        self._before = None

    def __enter__(self):
        """Begin to listen."""
        self._before = sys.getprofile()
        sys.setprofile(self._heard)
        return self

    def __exit__(self, _kind, _error, _traceback):
        """Listen no more."""
        sys.setprofile(self._before)
        return False

    def _heard(self, frame, event, function):
        if event == "call":
            self.files.add(frame.f_code.co_filename)
        elif event == "c_call":
            self.modules.add(getattr(function, "__module__", None))


def exercised(called, imported):
    """Return the distributions whose files were called, or were loaded by others than us; `imported` are our imports.

    Their names are those of `pip list`, in normal form.
    """
    places = _places()
    ours = {name.partition(".")[0] for name in imported}
    ours.update(module.partition(".")[0] for place in places for module in _plugins(place))
    files = set(called.files)
    for name, module in list(sys.modules.items()):
        if name in called.modules or name.partition(".")[0] not in ours:
            files.add(_file(module))
    return sorted({_name(place) for place in places if _holds(place, files)})[:MOST]


def loaded():
    """Return the top-level modules that this process has loaded, without Python's own and ours."""
    found = set()
    for name in {name.partition(".")[0] for name in list(sys.modules)}:
        place = os.path.abspath(_place(sys.modules.get(name)) or STANDARD)
        if (not place.startswith(STANDARD) or "site-packages" in place) and not place.startswith(OURS):
            found.add(name)
    return sorted(found)[:MOST_LOADED]


def distribution_of(kind):
    """Return the distribution that a class comes from; None where it is none's."""
    file = _file(sys.modules.get(kind.__module__))
    return next((_name(place) for place in _places() if file and _holds(place, {file})), None)


def _file(module):
    file = getattr(module, "__file__", None)
    return file if isinstance(file, str) else None


def _place(module):
    """Return the file of a module, or the folder of one that has none."""
    return _file(module) or next((path for path in getattr(module, "__path__", ()) if isinstance(path, str)), None)


def _places():
    """Return the folders of metadata of all distributions."""
    folders = [folder for folder in sys.path if os.path.isdir(folder)]
    return [os.path.join(folder, name) for folder in folders for name in sorted(os.listdir(folder)) if _is(name)]


def _is(name):
    return name.endswith(".dist-info")


def _name(place):
    return re.sub(r"[-_.]+", "-", os.path.basename(place).partition("-")[0]).lower()


def _holds(place, files):
    """Tell whether one of these files belongs to a distribution."""
    folder = os.path.dirname(place)
    for line in _lines(os.path.join(place, "RECORD")):
        path = line[1:].partition('"')[0] if line.startswith('"') else line.partition(",")[0]
        if path.endswith((".py", ".so")) and os.path.join(folder, path) in files:
            return True
    return False


def _plugins(place):
    """Yield the modules that a distribution's entry points for gymnasium name."""
    inside = False
    for line in _lines(os.path.join(place, "entry_points.txt")):
        if line.startswith("["):
            inside = line.replace(" ", "") in PLUGINS
        elif inside and "=" in line:
            yield line.partition("=")[2].strip().partition(":")[0]


def _lines(path):
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return [line.strip() for line in file]
    except OSError:
        return []
