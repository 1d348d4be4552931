"""Recognise what a machine lacked, whatever the package: memory, disk, network."""

from __future__ import annotations

import re

from harness.standalone.failures.machine_trouble import SHORTAGES, UNREACHABLE

CUT_SHORT = re.compile(r"EOFError: (?:marshal data too short|EOF read where (?:object|not) expected)")
"""What Python says of bytecode that is not whole: it keeps what it could write of it where a disk is full."""

MACHINE_TROUBLE = re.compile(
    rf"{SHORTAGES}|{UNREACHABLE}|Resource temporarily unavailable|can't start new thread|{CUT_SHORT.pattern}"
)
"""What the operating system says when this machine or its network is short of something, whatever the package."""

FULL = frozenset({"No space left on device", "Disk quota exceeded"})
ROOMY_MB = 1024
"""Room that no write takes up between two looks at a disk: one that never had less was not full."""

SHOT = "killed by SIGKILL, by whom cannot be told: perhaps the system for want of memory, a service or a person"
"""The harness says when it sends it. A package hardly ever does, so nothing is said of one."""


def machine_trouble(text: str, decisive: str, least_room_mb: int | None) -> bool:
    """Tell whether a command failed because this machine lacks something, by all that it printed.

    A full disk that is only mentioned must have been one; so must a read-only one be what it failed by.
    """
    if MACHINE_TROUBLE.search(decisive):
        return True
    roomy = least_room_mb is not None and least_room_mb >= ROOMY_MB
    hearsay = {"Read-only file system"} | (FULL if roomy else set())
    return any(found[0] not in hearsay for found in MACHINE_TROUBLE.finditer(text))
