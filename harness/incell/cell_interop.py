"""What the checks of phase interop share: a library that may be absent, and the environment as its library has it."""

import importlib

from .cell_errors import Skip, library


def present(module, distribution):
    """Import a library that trains; without it there is nothing to check."""
    try:
        with library:
            return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        message = "{} is not among the packages of this cell".format(distribution)
        raise Skip(message) from None


def made(probe):
    """The environment as the library that brings it has it."""
    try:
        return probe.api.bare(probe.case)
    except Skip:
        message = "environments of this API are not those of gym or gymnasium"
        raise Skip(message) from None


def close(env):
    """Close an environment."""
    with library:
        env.close()
