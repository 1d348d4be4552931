"""Help the checks of phase interop: import a library that may be absent, make an environment as its library does."""

import importlib
import sys

from .cell_errors import Skip, library, skip


def import_trainer(module, distribution):
    """Import a library that trains; without it there is nothing to check."""
    try:
        with library:
            return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        return skip("interop.absent", name=distribution)


def import_sb3(facts):
    """Import Stable-Baselines3; its release and torch's become a fact."""
    module = import_trainer("stable_baselines3", "stable-baselines3")
    torch = getattr(sys.modules.get("torch"), "__version__", "?")
    facts["version"] = {"library": str(module.__version__), "torch": str(torch)}
    return module


def make_environment(probe):
    """Make the environment as the library that brings it has it."""
    try:
        return probe.api.make_raw(probe.case)
    except Skip:
        return skip("interop.other_api")


def close(env):
    """Close an environment."""
    with library:
        env.close()
