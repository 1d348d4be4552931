"""Hold the values that rooms share, and check them as they are read (`schema`): cells, plans, records; no I/O.

The values are loaded at the first use of one: errors, which every start needs, do without them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.model.values import *  # noqa: F403 - each value is a name of this room
else:

    def __getattr__(name: str) -> object:
        values = import_module("harness.model.values")
        if name.startswith("_") or not hasattr(values, name):
            message = f"module {__name__!r} has no attribute {name!r}"
            raise AttributeError(message)
        return globals().setdefault(name, getattr(values, name))
