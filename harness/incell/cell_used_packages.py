"""Find the installed packages that an environment really runs: code that is called, and files that it loads.

A package that is only installed, or that only we imported to look for environments, is none of them.
"""

import os
import re
import sys

from .cell_callables import entry_points, read_lines

PLUGINS = ("[gymnasium.envs]", "[gym.envs]")
"""Entry points that gymnasium and gym import by themselves, whatever environment is requested."""

MOST, MOST_LOADED = 300, 1000
OURS = os.path.dirname(os.path.abspath(__file__))
STANDARD = os.path.dirname(os.path.abspath(os.__file__))


class CallWatch:
    """Note whose code runs in a block, in this thread: files of Python code, modules of functions written in C."""

    def __init__(self):
        self.files = set()
        self.modules = set()
        self._before = None

    def __enter__(self):
        """Begin to watch."""
        self._before = sys.getprofile()
        sys.setprofile(self._note)
        return self

    def __exit__(self, _kind, _error, _traceback):
        """Stop watching."""
        sys.setprofile(self._before)
        return False

    def _note(self, frame, event, function):
        if event == "call":
            self.files.add(frame.f_code.co_filename)
        elif event == "c_call":
            self.modules.add(getattr(function, "__module__", None))


def used_distributions(calls, own_imports):
    """Return the distributions whose files were called, or were loaded by others than us.

    `own_imports` are the modules that we imported. The names are those of `pip list`, in normal form.
    """
    folders = _metadata_folders()
    ours = {name.partition(".")[0] for name in own_imports}
    for folder in folders:
        ours.update(target.partition(":")[0].partition(".")[0] for _, target in entry_points(folder, PLUGINS))
    files = set(calls.files)
    for name, module in list(sys.modules.items()):
        if name in calls.modules or name.partition(".")[0] not in ours:
            files.add(_file(module))
    return sorted({_distribution(folder) for folder in folders if _has_file(folder, files)})[:MOST]


def loaded_modules():
    """Return the top-level modules that this process has loaded, without Python's own and ours."""
    names = set()
    for name in {name.partition(".")[0] for name in list(sys.modules)}:
        path = os.path.abspath(_path(sys.modules.get(name)) or STANDARD)
        if (not path.startswith(STANDARD) or "site-packages" in path) and not path.startswith(OURS):
            names.add(name)
    return sorted(names)[:MOST_LOADED]


def distribution_of(kind):
    """Return the distribution that a class comes from; None where it comes from none."""
    file = _file(sys.modules.get(kind.__module__))
    folders = _metadata_folders() if file else ()
    return next((_distribution(folder) for folder in folders if _has_file(folder, {file})), None)


def _file(module):
    file = getattr(module, "__file__", None)
    return file if isinstance(file, str) else None


def _path(module):
    """Return the file of a module, or the folder of one that has no file."""
    return _file(module) or next((path for path in getattr(module, "__path__", ()) if isinstance(path, str)), None)


def _metadata_folders():
    folders = [folder for folder in sys.path if os.path.isdir(folder)]
    names = [(folder, name) for folder in folders for name in sorted(os.listdir(folder))]
    return [os.path.join(folder, name) for folder, name in names if name.endswith(".dist-info")]


def _distribution(folder):
    return re.sub(r"[-_.]+", "-", os.path.basename(folder).partition("-")[0]).lower()


def _has_file(folder, files):
    """Return whether one of these files belongs to the distribution of this metadata."""
    for line in read_lines(os.path.join(folder, "RECORD")):
        path = line[1:].partition('"')[0] if line.startswith('"') else line.partition(",")[0]
        if path.endswith((".py", ".so")) and os.path.join(os.path.dirname(folder), path) in files:
            return True
    return False
