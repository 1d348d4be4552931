"""Memory: what is left of it, and how many probes that is enough for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from harness.machine import capacity
from harness.machine.capacity import Reading, default_jobs
from harness.running.scheduler.admission import Room

MEMINFO = "MemTotal:       16000000 kB\nMemFree:         1000000 kB\nMemAvailable:    8388608 kB\n"


def tree(root: Path, files: dict[str, str]) -> Path:
    """Write these files below a folder; return the folder."""
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


@pytest.mark.parametrize(
    ("files", "free"),
    [
        ({}, None),
        ({"proc/meminfo": MEMINFO}, 8192),
        (
            {
                "proc/meminfo": MEMINFO,
                "proc/self/cgroup": "0::/a/b\n",
                "sys/fs/cgroup/a/b/memory.max": "max\n",
                "sys/fs/cgroup/a/b/memory.current": "1000\n",
                "sys/fs/cgroup/a/memory.max": f"{4 << 30}\n",
                "sys/fs/cgroup/a/memory.current": f"{3 << 30}\n",
                "sys/fs/cgroup/a/memory.stat": f"anon 1\ninactive_file {1 << 29}\n",
            },
            1536,
        ),
        (
            {
                "proc/meminfo": MEMINFO,
                "proc/self/cgroup": "3:cpu:/x\n2:memory:/x\n",
                "sys/fs/cgroup/memory/memory.limit_in_bytes": f"{2 << 30}\n",
                "sys/fs/cgroup/memory/memory.usage_in_bytes": f"{1 << 30}\n",
            },
            1024,
        ),
        (
            {
                "proc/meminfo": MEMINFO,
                "proc/self/cgroup": "0::/\n",
                "sys/fs/cgroup/memory.max": "1000\n",
                "sys/fs/cgroup/memory.current": "5000\n",
            },
            0,
        ),
    ],
    ids=["unknown", "machine", "group-above", "version-1", "overdrawn"],
)
def test_free_memory(tmp_path: Path, files: dict[str, str], free: int | None) -> None:
    """The least that the machine and each control group leave, file cache not counted as taken."""
    assert capacity.free_mb(tree(tmp_path, files)) == free


@pytest.mark.parametrize(
    ("free", "held", "needed", "admitted", "admits"),
    [
        (100, (), 2000, [], True),
        (5000, (0,), 2000, [2000], True),
        (4000, (0,), 2000, [2000], False),
        (2500, (1900,), 2000, [2000], True),
        (2000, (2000,), 2000, [2000], False),
        (9000, (5000, 0), 2000, [2000, 2000, 2000], False),
        (3000, (5000, 0), 2000, [2000, 2000], False),
        (4500, (5000, 0), 2000, [2000, 2000], True),
        (None, (), 2000, [2000], True),
    ],
    ids=["first", "enough", "spoken-for", "taken-already", "none-left", "no-slot", "one-beyond", "both", "unknown"],
)
def test_admission(free: int | None, held: tuple[int, ...], needed: int, admitted: list[int], admits: bool) -> None:
    """A probe starts beside others if what they may still take leaves enough; one is always let in."""
    room = Room(3, lambda: Reading(free_mb=free, held_mb=held))
    assert room.admits(needed, admitted) is admits


def test_without_auto_memory_is_nobodys_business() -> None:
    """A user who names a number of cells gets it, whatever the memory."""
    assert Room(2, None).admits(10**6, [10**6])
    assert not Room(1, None).admits(1, [1])


@pytest.mark.parametrize(("given", "jobs"), [("1", 1), ("4096", None), ("0", 1), ("", None), ("many", None)])
def test_a_task_of_slurm_has_part_of_the_cores(monkeypatch: pytest.MonkeyPatch, given: str, jobs: int | None) -> None:
    """SLURM_CPUS_PER_TASK limits the jobs even if the cluster does not, and never exceeds the cores there are."""
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", given)

    assert default_jobs() == (jobs or len(os.sched_getaffinity(0)))
