"""A user's own environment: `module:callable`, or the name of an entry point that stands for one.

Entry points are read from the files of the distributions: importlib.metadata, once imported by us, would be there for
a library that forgot to import it.
"""

import importlib
import os
import sys

GROUP = "[simmatrix.environments]"


class Own:
    """A callable that makes an environment."""

    def __init__(self, module, name):
        self.module = module
        self.name = name

    def exists(self):
        """Return whether the module, which is imported, has it."""
        return callable(self._found())

    def make(self, options):
        """Call it; how to draw is passed to those that take it, the others draw as they are."""
        function = self._found()
        if "render_mode" in options and not takes(function, "render_mode"):
            options = {name: value for name, value in options.items() if name != "render_mode"}
        return function(**options)

    def _found(self):
        found = importlib.import_module(self.module)
        for part in self.name.split("."):
            found = getattr(found, part, None)
        return found


def own(case):
    """Return the callable that the environment id of a case names; None if it cannot be one.

    The name of an API may stand before it.
    """
    env = case["env"] or ""
    prefix, colon, rest = env.partition(":")
    if colon and prefix == case["api"]:
        env = rest
    text = env if ":" in env else _entry(env)
    module, colon, name = text.partition(":")
    valid = colon and all(part.isidentifier() for part in (module + "." + name).split("."))
    return Own(module, name) if valid else None


def takes(function, name):
    """Return whether a function can be called with an argument of this name."""
    import inspect

    parameters = inspect.signature(function).parameters.values()
    return any(parameter.name == name or parameter.kind is parameter.VAR_KEYWORD for parameter in parameters)


def _entry(name):
    """Return the target of an entry point; empty if there is none of this name."""
    for folder in sys.path:
        if not os.path.isdir(folder):
            continue
        for distribution in sorted(os.listdir(folder)):
            if distribution.endswith((".dist-info", ".egg-info")):
                found = _entries(os.path.join(folder, distribution, "entry_points.txt")).get(name)
                if found:
                    return found
    return ""


def _entries(path):
    """Return the entry points of our group in one file."""
    try:
        with open(path, encoding="utf-8") as file:
            lines = [line.strip() for line in file]
    except OSError:
        return {}
    found, inside = {}, False
    for line in lines:
        if line.startswith("["):
            inside = line.replace(" ", "") == GROUP
        elif inside and "=" in line and not line.startswith("#"):
            name, _, target = line.partition("=")
            found[name.strip()] = target.partition("[")[0].strip()
    return found
