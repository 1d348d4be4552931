"""Faults of this machine: disks that are full or read-only, several at once, little memory, clocks that jump."""

from __future__ import annotations

import os
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from benchmarks.faults import CommandResult, Desk, FaultResult, Unavailable, fault

DISKS, TOGETHER, BLAME = "disks and damaged files", "several at once", "whose fault"
HONEST = {"works", "inconclusive", "unavailable", "not_run"}
"""Verdicts that blame no package."""
CGROUPS = Path("/sys/fs/cgroup")


def mounted(folder: Path, *options: str) -> Path:
    """Mount a small disk of memory; it vanishes with the fault."""
    if os.geteuid() != 0 or os.getpid() != 1:
        msg = "mounts of its own (root)"
        raise Unavailable(msg)
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", ",".join(("mode=0777", *options)), "small", str(folder)], check=True)
    return folder


def remounted(folder: Path, *options: str) -> None:
    """Change the options of a small disk."""
    subprocess.run(["mount", "-o", ",".join(("remount", *options)), str(folder)], check=True)


def filled(folder: Path, left: int) -> Path:
    """Fill a small disk but for some bytes."""
    stat = os.statvfs(folder)
    file = folder / "ballast"
    with file.open("wb") as ballast:
        ballast.write(bytes(max(0, stat.f_bavail * stat.f_frsize - left)))
    return file


def crowded(folder: Path, left: int) -> Path:
    """Use up the inodes of a small disk but for some."""
    crowd = folder / "crowd"
    crowd.mkdir()
    for number in range(max(0, os.statvfs(folder).f_favail - left)):
        (crowd / str(number)).touch()
    return crowd


def verdicts(ran: CommandResult) -> dict[str, str]:
    """Return verdicts by `which`; none without a document."""
    if not ran.out.startswith("{"):
        return {}
    return {which: str(cell["verdict"]) for which, cell in ran.cells("which").items()}


def brief(ran: CommandResult) -> str:
    """Return how a run ended, in few words."""
    cell_verdicts = verdicts(ran)
    lines = [line for line in ran.err.splitlines() if line.startswith("simmatrix")]
    return f"exit {ran.code}, " + (", ".join(sorted(set(cell_verdicts.values()))) or (lines or ["no word"])[-1][:120])


def blames_nobody(ran: CommandResult) -> bool:
    """Tell whether a run ended with a sentence or a document that blames no package."""
    cell_verdicts = verdicts(ran)
    return ran.code in (0, 3) and set(cell_verdicts.values()) <= HONEST if cell_verdicts else ran.code in (2, 3)


def works(ran: CommandResult) -> bool:
    """Tell whether both cells work."""
    return ran.code == 0 and verdicts(ran) == {"hx": "works", "neighbour": "works"}


def check_recovery(
    desk: Desk, matrix: Path, tries: list[tuple[str, CommandResult]], mend: Callable[[], object]
) -> FaultResult:
    """Hold that no try blamed a package, and that all works once the trouble is gone."""
    mend()
    after = desk.measure(matrix)
    summary = "; ".join(f"{name}: {brief(ran)}" for name, ran in tries)
    return FaultResult(
        f"{summary}; mended: {brief(after)}", all(blames_nobody(ran) for _, ran in tries) and works(after)
    )


# --- disks -----------------------------------------------------------------------------------------------------


@fault("15", section=DISKS, done="HARNESS_STATE on a disk of 3 MB", promise="both cells work")
def small_state(desk: Desk) -> FaultResult:
    """Give results little room."""
    mounted(desk.state, "size=3m")
    ran = desk.measure(desk.hostile(checks=("single",)))
    return FaultResult(brief(ran), works(ran))


@fault(
    "16",
    section=DISKS,
    done="one cell is measured; then the disk of HARNESS_STATE is full with 200, 60, 20, 8, 0 KB left; then room again",
    promise="each time a document with the cell that was measured; the other is inconclusive or works; then both work",
    limit=300,
)
def full_state(desk: Desk) -> FaultResult:
    """Fill the disk of results between two runs."""
    matrix = desk.hostile(checks=("single",))
    mounted(desk.state, "size=24m")
    desk.measure(matrix, "-k", "*neighbour")
    tries, shown = [], True
    for left in (200, 60, 20, 8, 0):
        matrix = desk.hostile(checks=("single",), case=f"seed = {left}")  # so that it has to be measured again
        ballast = filled(desk.state, left << 10)
        ran = desk.measure(matrix)
        tries.append((f"{left} KB", ran))
        shown = shown and verdicts(ran).get("neighbour") == "works"
        ballast.unlink()
    came = check_recovery(desk, matrix, tries, lambda: None)
    return FaultResult(came.what, came.held and shown)


@fault(
    "16-table",
    section=DISKS,
    done="both cells are measured; then not a byte is left for HARNESS_STATE, and `run` prints its table",
    promise="the table of both cells, works, and a sentence that names the full disk",
)
def full_state_table(desk: Desk) -> FaultResult:
    """Print what was measured before from a full disk."""
    matrix = desk.hostile(checks=("single",))
    mounted(desk.state, "size=24m")
    desk.measure(matrix)
    filled(desk.state, 0)
    ran = desk.run("run", matrix)
    word = "No space left" in ran.err and ran.code == 3
    first, *_ = [*ran.out.strip().splitlines(), "nothing"]
    return FaultResult(
        f"exit {ran.code}, {first!r}, {ran.err.strip().splitlines()[-1:]}", ran.out.count("✔") >= 2 and word
    )


@fault(
    "17",
    section=DISKS,
    done="HARNESS_STATE without inodes: 60, 25, 12, 5, 0 left; then room again",
    promise="no package is blamed; then both work",
    limit=300,
)
def no_inodes(desk: Desk) -> FaultResult:
    """Use up the inodes of the disk of results."""
    matrix = desk.hostile(checks=("single",))
    mounted(desk.state, "size=24m", "nr_inodes=400")
    tries = []
    for left in (60, 25, 12, 5, 0):
        crowd = crowded(desk.state, left)
        tries.append((f"{left} inodes", desk.measure(matrix, "--fresh")))
        shutil.rmtree(crowd)
    return check_recovery(desk, matrix, tries, lambda: remounted(desk.state, "nr_inodes=20000"))


@fault(
    "18",
    section=DISKS,
    done="HARNESS_CACHE on a disk of 2, 30 and 60 MB; then of 800 MB",
    promise="no package is blamed; then both work",
    limit=300,
)
def small_cache(desk: Desk) -> FaultResult:
    """Give environments and wheels too little room."""
    matrix = desk.hostile(checks=("single",))
    mounted(desk.cache, "size=2m")
    tries = []
    for size in (2, 30, 60):
        remounted(desk.cache, f"size={size}m")
        tries.append((f"{size} MB", desk.measure(matrix)))
    return check_recovery(desk, matrix, tries, lambda: remounted(desk.cache, "size=800m"))


@fault(
    "18-inodes",
    section=DISKS,
    done="HARNESS_CACHE on a disk with 300 inodes, then 20,000",
    promise="no package is blamed; then both work",
    limit=240,
)
def cache_without_inodes(desk: Desk) -> FaultResult:
    """Give environments too few inodes."""
    matrix = desk.hostile(checks=("single",))
    mounted(desk.cache, "size=800m", "nr_inodes=300")
    tries = [("300 inodes", desk.measure(matrix))]
    return check_recovery(desk, matrix, tries, lambda: remounted(desk.cache, "nr_inodes=20000"))


@fault(
    "19",
    section=DISKS,
    done="TMPDIR on a disk of 16 KB, 100 KB, 1 MB; then of 200 MB",
    promise="no package is blamed; then both work",
    limit=300,
)
def small_scratch(desk: Desk) -> FaultResult:
    """Give scratch folders too little room."""
    matrix = desk.hostile(checks=("single",))
    mounted(desk.scratch, "size=16k")
    tries = []
    for size in (16, 100, 1024):
        remounted(desk.scratch, f"size={size}k")
        tries.append((f"{size} KB", desk.measure(matrix)))
    return check_recovery(desk, matrix, tries, lambda: remounted(desk.scratch, "size=200m"))


@fault(
    "19-filled",
    section=DISKS,
    done="a probe fills a TMPDIR of 50 MB and fails by it",
    promise="inconclusive with a line that names the disk; the neighbour works",
)
def probe_fills_scratch(desk: Desk) -> FaultResult:
    """Let a package fill the disk of TMPDIR."""
    step = "open(os.path.join(os.environ['TMPDIR'], 'much'), 'wb').write(bytes(80 << 20))"
    matrix = desk.hostile(checks=("single",), step=step)
    mounted(desk.scratch, "size=50m")
    return desk.check_verdicts(desk.measure(matrix, "-j", "1"), hx={"inconclusive"}, neighbour={"works"}, says="TMPDIR")


@fault(
    "20",
    section=DISKS,
    done="state, cache or TMPDIR is read-only, one after the other; then writable",
    promise="no package is blamed; then both work",
    limit=240,
)
def read_only(desk: Desk) -> FaultResult:
    """Take the right to write away from each folder."""
    matrix = desk.hostile(checks=("single",))
    tries = []
    for name, folder in (("state", desk.state), ("cache", desk.cache), ("TMPDIR", desk.scratch)):
        mounted(folder, "size=400m", "ro")
        tries.append((name, desk.measure(matrix)))
        subprocess.run(["umount", "-l", str(folder)], check=True)
    return check_recovery(desk, matrix, tries, lambda: None)


@fault(
    "20-warm",
    section=DISKS,
    done="a cache with all that is needed becomes read-only, and everything is measured again",
    promise="both cells work",
)
def read_only_warm_cache(desk: Desk) -> FaultResult:
    """Measure from a cache that somebody else fills."""
    matrix = desk.hostile(checks=("single",))
    mounted(desk.cache, "size=800m")
    desk.measure(matrix)
    remounted(desk.cache, "ro")
    ran = desk.measure(matrix, "--fresh")
    lines = {cell["decisive"] for cell in ran.cells("which").values()} if ran.out.startswith("{") else set()
    return FaultResult(f"{brief(ran)} {lines or ''}", works(ran))


@fault("21", section=DISKS, done="HARNESS_STATE is a file", promise="exit 2 or 3 with a sentence that names it")
def state_is_a_file(desk: Desk) -> FaultResult:
    """Name a file where a folder is expected."""
    (desk.folder / "file").write_text("")
    ran = desk.measure(desk.hostile(checks=("single",)), HARNESS_STATE=str(desk.folder / "file"))
    return FaultResult(brief(ran), ran.code in (2, 3) and "file" in ran.err)


# --- several at once -------------------------------------------------------------------------------------------


@fault(
    "118",
    section=TOGETHER,
    done="four processes run one matrix with one store and one empty cache at once",
    promise="all have the same verdicts: both work",
    limit=240,
)
def four_at_once(desk: Desk) -> FaultResult:
    """Run the same four times at once."""
    matrix = desk.hostile(checks=("single",))
    rans: list[CommandResult] = []
    threads = [threading.Thread(target=lambda: rans.append(desk.measure(matrix))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return FaultResult("; ".join(map(brief, rans)), len(rans) == 4 and all(map(works, rans)))


@fault(
    "119",
    section=TOGETHER,
    done="`gc --older-than 0 --max-size 1MB` removes what it can, six times while a matrix is measured with --fresh",
    promise="both work, and `gc` ends with 0",
    limit=240,
)
def collected_meanwhile(desk: Desk) -> FaultResult:
    """Collect garbage under a run."""
    matrix = desk.hostile(checks=("single",))
    desk.measure(matrix)
    with desk.started("run", matrix, "--json", "--fresh") as process:
        codes = [desk.run("gc", "--older-than", "0", "--max-size", "1MB").code for _ in range(6)]
        out, err = process.communicate(timeout=120)
    ran = CommandResult(code=process.returncode, out=out, err=err)
    return FaultResult(f"{brief(ran)}; gc: {codes}", works(ran) and set(codes) == {0})


def meanwhile(desk: Desk, remove: Callable[[], object], when: Callable[[], bool]) -> FaultResult:
    """Do something in the middle of a run; then run again."""
    matrix = desk.hostile(checks=("single",), step="time.sleep(0.05)")
    with desk.started("run", matrix, "--json") as process:
        deadline = time.monotonic() + 60
        while not when() and time.monotonic() < deadline and process.poll() is None:
            time.sleep(0.02)
        caught = process.poll() is None
        remove()
        out, err = process.communicate(timeout=150)
    desk.ran.append(CommandResult(code=process.returncode, out=out, err=err))
    came = check_recovery(desk, matrix, [("removed", desk.ran[-1])], lambda: None)
    return FaultResult(came.what, came.held and caught)


def gone(*folders: Path) -> None:
    """Remove folders, whatever is being written there."""
    for folder in folders:
        subprocess.run(["rm", "-rf", str(folder)], check=False)


@fault(
    "120",
    section=TOGETHER,
    done="all environments are removed while a probe runs in one",
    promise="no package is blamed; then both work",
    limit=240,
)
def environments_removed(desk: Desk) -> FaultResult:
    """Take environments away."""
    folder = desk.cache / "environments"
    return meanwhile(desk, lambda: gone(*folder.iterdir()), lambda: folder.is_dir() and probing(desk))


@fault(
    "121",
    section=TOGETHER,
    done="HARNESS_STATE is removed while a probe runs",
    promise="no package is blamed; then both work",
    limit=240,
)
def state_removed(desk: Desk) -> FaultResult:
    """Take the results away."""
    return meanwhile(desk, lambda: gone(desk.state), lambda: probing(desk))


@fault(
    "122",
    section=TOGETHER,
    done="TMPDIR is removed while a probe runs, as systemd-tmpfiles does",
    promise="no package is blamed; then both work",
    limit=240,
)
def scratch_removed(desk: Desk) -> FaultResult:
    """Take the scratch folders away."""
    return meanwhile(desk, lambda: gone(*desk.scratch.iterdir()), lambda: probing(desk))


def probing(desk: Desk) -> bool:
    """Tell whether a probe is being run."""
    return any("reply.jsonl" in files for _, _, files in os.walk(desk.scratch))


# --- whose fault -----------------------------------------------------------------------------------------------


@fault(
    "128",
    section=BLAME,
    done="/dev/shm of 64 KB, and then read-only, with the sandbox that has none of its own",
    promise="no package is blamed",
    limit=240,
)
def little_shared_memory(desk: Desk) -> FaultResult:
    """Take shared memory away from worker processes."""
    desk = desk.with_variables(HARNESS_SANDBOX="subreaper")
    matrix = desk.hostile(checks=("single", "vector"))
    mounted(Path("/dev/shm"), "size=64k")
    tries = [("64 KB", desk.measure(matrix))]
    remounted(Path("/dev/shm"), "ro")
    tries.append(("read-only", desk.measure(matrix, "--fresh")))
    return check_recovery(desk, matrix, tries, lambda: remounted(Path("/dev/shm"), "rw", "size=200m"))


@contextmanager
def limited(controller: str, names: tuple[str, ...], most: str) -> Iterator[Path]:
    """Make a control group in which one of these files (of version 2, or 1) holds a limit."""
    parent = CGROUPS if (CGROUPS / "cgroup.controllers").exists() else CGROUPS / controller
    group = parent / f"fault-{time.monotonic_ns()}"
    try:
        group.mkdir()
        (file,) = (group / name for name in names if (group / name).exists())
        file.write_text(most)
    except (OSError, ValueError):
        if group.is_dir():
            group.rmdir()
        msg = "a control group of its own"
        raise Unavailable(msg) from None
    try:
        yield group
    finally:
        deadline = time.monotonic() + 10
        while group.is_dir() and time.monotonic() < deadline:
            with suppress(OSError):
                group.rmdir()
            time.sleep(0.1)


def within(desk: Desk, group: Path) -> Desk:
    """Return the desk whose commands run in a control group."""
    return desk.under("sh", "-c", f'echo 0 > {group}/cgroup.procs && exec "$@"', "sh")


@fault(
    "129",
    section=BLAME,
    done="a control group allows 300, 150, 90 and 50 MB of memory; then no group",
    promise="no package is blamed; then both work",
    limit=400,
)
def little_memory(desk: Desk) -> FaultResult:
    """Give the harness and its probes little memory."""
    matrix = desk.hostile(checks=("single",))
    tries = []
    for most in (300, 150, 90, 50):
        with limited("memory", ("memory.max", "memory.limit_in_bytes"), f"{most}M") as group:
            ran = within(desk, group).measure(matrix, "--fresh", "-j", "1")
        killed = ran.code in (-9, 137)  # the harness itself: nothing can be printed then
        tries.append(
            (f"{most} MB" + " (ended by the kernel)" * killed, CommandResult(code=3, out="", err="") if killed else ran)
        )
    return check_recovery(desk, matrix, tries, lambda: None)


@fault(
    "131",
    section=BLAME,
    done="a control group allows 40, 12 and 6 processes; then no group",
    promise="no package is blamed; then both work",
    limit=300,
)
def few_processes(desk: Desk) -> FaultResult:
    """Allow few processes."""
    matrix = desk.hostile(checks=("single",))
    tries = []
    for most in (40, 12, 6):
        with limited("pids", ("pids.max",), str(most)) as group:
            tries.append((f"{most} processes", within(desk, group).measure(matrix, "--fresh", "-j", "1")))
    return check_recovery(desk, matrix, tries, lambda: None)


@fault(
    "132",
    section=BLAME,
    done="ulimit: 40 open files, 20 open files, files of 64 KB, a stack of 256 KB; umask 777; no HOME; TZ of nonsense",
    promise="no package is blamed; then both work",
    limit=400,
)
def small_limits(desk: Desk) -> FaultResult:
    """Start under limits of the shell."""
    matrix = desk.hostile(checks=("single",))
    tries = [
        (said, desk.under("prlimit", *limits).measure(matrix, "--fresh"))
        for said, limits in {
            "40 files": ("--nofile=40:40",),
            "20 files": ("--nofile=20:20",),
            "files of 64 KB": ("--fsize=65536:65536",),
            "stack of 256 KB": ("--stack=262144:262144",),
        }.items()
    ]
    tries.append(("umask", desk.under("sh", "-c", 'umask 777; exec "$@"', "sh").measure(matrix, "--fresh")))
    tries.append(("no HOME", desk.under("env", "-u", "HOME").measure(matrix, "--fresh")))
    tries.append(("TZ", desk.measure(matrix, "--fresh", TZ="Mars/Olympus")))
    return check_recovery(
        desk, matrix, tries, lambda: subprocess.run(["chmod", "-R", "u+rwX", str(desk.folder)], check=False)
    )


def faked() -> str:
    """Return the library that makes clocks jump."""
    libraries = [*Path("/usr/lib").glob("*/faketime/libfaketime.so.1")]
    if not libraries:
        msg = "libfaketime (Debian's package of this name)"
        raise Unavailable(msg)
    return str(libraries[0])


@fault(
    "133",
    section=BLAME,
    done="the clock is ten years ahead, ten years behind, and runs 50 times too fast during a run; then right again",
    promise="no package is blamed; then both work, and nothing that was measured is lost",
    limit=400,
)
def clock_jumps(desk: Desk) -> FaultResult:
    """Run under other clocks than the one before."""
    matrix = desk.hostile(checks=("single",))
    library = faked()
    first = desk.measure(matrix)
    tries = [
        (said, desk.measure(matrix, "--fresh", LD_PRELOAD=library, FAKETIME=shift, DONT_FAKE_MONOTONIC="1"))
        for said, shift in {"+10 years": "+10y", "-10 years": "-10y", "50 times as fast": "+0 x50"}.items()
    ]
    came = check_recovery(desk, matrix, tries, lambda: None)
    return FaultResult(came.what, came.held and works(first))


STEPPING = """
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t clock, struct timespec *now) {
    struct timespec steady;
    int failed = syscall(SYS_clock_gettime, clock, now);
    syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &steady);
    if (!failed && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
        now->tv_sec += (steady.tv_sec * 5 + steady.tv_nsec / 200000000) % 2 ? 86400 : -3600;
    return failed;
}
int gettimeofday(struct timeval *now, void *zone) {
    struct timespec exact;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &exact);
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return 0;
}
time_t time(time_t *now) {
    struct timespec exact;
    clock_gettime(CLOCK_REALTIME, &exact);
    if (now) *now = exact.tv_sec;
    return exact.tv_sec;
}
"""
"""A clock that steps five times a second, a day ahead and an hour back by turns."""


@fault(
    "133-steps",
    section=BLAME,
    done="the clock of the harness steps a day ahead and an hour back, five times a second, while cells are measured",
    promise="both work, here and when they are run again under the right clock",
    limit=240,
)
def clock_steps(desk: Desk) -> FaultResult:
    """Step the clock in the middle of a run."""
    library, source = desk.folder / "stepping.so", desk.folder / "stepping.c"
    source.write_text(STEPPING, encoding="utf-8")
    compiler = shutil.which("cc")
    if compiler is None:
        msg = "a C compiler"
        raise Unavailable(msg)
    subprocess.run([compiler, "-shared", "-fPIC", "-o", str(library), str(source)], check=True)
    matrix = desk.hostile(checks=("single",), step="time.sleep(0.02)")
    ran = desk.measure(matrix, LD_PRELOAD=str(library))
    came = check_recovery(desk, matrix, [("stepping", ran)], lambda: None)
    return FaultResult(came.what, came.held and works(ran))
