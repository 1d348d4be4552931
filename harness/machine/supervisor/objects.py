"""Remove System V shared memory, semaphores and message queues, which belong to no process and so outlive all."""

from __future__ import annotations

import ctypes

from harness.machine.supervisor.sandbox import libc

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

IPC_RMID, SEM_GETPID = 0, 11
LISTS = {"shm": ("shmid", ("cpid",)), "msg": ("msqid", ("lspid", "lrpid")), "sem": ("semid", ())}


def table(kind: str) -> Iterator[dict[str, int]]:
    """Yield every object of a kind, by the names that the kernel gives to its columns."""
    try:
        with open(f"/proc/sysvipc/{kind}") as file:
            names, *rows = [line.split() for line in file]
    except (OSError, ValueError):
        return
    yield from (dict(zip(names, map(int, row), strict=False)) for row in rows)


def present() -> set[tuple[str, int]]:
    """Name every object that there is, by kind and number."""
    return {(kind, row[column]) for kind, (column, _) in LISTS.items() for row in table(kind)}


def remove(ours: Callable[[int], bool], before: set[tuple[str, int]]) -> None:
    """Remove objects that are new and were made, or last used, by one of our processes."""
    for kind, (column, users) in LISTS.items():
        for row in table(kind):
            number = row[column]
            if (kind, number) not in before:
                pids = (*(row[user] for user in users), *last_user(kind, number))
                # A queue that nobody has used names process 0. Nobody can tell whose it is, so it stays.
                if any(pid > 0 and ours(pid) for pid in pids):
                    discard(kind, number)


def last_user(kind: str, number: int) -> tuple[int, ...]:
    """Return the process that last used a set of semaphores: its list does not say. Empty for other kinds."""
    return (libc.semctl(number, 0, SEM_GETPID),) if kind == "sem" else ()


def discard(kind: str, number: int) -> None:
    """Remove an object; whoever still has it in use keeps it until the end."""
    if kind == "shm":
        libc.shmctl(number, IPC_RMID, None)
    elif kind == "msg":
        libc.msgctl(number, IPC_RMID, None)
    else:
        libc.semctl(number, 0, IPC_RMID, ctypes.c_int(0))
