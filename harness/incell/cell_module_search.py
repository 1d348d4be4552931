"""Find the modules of a package that register environments: by their text, before any of them is imported."""

import importlib
import os
import re
import sys

MOST_MODULES = 12
MOST_FILES, LARGEST = 3000, 1 << 20
ASIDE = frozenset(
    ("test", "tests", "testing", "example", "examples", "script", "scripts", "docs", "benchmarks", "__main__")
)
"""Folders and modules whose import a user would not expect."""

REGISTERS = re.compile(r"\bregister(?:_envs?)?\s*\(")
FUNCTION = re.compile(r"register_(?:\w+_)?envs?")
"""The name of a function that a package offers for its user to call, as `register_envs` of BlueSky-Gym."""

LIBRARY = re.compile(r"\bgym(?:nasium)?\b")


def registering_modules(package, env):
    """Return the submodules of an imported package that seem to register environments, those that name `env` first."""
    name = (env or "").rpartition("/")[2].rpartition("-v")[0] or env
    candidates = []
    for module, text in module_texts(package):
        if module != package and REGISTERS.search(text) and LIBRARY.search(text):
            candidates.append((not (name and name in text), module.count("."), module))
    return [module for _, _, module in sorted(candidates)[:MOST_MODULES]]


def registering_functions(package):
    """Return the functions of an imported package that register its environments when called, as `module:name`."""
    module = sys.modules.get(package)
    names = [name for name in dir(module) if FUNCTION.fullmatch(name)]
    return ["{}:{}".format(package, name) for name in names if _needs_no_argument(getattr(module, name))]


def import_or_call(name):
    """Import a module, or call a function of one that is named `module:function`."""
    path, _, function = name.partition(":")
    module = importlib.import_module(path)
    if function:
        getattr(module, function)()


def _needs_no_argument(function):
    """Return whether this is a function that needs no argument."""
    code = getattr(function, "__code__", None)
    return code is not None and code.co_argcount <= len(function.__defaults__ or ()) and not code.co_kwonlyargcount


def registered(packages):
    """Yield (library, id, entry point) of each environment of these packages that gymnasium and gym register.

    The entry point is a text; "" where it is a callable.
    """
    for library in ("gymnasium", "gym"):
        registry = getattr(sys.modules.get(library + ".envs.registration"), "registry", {})
        for name, spec in list(getattr(registry, "env_specs", registry).items()):
            entry = getattr(spec, "entry_point", None)
            text = entry if isinstance(entry, str) else ""
            owner = text or str(getattr(entry, "__module__", ""))
            if owner.partition(":")[0].partition(".")[0] in packages:
                yield library, str(name), text


def module_texts(package):
    """Yield the name and the text of each module of an imported package, itself included; a bounded number of them."""
    for number, (name, path) in enumerate(_modules(package)):
        if number == MOST_FILES:
            return
        try:
            with open(path, encoding="utf-8", errors="replace") as file:
                yield name, file.read(LARGEST)
        except OSError:  # no module that can be read
            continue


def _modules(package):
    """Yield the name and the file of each module below a package; none of them is imported."""
    for folder in list(getattr(sys.modules.get(package), "__path__", ())):
        for place, folders, names in os.walk(folder):
            folders[:] = sorted(name for name in folders if _suits(name) and name != "__pycache__")
            parts = [package] + [part for part in os.path.relpath(place, folder).split(os.sep) if part != "."]
            for name in sorted(names):
                stem, _, kind = name.rpartition(".")
                if kind == "py" and _suits(stem):
                    yield ".".join(parts if stem == "__init__" else [*parts, stem]), os.path.join(place, name)


def _suits(name):
    return name.isidentifier() and name.lower() not in ASIDE
