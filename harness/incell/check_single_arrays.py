"""Sees whether what was promised as an array was one."""

import sys

from .cell_errors import skip

OTHERS = ("value.not_array", "pybullet.no_numpy")
"""The codes of something else that came where an array was promised."""


def run(probe, _facts):
    """See whether what was promised as an array was one."""
    bullet = sys.modules.get("pybullet")
    if not getattr(bullet, "isNumpyEnabled", lambda: 1)():
        skip("unmeasured.pybullet")
    found = [each for each in probe.findings("single.type") if each["code"] in OTHERS]
    if found:
        skip("unmeasured.arrays", found=min(found, key=_place))


def _place(observed):
    where = observed["data"].get("where", {})
    return [where.get(name, "") for name in ("call", "value", "path")]
