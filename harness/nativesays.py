"""Errors that native code prints and no exception carries: what fails later because of them does not name them."""

from __future__ import annotations

import re

MOST = 10
"""Lines that are told of one run."""

ERROR = re.compile(
    r"^(?:\[(?:Error|Fatal)\] \[[\w.-]+\] .+"  # carb, the framework below Isaac Gym and Isaac Sim
    r"|\*\*\* Can't create empty tensor.*|Failed to fill .+ tensor"  # Isaac Gym
    r"|WARNING: lavapipe is not a conformant vulkan implementation.*)$",  # Mesa, in place of a driver of hardware
    re.MULTILINE,
)


def errors(log: str) -> tuple[str, ...]:
    """Such lines of a log, each once."""
    return tuple(dict.fromkeys(found[0].strip() for found in ERROR.finditer(log)))[:MOST]
