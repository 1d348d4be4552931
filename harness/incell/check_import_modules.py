"""Imports the modules that a user's script imports first."""

import sys

from .cell_search import registering
from .cell_sources import ASIDE

MOST_IDS = 30


def run(probe, facts):
    """Import what the case names, then what its API needs, and tell of an environment that nothing registers."""
    facts["seconds"] = probe.import_modules()
    if probe.api is None:
        if probe.case["packages"]:
            facts["registers"] = _registered(probe)
    elif not probe.api.knows(probe.case):
        nearest = probe.api.nearest(probe.case)
        if nearest is not None:
            facts["unregistered"] = {"nearest": nearest, "searched": list(probe.searched)}
    elif probe.searched:
        facts["registered_by"] = probe.searched[-1]


def _registered(probe):
    """Return, by library, the environments that the requested packages or their submodules register.

    The libraries are gymnasium and gym.
    """
    tops = [name for name in probe.case["imports"] if name.lower() not in ASIDE]
    found = _ids(tops)
    for module in [] if found else [one for top in tops for one in registering(top, None)]:
        try:
            probe.import_module(module)
        except Exception:  # a submodule that needs more than was asked for registers nothing here
            continue
    return found or _ids(tops)


def _ids(tops):
    """Return the ids, by library, whose entry point lies in one of these packages."""
    found = {}
    for library in ("gymnasium", "gym"):
        registry = getattr(sys.modules.get(library + ".envs.registration"), "registry", {})
        registry = getattr(registry, "env_specs", registry)
        for name, spec in list(registry.items()):
            entry = getattr(spec, "entry_point", None)
            module = entry if isinstance(entry, str) else getattr(entry, "__module__", None)
            if (module or "").partition(":")[0].partition(".")[0] in tops:
                found.setdefault(library, []).append(str(name))
    return {library: sorted(names)[:MOST_IDS] for library, names in found.items()}
