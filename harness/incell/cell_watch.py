"""Watch for events beside the calls: warnings, exceptions nobody can catch, stacks of a crash or a hang."""

import faulthandler
import os
import re
import signal
import sys
import warnings

from .cell_errors import observed_error
from .cell_originals import ITIMER_REAL, open_file, setitimer

COLOURS = re.compile(r"\x1b\[[0-9;]*m")
DEPRECATIONS = (DeprecationWarning, PendingDeprecationWarning, FutureWarning)


class Stacks:
    """Write the stacks of all threads into a file: on a fatal signal, and when most of a limit is spent.

    The limit is watched by an interval timer, whose signal is handled in C. faulthandler's own timer is a thread: a
    forked child that ends normally would wait for that thread for ever, and Python 3.12 warns of every fork beside it.
    """

    def __init__(self, path):
        self._file = open_file(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        faulthandler.enable(file=self._file)
        faulthandler.register(signal.SIGALRM, file=self._file, all_threads=True, chain=False)

    def arm(self, seconds):
        """Write the stacks after this many seconds, unless disarmed."""
        setitimer(ITIMER_REAL, max(seconds, 0.001))

    def disarm(self):
        """Write no stacks."""
        setitimer(ITIMER_REAL, 0)


class Watch:
    """Collect texts of warnings and of exceptions that Python ignores (in `__del__`, at exit)."""

    def __init__(self):
        self._deprecations = []
        self._warnings = []
        self._ignored = []
        for category in DEPRECATIONS:
            warnings.simplefilter("default", category)
        self._show_warning = warnings.showwarning
        warnings.showwarning = self._note_warning
        if hasattr(sys, "unraisablehook"):  # since Python 3.8
            sys.unraisablehook = self._note_ignored

    def _note_warning(self, message, category, *place, **named):
        text = COLOURS.sub("", str(message)).strip()
        text = text[len("WARN: ") :] if text.startswith("WARN: ") else text
        if issubclass(category, DEPRECATIONS):
            self._deprecations.append(re.sub(r"\(pid=\d+\)", "(pid)", text))
        else:
            self._warnings.append(text)
        self._show_warning(message, category, *place, **named)

    def _note_ignored(self, unraisable):
        where = getattr(unraisable.object, "__qualname__", type(unraisable.object).__qualname__)
        self._ignored.append((where, observed_error(unraisable.exc_value)))
        sys.__unraisablehook__(unraisable)

    def take_warnings(self):
        """Return the warnings since the last call, deprecations apart."""
        taken, self._warnings = self._warnings, []
        return taken

    def take_deprecations(self):
        """Return the warnings of deprecation since the last call."""
        taken, self._deprecations = self._deprecations, []
        return taken

    def take_ignored(self):
        """Return the ignored exceptions since the last call, each with the name of the deleted or called object."""
        taken, self._ignored = self._ignored, []
        return taken
