"""Define the few errors that reach a user, each with the exit code of the command-line contract."""

from __future__ import annotations

import errno

SHORTAGES = frozenset(
    getattr(errno, f"E{name}")
    for name in ("NOSPC", "DQUOT", "ROFS", "IO", "ACCES", "PERM", "MFILE", "NFILE", "NOMEM", "AGAIN")
)
"""Error numbers of a system that is full, broken, forbids something or lacks something: no bug of ours."""


def in_the_way(error: Exception) -> str | None:
    """Say what of this machine is in the way, if it is the machine: that it is full, broken, or forbids something."""
    several = (type(error).__module__, type(error).__name__) == ("shutil", "Error")  # which this floor does not import
    if several or (isinstance(error, OSError) and error.errno in SHORTAGES):
        return f"this machine got in the way: {error}"
    return None


class HarnessError(Exception):
    """A sentence for the user: what happened, where, what to do next. Never shown with a traceback."""

    exit_code = 4


class BadInput(HarnessError):
    """The matrix file, the command line or another input cannot be understood; nothing was written."""

    exit_code = 2


class UnusableRequirement(BadInput):
    """A requirement that the resolver cannot use. In a matrix, only the combination with it fails."""


class CouldNotTell(HarnessError):
    """This machine or the network is at fault; says nothing about packages."""

    exit_code = 3
