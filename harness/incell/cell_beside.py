"""Turns what happened beside a check into findings: warnings, ignored exceptions, replaced functions of ours."""

import os
import sys
from os.path import abspath as _absolute

from .cell_kept import collect

FOLDER = os.path.dirname(os.path.abspath(__file__))
STANDARD = os.path.dirname(os.path.abspath(os.__file__))
MOST_REPLACED = 5


def after_check(probe, phase, passed):
    """Turn what happened beside the calls into findings; after a failure the ruins tell nothing."""
    collect()
    for text in probe.watch.take_deprecations():
        probe.finding(phase + ".deprecation", "warned.deprecation", text=text, level="note")
    ignored = probe.watch.take_ignored()
    for name, error in ignored if passed else ():
        probe.finding(phase + ".teardown", "teardown.ignored", name=name, raised=error)


def at_end(probe, phase):
    """Tell of functions of ours that were replaced."""
    for name in _replaced():
        probe.finding(phase + ".replaced", "harness.replaced", name=name)


def tell_raised(probe, check, error, blamed):
    """Tell of an exception that does not stop a user's loop."""
    if blamed == "library":
        probe.finding(check, "raised", raised=error)
    else:
        probe.finding(check, "raised.by_harness", raised=error)


def _replaced():
    """Return which functions of ours something else put its own in the place of, by module and name.

    It finds what is done by accident or without care: whoever wants to hide it in the same process can.
    """
    ours = [(name, sys.modules[name]) for name in sorted(sys.modules) if name.startswith(__package__ + ".")]
    found = []
    for name, module in ours:
        holders = [module, *(kind for kind in vars(module).values() if isinstance(kind, type))]
        holders = [one for one in holders if getattr(one, "__module__", __package__).startswith(__package__)]
        entries = [entry for holder in holders for entry in vars(holder).items()]
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
