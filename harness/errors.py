"""The few errors that reach a user, each with the exit code of the command-line contract."""

from __future__ import annotations


class HarnessError(Exception):
    """A sentence for the user: what happened, where, what to do next. Never shown with a traceback."""

    exit_code = 4


class BadInput(HarnessError):
    """The matrix file, the command line or another input cannot be understood; nothing was written."""

    exit_code = 2


class CouldNotTell(HarnessError):
    """This machine or the network is at fault; says nothing about packages."""

    exit_code = 3
