"""Help the checks of phase interop: import a library that may be absent, make an environment as its library does."""

import importlib

from .cell_errors import Skip, library, skip


def present(module, distribution):
    """Import a library that trains; without it there is nothing to check."""
    try:
        with library:
            return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        return skip("interop.absent", name=distribution)


def made(probe):
    """Return the environment as the library that brings it has it."""
    try:
        return probe.api.bare(probe.case)
    except Skip:
        return skip("interop.other_api")


def close(env):
    """Close an environment."""
    with library:
        env.close()
