"""Find errors that native code prints and no exception carries: later failures due to them do not name them."""

from __future__ import annotations

import re
from functools import cache

from harness.standalone.adapters import adapters

MOST = 10
"""Lines that are told of one run."""

LAVAPIPE = "WARNING: lavapipe is not a conformant vulkan implementation.*"
"""The line of Mesa where it draws in place of a driver of hardware."""


@cache
def _error() -> re.Pattern[str]:
    """Return the pattern of a line: those that adapters declare, and Mesa's."""
    declared = [pattern for adapter in adapters().values() for pattern in adapter.native_errors]
    return re.compile(rf"^(?:{'|'.join([*declared, LAVAPIPE])})$", re.MULTILINE)


def errors(log: str) -> tuple[str, ...]:
    """Return the lines of native errors in a log, each once, at most `MOST`."""
    return tuple(dict.fromkeys(found[0].strip() for found in _error().finditer(log)))[:MOST]
