"""Sees whether what was promised as an array was one."""

import sys

from .cell_errors import Skip


def run(probe, _facts):
    """See whether what was promised as an array was one."""
    bullet = sys.modules.get("pybullet")
    if not getattr(bullet, "isNumpyEnabled", lambda: 1)():
        reason = "could not be measured as arrays: this pybullet was built without numpy, and gives tuples"
        raise Skip(reason)
    for text in probe.findings("single.type"):
        if "where an array was promised" in text:
            reason = "could not be measured as arrays: " + text
            raise Skip(reason)
