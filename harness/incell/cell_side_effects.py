"""Report side effects of a check as findings: warnings, ignored exceptions, replaced functions of ours."""

import os
import sys
from os.path import abspath as absolute

from .cell_originals import collect

FOLDER = os.path.dirname(os.path.abspath(__file__))
STANDARD = os.path.dirname(os.path.abspath(os.__file__))
MOST_REPLACED = 5


def report_side_effects(probe, phase, passed):
    """Report warnings and ignored exceptions; after a failure the exceptions mean nothing."""
    collect()
    for text in probe.watch.take_deprecations():
        probe.finding(phase + ".deprecation", "warned.deprecation", text=text, level="note")
    ignored = probe.watch.take_ignored()
    for name, error in ignored if passed else ():
        probe.finding(phase + ".teardown", "teardown.ignored", name=name, raised=error)


def report_replaced(probe, phase):
    """Report functions of ours that a library replaced.

    This finds what is done by accident or without care: whoever wants to hide it in the same process can.
    """
    for name in _replaced_functions():
        probe.finding(phase + ".replaced", "harness.replaced", name=name)


def report_raised(probe, check, error, blame):
    """Report an exception that does not stop a user's loop."""
    if blame == "library":
        probe.finding(check, "raised", raised=error)
    else:
        probe.finding(check, "raised.by_harness", raised=error)


def _replaced_functions():
    """Return the functions of ours that are no longer ours, by module and name."""
    ours = [(name, sys.modules[name]) for name in sorted(sys.modules) if name.startswith(__package__ + ".")]
    names = []
    for name, module in ours:
        holders = [module, *(kind for kind in vars(module).values() if isinstance(kind, type))]
        holders = [holder for holder in holders if getattr(holder, "__module__", __package__).startswith(__package__)]
        entries = [entry for holder in holders for entry in vars(holder).items()]
        names += [name[len(__package__) + 1 :] + "." + key for key, entry in entries if _is_foreign(entry)]
    return sorted(set(names))[:MOST_REPLACED]


def _is_foreign(entry):
    """Return whether a function is neither our code nor Python's own, which makes our context managers."""
    code = getattr(entry, "__code__", None)
    file = getattr(code, "co_filename", None)
    return file is not None and not file.startswith(FOLDER) and not _is_standard(file)


def _is_standard(file):
    """Return whether a file belongs to Python itself, of which modules of ours import functions."""
    path = absolute(file)
    return file.startswith("<frozen ") or (path.startswith(STANDARD) and "site-packages" not in path)
