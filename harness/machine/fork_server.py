"""Start the guards of commands: one Python process forks them all (`supervisor/fork_server.py`)."""

from __future__ import annotations

import atexit
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO

from harness.machine.supervisor import SIZE

SUPERVISOR = Path(__file__).parent / "supervisor" / "__main__.py"
PATIENCE, WAKE_SECONDS = 5.0, 1.0
"""Seconds that the server has to end, and between two wakings of one that somebody may have stopped."""

LOADER = ("LD_LIBRARY_PATH",)
"""All that a supervisor inherits of the environment: what this Python may need to start. It can be read by the command
through /proc, where the command has the rights for that; tokens of the user must not stand there."""


class Guard:
    """A guard: it reads its order, and later perhaps a reason to end, and reports; `report` is the pipe to read.

    One thread reads and waits. A guard that could not be forked has ended without a report; its `pid` is 0.
    """

    def __init__(self, log: IO[bytes]) -> None:
        order, self._order = os.pipe()
        self.report, report = os.pipe()
        self._end, end = os.pipe()
        theirs = [order, report, log.fileno(), end]
        try:
            self._server, self.pid = _fork(theirs)
        finally:
            for descriptor in (order, report, end):
                os.close(descriptor)

    def tell(self, message: bytes) -> None:
        """Write to its order; nothing where it has ended, or was hung up on."""
        with suppress(OSError):
            os.write(self._order, message)

    def hang_up(self) -> None:
        """Close its order, which ends what it runs."""
        if self._order >= 0:
            os.close(self._order)
            self._order = -1  # the number may soon be that of another file

    def signal(self, number: int) -> None:
        """Send it a signal, if it has not ended."""
        if self.pid:
            self._server.signal(self.pid, number)

    def wait(self) -> int | None:
        """Wait for its end and return its exit code, minus the signal where one ended it; None where nobody knows."""
        os.close(self.report)
        poller = select.poll()
        poller.register(self._end, select.POLLIN)
        while not poller.poll(WAKE_SECONDS * 1000):
            self._server.wake()
        code = os.read(self._end, SIZE)
        os.close(self._end)
        return int.from_bytes(code, "little", signed=True) if code else None


class _Server:
    """A process that forks guards, for a process of the harness and the variables that it had then."""

    def __init__(self) -> None:
        self.identity = _identity()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self.process = subprocess.Popen(
                (sys.executable, "-I", "-S", str(SUPERVISOR)),
                stdin=theirs.fileno(),
                env=_variables(),
                # Ctrl-C in a terminal must not reach it: `stop` ends each command and gives the reason.
                start_new_session=True,
            )
        ours.settimeout(WAKE_SECONDS)
        self.socket = ours

    def fork(self, descriptors: list[int]) -> int:
        """Have a guard forked and return its pid; 0 where the server has ended."""
        self.wake()
        try:
            socket.send_fds(self.socket, [bytes(2 * SIZE)], descriptors)
            while True:
                with suppress(TimeoutError):
                    return int.from_bytes(self.socket.recv(SIZE), "little")
                self.wake()
        except (BrokenPipeError, ConnectionResetError):
            return 0

    def signal(self, pid: int, number: int) -> None:
        """Send a signal to a guard; nobody gets it where the guard or this server has ended."""
        self.wake()
        with suppress(OSError):
            self.socket.send(b"".join(part.to_bytes(SIZE, "little") for part in (pid, number)))

    def wake(self) -> None:
        """Wake it, in case somebody has stopped it."""
        self.process.send_signal(signal.SIGCONT)

    def close(self) -> None:
        """End it, and wait; guards that are still running end by themselves."""
        if self.identity[0] == os.getpid():  # a fork of the harness did not start it
            with suppress(OSError):
                self.socket.shutdown(socket.SHUT_RDWR)
            try:
                self.process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self.socket.close()


def _variables() -> dict[str, str]:
    return {name: os.environ[name] for name in LOADER if name in os.environ}


def _identity() -> tuple[int, Path, Mapping[str, str]]:
    return os.getpid(), SUPERVISOR, _variables()


_servers: list[_Server] = []
"""The server that is in use, if there is one."""

_gate = threading.Lock()


def _fork(descriptors: list[int]) -> tuple[_Server, int]:
    """Have a guard forked by the server in use; by a new one where that has ended or was started otherwise."""
    with _gate:
        server = _servers[0] if _servers else None
        if server and server.identity == _identity() and (pid := server.fork(descriptors)):
            return server, pid
        close()
        server = _Server()
        _servers.append(server)
        return server, server.fork(descriptors)


def prepare() -> None:
    """Start the server, so that the first guard need not wait for it."""
    with _gate:
        if not _servers:
            _servers.append(_Server())


@atexit.register
def close() -> None:
    """End the server in use."""
    while _servers:
        _servers.pop().close()
