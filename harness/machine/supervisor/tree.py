"""Find the processes below this one through /proc, measure them and end them."""

from __future__ import annotations

import os
import resource
import time

TYPE_CHECKING = False
if TYPE_CHECKING:
    import signal
else:
    import _signal as signal

STUCK = 5.0  # a process in an uninterruptible system call may outlive SIGKILL for as long as it likes


class SupervisorError(Exception):
    """The command could not be run, or not be watched: says nothing about the command."""


def descendants() -> dict[int, int]:
    """Return every living process below this one, with its resident bytes."""
    return {} if childless() else below(os.getpid(), processes())


def childless() -> bool:
    """Return whether nothing at all is below this process, told without a look at every process of the machine."""
    try:
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:
        return True
    return False


def processes() -> dict[int, list[tuple[int, int | None]]]:
    """Return every process of this machine by its parent: (pid, resident bytes, None if it has ended)."""
    children: dict[int, list[tuple[int, int | None]]] = {}
    page = resource.getpagesize()
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{name}/stat", "rb") as file:
                # The name of the program comes before, in parentheses, and may hold blanks and parentheses itself.
                fields = file.read().rpartition(b")")[2].split()
        except OSError:
            continue
        resident = None if fields[0] in b"ZX" else int(fields[21]) * page
        children.setdefault(int(fields[1]), []).append((int(name), resident))
    return children


def below(root: int, children: dict[int, list[tuple[int, int | None]]]) -> dict[int, int]:
    """Return the living processes below `root`, with their resident bytes."""
    memory_by_pid, parents = {}, [root]
    while parents:
        for pid, resident in children.get(parents.pop(), ()):
            parents.append(pid)
            if resident is not None:
                memory_by_pid[pid] = resident
    return memory_by_pid


def reap(ended: dict[int, int]) -> None:
    """Note the status of every child that has ended."""
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if not pid:
            return
        # The kernel uses numbers again: the first end under the command's number is the command's.
        ended.setdefault(pid, status)


def end_all(ended: dict[int, int]) -> int:
    """Kill until nothing is left below this process; return how many were killed. Raises SupervisorError after 5 s."""
    killed: set[int] = set()
    patience = time.monotonic() + STUCK
    # A process can fork between the look and its signal, so both are repeated until nothing is left.
    while left := descendants():
        if time.monotonic() > patience:
            message = f"{len(left)} processes cannot be ended"
            raise SupervisorError(message)
        for pid in left:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        killed.update(left)
        time.sleep(0.002)
        reap(ended)
    reap(ended)
    return len(killed)
