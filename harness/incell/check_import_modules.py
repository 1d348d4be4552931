"""Import the modules that a user's script imports first."""

from .cell_module_search import ASIDE, registered, registering_modules

MOST_IDS = 30


def run(probe, facts):
    """Import the modules of the case, then those of its API; note an environment that nothing registers."""
    facts["seconds"] = probe.import_modules()
    if probe.api is None:
        if probe.case["packages"]:
            facts["registers"] = _registered(probe)
    elif not probe.api.has_environment(probe.case):
        nearest = probe.api.similar_names(probe.case)
        if nearest is not None:
            facts["unregistered"] = {"nearest": nearest, "searched": list(probe.searched)}
    elif probe.searched:
        facts["registered_by"] = probe.searched[-1]


def _registered(probe):
    """Return, by library, the environments that the requested packages or their submodules register.

    The libraries are gymnasium and gym.
    """
    packages = [name for name in probe.case["imports"] if name.lower() not in ASIDE]
    environments = _ids(packages)
    for module in [] if environments else [name for package in packages for name in registering_modules(package, None)]:
        try:
            probe.import_module(module)
        except Exception:  # a submodule that needs more than was asked for registers nothing here
            continue
    return environments or _ids(packages)


def _ids(packages):
    """Return the ids, by library, whose entry point lies in one of these packages."""
    environments = {}
    for library, name, _ in registered(packages):
        environments.setdefault(library, []).append(name)
    return {library: sorted(names)[:MOST_IDS] for library, names in environments.items()}
