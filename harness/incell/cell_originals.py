"""Keep the functions that our own code calls from before any library is imported, since a library may replace them.

A library that replaces `json.dumps` or `os.getpid` does nothing wrong, but it must not change what we record of it.
"""

# ruff: noqa: F401 - other modules import these from here

from gc import collect
from importlib import import_module
from json.encoder import encode_basestring_ascii
from os import _exit as leave
from os import fstat, getpid, write
from os import open as open_file
from os.path import join
from signal import ITIMER_REAL, setitimer
from time import monotonic


def encode(value):
    """Return a value as JSON in ASCII; a value that JSON lacks becomes its text."""
    if value is None or value is True or value is False:
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, dict):
        return "{" + ", ".join(_quoted(key) + ": " + encode(item) for key, item in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(encode, value)) + "]"
    if isinstance(value, int):
        return _digits(value)
    if isinstance(value, float) and value - value == 0:
        return float.__repr__(value)
    return _quoted(repr(value) if isinstance(value, float) else value)


def clean_text(value):
    """Return a value as text that UTF-8 can hold."""
    return str(value).encode("utf-8", "backslashreplace").decode("utf-8")


def _digits(number):
    try:
        return int.__repr__(number)
    except ValueError:  # Python writes no number of more than 4,300 digits
        return _quoted("a number of {} bits".format(number.bit_length()))


def _quoted(value):
    return encode_basestring_ascii(clean_text(value))
