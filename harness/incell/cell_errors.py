"""Find whose fault an exception is, and describe it as plain data."""

import traceback

from .cell_observation import observation
from .cell_records import LONGEST_MESSAGE, LONGEST_TRACEBACK, shorten


class ObservedError(Exception):
    """An observation as an exception. A vector environment raises that of a worker within an exception of its type."""

    def __init__(self, observed):
        super().__init__(observed)
        fields = getattr(observed, "observed", observed)
        self.observed = fields if isinstance(fields, dict) else observation("raised", {"raised": fields})


class ContractViolation(ObservedError):
    """The library returned something a user's loop cannot use."""


class Skip(ObservedError):
    """The check has no meaning here."""


def violate(code, **data):
    """Raise a violation of the contract."""
    raise ContractViolation(observation(code, data))


def skip(code, **data):
    """End a check that has no meaning here."""
    raise Skip(observation(code, data))


class Library:
    """Mark calls into the libraries under test: exceptions raised inside are theirs, whatever frame they come from.

    The innermost frame alone does not decide: "reset() got an unexpected keyword argument 'seed'" is raised in ours.
    """

    def __init__(self):
        self.last_error = None

    def __enter__(self):
        """Begin a call."""
        return self

    def __exit__(self, _kind, error, _traceback):
        """Remember the exception of the call, and let it pass."""
        if error is not None:
            self.last_error = error
        return False


library = Library()


def blame(error):
    """Return `library`, or `harness` if our own code raised the exception."""
    theirs = error is library.last_error or isinstance(error, ContractViolation)
    return "library" if theirs else "harness"


def error_fields(error):
    """Return the fields of a record for an exception: `raised` by a library or by us, or `observed` by us."""
    if isinstance(error, ContractViolation):
        return {"raised": None, "observed": error.observed}
    return {"raised": describe(error), "observed": None}


def describe(error):
    """Return an exception as plain data, bounded."""
    return {
        "type": type_name(error),
        "message": shorten(message(error), LONGEST_MESSAGE),
        "traceback": shorten(_traceback(error), LONGEST_TRACEBACK),
        "blame": blame(error),
    }


def type_name(error):
    """Return the name of an exception's type as a traceback shows it, ours without our package."""
    kind = type(error)
    if kind.__module__ in ("builtins", __name__):
        return kind.__qualname__
    return "{}.{}".format(kind.__module__, kind.__qualname__)


def message(error):
    """Return an exception's text; some raise another one instead."""
    try:
        return str(error)
    except Exception:
        return "(its message cannot be had)"


def summary(error):
    """Return an exception on one line."""
    return "{}: {}".format(type_name(error), " ".join(message(error).split()))


def observed_error(error):
    """Return an exception as part of an observation: on one line, or what we observed."""
    return error.observed if isinstance(error, ContractViolation) else summary(error)


def _traceback(error):
    try:
        return "".join(traceback.format_exception(type(error), error, error.__traceback__))
    except Exception:
        return "(its traceback cannot be had)"
