"""Describe a task that was measured in copies of an environment, with an upgrade and without."""

from __future__ import annotations

import msgspec


class TriedTask(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one task in a copy as it is and in one with the upgrade.

    `behaves_otherwise` is None where that cannot be told: then `text` says why. `left_out` are packages whose version
    could not be copied.
    """

    env: str
    runs_now: bool
    runs_then: bool
    line: str | None
    behaves_otherwise: bool | None
    text: str
    left_out: tuple[str, ...] = ()
