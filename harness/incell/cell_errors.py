"""Whose fault an exception is, and how it is told."""

import traceback

from .cell_lines import LONGEST_MESSAGE, LONGEST_TRACEBACK, bounded


class ContractViolation(Exception):
    """The library returned something a user's loop cannot use."""


class Skip(Exception):
    """The check has no meaning here."""


def violate(text, *values):
    """Raise a violation of the contract, its text formatted."""
    raise ContractViolation(text.format(*values))


class Library:
    """Marks calls into the libraries under test: what is raised inside is theirs, whatever frame it comes from.

    The innermost frame alone does not tell: "reset() got an unexpected keyword argument 'seed'" is raised in ours.
    """

    def __init__(self):
        self.raised = None

    def __enter__(self):
        """Begin a call."""
        return self

    def __exit__(self, _kind, error, _traceback):
        """Remember what the call raised, and let it pass."""
        if error is not None:
            self.raised = error
        return False


library = Library()


def blame(error):
    """`library`, or `harness` when our own code raised it."""
    theirs = error is library.raised or isinstance(error, ContractViolation)
    return "library" if theirs else "harness"


def describe(error):
    """An exception as plain data, bounded."""
    return {
        "type": type_name(error),
        "message": bounded(message(error), LONGEST_MESSAGE),
        "traceback": bounded(_traceback(error), LONGEST_TRACEBACK),
        "blame": blame(error),
    }


def type_name(error):
    """The name of an exception's type as a traceback shows it, ours without our package."""
    kind = type(error)
    if kind.__module__ in ("builtins", __name__):
        return kind.__qualname__
    return "{}.{}".format(kind.__module__, kind.__qualname__)


def message(error):
    """An exception's text; some raise when asked for it."""
    try:
        return str(error)
    except Exception:
        return "(its message cannot be had)"


def summary(error):
    """An exception on one line."""
    return "{}: {}".format(type_name(error), " ".join(message(error).split()))


def _traceback(error):
    try:
        return "".join(traceback.format_exception(type(error), error, error.__traceback__))
    except Exception:
        return "(its traceback cannot be had)"
