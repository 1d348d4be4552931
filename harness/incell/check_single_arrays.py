"""Check that each promised array was one."""

import sys

from .cell_errors import skip

OTHERS = ("value.not_array", "pybullet.no_numpy")
"""The codes of findings of something else in place of a promised array."""


def run(probe, _facts):
    """Skip where anything else came instead of a promised array, as earlier findings show."""
    bullet = sys.modules.get("pybullet")
    if not getattr(bullet, "isNumpyEnabled", lambda: 1)():
        skip("unmeasured.pybullet")
    others = [finding for finding in probe.findings("single.type") if finding["code"] in OTHERS]
    if others:
        skip("unmeasured.arrays", found=min(others, key=_place))


def _place(observed):
    where = observed["data"].get("where", {})
    return [where.get(name, "") for name in ("call", "value", "path")]
