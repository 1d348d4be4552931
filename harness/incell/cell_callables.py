"""Find a user's own environment: `module:callable`, or the name of an entry point that stands for one.

Entry points are read from the files of the distributions: importlib.metadata, once imported by us, would be there for
a library that forgot to import it.
"""

import importlib
import os
import sys

GROUP = "[simmatrix.environments]"


class UserCallable:
    """A callable that makes an environment."""

    def __init__(self, module, name):
        self.module = module
        self.name = name

    def exists(self):
        """Return whether the module, which is imported, has it."""
        return callable(self._resolve())

    def make(self, options):
        """Call it; how to draw is passed to those that take it, the others draw as they are."""
        function = self._resolve()
        if "render_mode" in options and not takes_argument(function, "render_mode"):
            options = {name: value for name, value in options.items() if name != "render_mode"}
        return function(**options)

    def _resolve(self):
        value = importlib.import_module(self.module)
        for part in self.name.split("."):
            value = getattr(value, part, None)
        return value


def user_callable(case):
    """Return the callable that the environment id of a case names; None if it cannot be one."""
    env = local_name(case)
    text = env if ":" in env else _entry_point(env)
    module, colon, name = text.partition(":")
    valid = colon and all(part.isidentifier() for part in (module + "." + name).split("."))
    return UserCallable(module, name) if valid else None


def local_name(case):
    """Return the environment id of a case without the name of its API before it; empty where there is none."""
    env = case["env"] or ""
    prefix, colon, rest = env.partition(":")
    return rest if colon and prefix == case["api"] else env


def takes_argument(function, name):
    """Return whether a function can be called with an argument of this name."""
    import inspect

    parameters = inspect.signature(function).parameters.values()
    return any(parameter.name == name or parameter.kind is parameter.VAR_KEYWORD for parameter in parameters)


def _entry_point(name):
    """Return the target of an entry point; empty if there is none of this name."""
    for folder in sys.path:
        if not os.path.isdir(folder):
            continue
        for distribution in sorted(os.listdir(folder)):
            if distribution.endswith((".dist-info", ".egg-info")):
                for entry, target in entry_points(os.path.join(folder, distribution), (GROUP,)):
                    if entry == name:
                        return target
    return ""


def entry_points(folder, groups):
    """Yield the name and the target of each entry point that a distribution has in these groups."""
    inside = False
    for line in read_lines(os.path.join(folder, "entry_points.txt")):
        if line.startswith("["):
            inside = line.replace(" ", "") in groups
        elif inside and "=" in line and not line.startswith("#"):
            name, _, target = line.partition("=")
            yield name.strip(), target.partition("[")[0].strip()


def read_lines(path):
    """Return the lines of a text file, stripped; none where it cannot be read."""
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return [line.strip() for line in file]
    except OSError:
        return []
