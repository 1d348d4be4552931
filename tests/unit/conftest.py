"""Unit tests cannot start a process or open a socket: the interpreter itself refuses."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest

FORBIDDEN = frozenset(
    {
        "os.exec",
        "os.fork",
        "os.forkpty",
        "os.posix_spawn",
        "os.spawn",
        "os.system",
        "socket.__new__",
        "socket.getaddrinfo",
        "subprocess.Popen",
    }
)
"""Names of audit events; unlike patched functions they cannot be imported around."""

_guarded = False


def _refuse(event: str, _: tuple[object, ...]) -> None:
    if _guarded and event in FORBIDDEN:
        pytest.fail(f"a unit test may not use {event}: move it to tests/e2e, or pass the data in")


sys.addaudithook(_refuse)  # there is no removing it, hence the flag


@pytest.fixture(autouse=True)
def guard() -> Iterator[None]:
    """Guard each unit test, and no other."""
    global _guarded  # noqa: PLW0603 - an audit hook is global itself
    _guarded = True
    yield
    _guarded = False
