"""Finds the submodules of a package that register environments: by their text, before any of them is imported."""

import importlib
import re
import sys

from .cell_sources import sources, text_of

MOST_MODULES = 12

REGISTERS = re.compile(r"\bregister(?:_envs?)?\s*\(")
FUNCTION = re.compile(r"register_(?:\w+_)?envs?")
"""The name of a function that a package offers for its user to call, as `register_envs` of BlueSky-Gym."""

LIBRARY = re.compile(r"\bgym(?:nasium)?\b")


def registering(package, env):
    """Return the submodules of an imported package that seem to register environments, those that name `env` first."""
    name = (env or "").rpartition("/")[2].rpartition("-v")[0] or env
    found = []
    for module, path in sources(package):
        text = text_of(path)
        if module != package and REGISTERS.search(text) and LIBRARY.search(text):
            found.append((not (name and name in text), module.count("."), module))
    return [module for _, _, module in sorted(found)[:MOST_MODULES]]


def functions(package):
    """Return the functions of an imported package that register its environments when called, as `module:name`."""
    module = sys.modules.get(package)
    names = [name for name in dir(module) if FUNCTION.fullmatch(name)]
    return ["{}:{}".format(package, name) for name in names if _plain(getattr(module, name))]


def imported(name):
    """Import a module, or call a function of one that is named `module:function`."""
    module, _, function = name.partition(":")
    found = importlib.import_module(module)
    if function:
        getattr(found, function)()


def _plain(function):
    """Tell whether it is a function that needs no argument."""
    code = getattr(function, "__code__", None)
    return code is not None and code.co_argcount <= len(function.__defaults__ or ()) and not code.co_kwonlyargcount
