"""Measure the memory of the processes below this one, and count those that the kernel ended for want of memory."""

from __future__ import annotations

import os

from harness.machine.supervisor.tree import descendants

SHARED_MEMORY = "/dev/shm/"


class Memory:
    """The memory of all processes together, held against a limit in bytes.

    `private` is whether /dev/shm is theirs alone, so that all in it counts.
    """

    def __init__(self, limit: int, *, private: bool) -> None:
        self.limit, self.private = limit, private
        self.peak = 0
        self.least_shared = shared_pages()
        self.killed_before, self.group_before = killed_by_kernel(), Group()

    def exceeded(self) -> bool:
        """Say whether they hold more than the limit; exact only where a cheap sum, which is never less, is above it.

        The exact sum is taken twice: while processes start or end, their shares of a page do not add up to one.
        """
        # A file in memory that nobody maps is in no resident memory, only in the shared memory of the machine.
        resident, shared = sum(descendants().values()), shared_pages()
        self.peak = max(self.peak, resident)
        self.least_shared = min(self.least_shared, shared)
        if resident + shared - self.least_shared <= self.limit:
            return False
        return all(self.exact() > self.limit for _ in range(2))

    def exact(self) -> int:
        """Sum up the memory of all processes in bytes, a shared page counted once, with files that lie in memory."""
        own = mapped = 0
        files: dict[tuple[int, int], int] = {}
        for pid, resident in descendants().items():
            held, shared = proportional(pid, resident)
            own, mapped = own + held, mapped + shared
            files.update(in_memory(pid, private=self.private))
        # Shared pages and files in memory are mostly the same pages, so the larger sum counts, not both.
        return own + max(mapped, sum(files.values()) + (used("/dev/shm") if self.private else 0))

    def kills(self) -> int:
        """Count the processes of this machine that the kernel has ended for want of memory meanwhile."""
        return killed_by_kernel() - self.killed_before

    def shortage(self) -> str:
        """Say who had no memory left when the kernel ended one of them."""
        now = Group()
        if now.limit and now.kills > self.group_before.kills:
            return f"the control group of the harness allows {now.limit >> 20} MB of memory, and all of it was in use"
        return "the machine ran out of memory"


class Group:
    """The control group of this process: its least limit in bytes (0: none), and how many the kernel ended in it."""

    def __init__(self) -> None:
        self.limit = self.kills = 0
        for line in lines("/proc/self/cgroup"):
            _, controllers, path = line.rstrip("\n").split(":", 2)
            if not controllers:
                self.read("/sys/fs/cgroup", path, ("memory.max", "memory.events"))
            elif "memory" in controllers.split(","):
                self.read("/sys/fs/cgroup/memory", path, ("memory.limit_in_bytes", "memory.oom_control"))

    def read(self, base: str, path: str, names: tuple[str, str]) -> None:
        """Read the group at a path, and those above it: within a container its own is the uppermost."""
        folder = os.path.normpath(f"{base}/{path}")
        while folder.startswith(base):
            for line in lines(f"{folder}/{names[0]}"):
                limit = int(line) if line.strip().isdigit() else 0
                # Version 1 of control groups writes a huge number where there is no limit.
                if 0 < limit < 1 << 60 and (not self.limit or limit < self.limit):
                    self.limit = limit
            for line in lines(f"{folder}/{names[1]}"):
                name, _, count = line.partition(" ")
                self.kills += int(count) if name == "oom_kill" else 0
            folder = os.path.dirname(folder)


def lines(path: str) -> list[str]:
    """Read the lines of a file of the kernel; none where it is not there."""
    try:
        with open(path) as file:
            return list(file)
    except OSError:
        return []


def proportional(pid: int, resident: int) -> tuple[int, int]:
    """Measure a process in bytes, a shared page counted by its share: (memory of its own and of files, shared)."""
    try:
        with open(f"/proc/{pid}/smaps_rollup", "rb") as file:
            sizes = {words[0]: int(words[1]) << 10 for words in map(bytes.split, file) if words[0].endswith(b":")}
    except PermissionError:
        return resident, 0
    except (OSError, ValueError, IndexError):  # it has ended
        return 0, 0
    shared = sizes.get(b"Pss_Shmem:", 0)
    return sizes.get(b"Pss:", 0) + sizes.get(b"SwapPss:", 0) - shared, shared


def in_memory(pid: int, *, private: bool) -> dict[tuple[int, int], int]:
    """Find the files without a disk that a process has open, with their bytes; `private` leaves out /dev/shm."""
    files: dict[tuple[int, int], int] = {}
    folder = f"/proc/{pid}/fd"
    try:
        for name in os.listdir(folder):
            path = os.readlink(f"{folder}/{name}")
            if path.startswith("/memfd:") or (not private and path.startswith(SHARED_MEMORY)):
                at = os.stat(f"{folder}/{name}")
                files[at.st_dev, at.st_ino] = at.st_blocks * 512
    except OSError:  # it has ended, closed one, or is somebody else by now
        return files
    return files


def used(folder: str) -> int:
    """Return the bytes in use on the file system of a folder."""
    try:
        disk = os.statvfs(folder)
    except OSError:
        return 0
    return (disk.f_blocks - disk.f_bfree) * disk.f_frsize


def shared_pages() -> int:
    """Return the bytes of this machine's memory that shared memory and files without a disk take."""
    return next((int(line.split()[1]) << 10 for line in lines("/proc/meminfo") if line.startswith("Shmem:")), 0)


def killed_by_kernel() -> int:
    """Count the processes of this machine that the kernel has ended for want of memory since it was started."""
    return next((int(line.split()[1]) for line in lines("/proc/vmstat") if line.startswith("oom_kill ")), 0)
