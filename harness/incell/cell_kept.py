"""Keeps the functions that our own code calls, from before any library is imported, since a library may replace them.

A library that puts another encoder in the place of `json.dumps`, or its own number in the place of `os.getpid`, does
nothing wrong. It is not to change what is said of it, either.
"""

import os
import sys
from gc import collect
from importlib import import_module
from json.encoder import encode_basestring_ascii
from os import _exit as leave
from os import fstat, getpid, write
from os import open as open_file
from os.path import abspath as _absolute
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
    "replaced",
    "setitimer",
    "write",
]

FOLDER = os.path.dirname(os.path.abspath(__file__))
STANDARD = os.path.dirname(os.path.abspath(os.__file__))
MOST_REPLACED = 5


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


def replaced():
    """Return which functions of ours something else put its own in the place of, by module and name.

    It finds what is done by accident or without care: whoever wants to hide it in the same process can.
    """
    ours = [(name, sys.modules[name]) for name in sorted(sys.modules) if name.startswith(__package__ + ".")]
    found = []
    for name, module in ours:
        holders = [module, *(kind for kind in vars(module).values() if isinstance(kind, type))]
        holders = [one for one in holders if getattr(one, "__module__", __package__).startswith(__package__)]
        entries = [entry for holder in holders for entry in vars(holder).items()]
        entries += getattr(module, "CHECKS", {}).items()
        found += [name[len(__package__) + 1 :] + "." + key for key, entry in entries if _is_foreign(entry)]
    return sorted(set(found))[:MOST_REPLACED]


def _is_foreign(entry):
    """Return whether a function is neither our code nor Python's own, which makes our context managers."""
    code = getattr(entry, "__code__", None)
    file = getattr(code, "co_filename", None)
    return file is not None and not file.startswith(FOLDER) and not _is_standard(file)


def _is_standard(file):
    """Return whether a file belongs to Python itself, of which modules of ours import functions."""
    place = _absolute(file)
    return file.startswith("<frozen ") or (place.startswith(STANDARD) and "site-packages" not in place)


def _digits(number):
    try:
        return int.__repr__(number)
    except ValueError:  # Python writes no number of more than 4,300 digits
        return _quoted("a number of {} bits".format(number.bit_length()))


def _quoted(value):
    return encode_basestring_ascii(clean(value))
