"""Keeps the functions that our own code calls, from before any library is imported, since a library may replace them.

A library that puts another encoder in the place of `json.dumps`, or its own number in the place of `os.getpid`, does
nothing wrong. It is not to change what is said of it, either.
"""

from gc import collect
from importlib import import_module
from json.encoder import encode_basestring_ascii
from os import _exit as leave
from os import fstat, getpid, write
from os import open as open_file
from os.path import join
from signal import ITIMER_REAL, setitimer
from time import monotonic

__all__ = [
    "ITIMER_REAL",
    "collect",
    "encoded",
    "fstat",
    "getpid",
    "import_module",
    "join",
    "leave",
    "monotonic",
    "open_file",
    "setitimer",
    "write",
]


def encoded(value):
    """Return a value as JSON in ASCII; what JSON lacks becomes its text."""
    if value is None or value is True or value is False:
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, dict):
        return "{" + ", ".join(_quoted(key) + ": " + encoded(item) for key, item in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(encoded, value)) + "]"
    if isinstance(value, int):
        return _digits(value)
    if isinstance(value, float) and value - value == 0:
        return float.__repr__(value)
    return _quoted(repr(value) if isinstance(value, float) else value)


def clean(value):
    """Return a value as text that UTF-8 can hold."""
    return str(value).encode("utf-8", "backslashreplace").decode("utf-8")


def _digits(number):
    try:
        return int.__repr__(number)
    except ValueError:  # Python writes no number of more than 4,300 digits
        return _quoted("a number of {} bits".format(number.bit_length()))


def _quoted(value):
    return encode_basestring_ascii(clean(value))
