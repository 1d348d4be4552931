"""The guard of the unit tests itself."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable

import pytest


@pytest.mark.parametrize(
    ("act", "event"),
    [
        (lambda: subprocess.run([sys.executable, "-c", ""], check=False), "subprocess.Popen"),
        (lambda: os.system("true"), "os.system"),
        (lambda: os.posix_spawn("/bin/true", ["true"], {}), "os.posix_spawn"),
        (lambda: os.execv("/bin/true", ["true"]), "os.exec"),
        (os.fork, "os.fork"),
        (socket.socket, "socket.__new__"),
        (lambda: socket.getaddrinfo("localhost", 80), "socket.getaddrinfo"),
    ],
)
def test_refuses(act: Callable[[], object], event: str) -> None:
    """A unit test that starts a process or opens a socket fails, and is told where to go."""
    with pytest.raises(pytest.fail.Exception) as caught:
        act()

    assert str(caught.value) == f"a unit test may not use {event}: move it to tests/e2e, or pass the data in"
