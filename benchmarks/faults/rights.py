"""Secrets, rights, memory and leftovers: what a probe or a build may read, take away, use up and leave behind."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from benchmarks.faults import Desk, FaultResult, Unavailable, fault
from benchmarks.faults.processes import sdist_matrix

PROBES, BUILDS, MACHINE = "hostile probes", "wheels and builds", "whose fault"
CANARY = "canary-of-the-caller"
LOOK = """
word = "canary-" + "of-the-caller"
for name in ("environ", "cmdline"):
    for path in glob.glob("/proc/[0-9]*/" + name):
        try:
            with open(path, "rb") as file:
                assert word.encode() not in file.read(), "seen in " + path
        except OSError:
            continue
assert word not in str(os.environ), "in os.environ"
"""
DESCRIPTORS = """
paths = ["/proc/self/fd/" + fd for fd in os.listdir("/proc/self/fd")]
held = [os.readlink(path) for path in paths if os.path.exists(path)]
foreign = [path for path in held if not path.startswith(("/dev/null", "pipe:", "/proc/", "anon_inode:"))
    and "/reply/" not in path]
assert not foreign, "inherited " + ", ".join(foreign)
"""
LIBC = "import ctypes\nlibc = ctypes.CDLL(None, use_errno=True)"


def looked(desk: Desk, sandbox: str = "") -> FaultResult:
    """Look for a token of the caller wherever a probe can look; it fails where it finds one."""
    matrix = desk.hostile(checks=("single",), step=LOOK)
    ran = desk.measure(matrix, TOKEN=CANARY, HARNESS_SANDBOX=sandbox)
    return desk.check_verdicts(ran, code={0}, hx={"works"}, neighbour={"works"})


for row, sandbox, nobody in (
    ("65", "", False),
    ("65n", "", True),
    ("65s", "subreaper", False),
    ("65x", "subreaper", True),
):

    def look(desk: Desk, sandbox: str = sandbox, nobody: bool = nobody) -> FaultResult:
        """Look for a token."""
        return looked(desk.as_nobody() if nobody else desk, sandbox)

    look.__name__ = f"variables{'_of_nobody' if nobody else ''}{'_subreaper' if sandbox else ''}"
    fault(
        row,
        section=PROBES,
        done="a probe searches all of /proc for a token of the caller's environment"
        + (", as an ordinary user" if nobody else ", as root")
        + (", HARNESS_SANDBOX=subreaper" if sandbox else ""),
        promise="it is nowhere to be seen",
    )(look)


@fault(
    "66", section=BUILDS, done="a build searches all of /proc for a token of the caller", promise="nowhere to be seen"
)
def build_looks(desk: Desk) -> FaultResult:
    """Look for a token in a build."""
    matrix = sdist_matrix(desk, "import glob\n" + LOOK)
    return desk.check_verdicts(desk.measure(matrix, TOKEN=CANARY), code={0}, hx={"works"}, neighbour={"works"})


@fault(
    "66s",
    section=BUILDS,
    done="a build searches all of /proc for a token of the caller, HARNESS_SANDBOX=subreaper",
    promise="nowhere to be seen",
)
def build_looks_subreaper(desk: Desk) -> FaultResult:
    """Look for a token in a build without namespaces."""
    matrix = sdist_matrix(desk, "import glob\n" + LOOK)
    ran = desk.measure(matrix, TOKEN=CANARY, HARNESS_SANDBOX="subreaper")
    return desk.check_verdicts(ran, code={0}, hx={"works"}, neighbour={"works"})


@fault("65d", section=PROBES, done="a probe lists its descriptors", promise="it has inherited none but its output")
def descriptors(desk: Desk) -> FaultResult:
    """Look for inherited descriptors."""
    ran = desk.measure(desk.hostile(checks=("single",), top=DESCRIPTORS))
    return desk.check_verdicts(ran, code={0}, hx={"works"}, neighbour={"works"})


@fault("67", section=PROBES, done="a probe, as root, unmounts /proc to see the machine's", promise="refused")
def unmount_proc(desk: Desk) -> FaultResult:
    """Take /proc away."""
    step = "assert libc.umount2(b'/proc', 2) == -1, 'unmounted'\nassert len(glob.glob('/proc/[0-9]*')) < 5"
    ran = desk.measure(desk.hostile(checks=("single",), top=LIBC, step=step))
    return desk.check_verdicts(ran, code={0}, hx={"works"}, neighbour={"works"})


def unsealed(desk: Desk, sandbox: str = "") -> FaultResult:
    """Take the layer over the environment away and write below it: the real one stays as it is."""
    top = f"""
{LIBC}
import fake_healthy
environment = sys.prefix
left = libc.umount2(environment.encode(), 2)
for path in (environment + "/pwned", fake_healthy.__file__):
    try:
        with open(path, "a") as file:
            file.write("# pwned\\n")
    except OSError:
        pass
"""
    ran = desk.measure(desk.hostile(checks=("single",), top=top), HARNESS_SANDBOX=sandbox)
    changed_files = [path for path in desk.cache.rglob("*") if path.name == "pwned"]
    changed_files += [path for path in desk.cache.rglob("fake_healthy.py") if "pwned" in path.read_text()]
    came = desk.check_verdicts(ran, hx={"works"}, neighbour={"works"})
    return FaultResult(f"{came.what}; {len(changed_files)} files of the cache changed", came.held and not changed_files)


@fault(
    "68", section=PROBES, done="a probe, as root, unmounts the sealed layer and writes", promise="the cache stays whole"
)
def unmount_layer(desk: Desk) -> FaultResult:
    """Take the layer away as root."""
    return unsealed(desk)


@fault(
    "68n",
    section=PROBES,
    done="a probe, as nobody, unmounts the sealed layer and writes",
    promise="the cache stays whole",
)
def unmount_layer_of_nobody(desk: Desk) -> FaultResult:
    """Take the layer away without privileges."""
    return unsealed(desk.as_nobody())


@fault(
    "68r",
    section=PROBES,
    done="a probe remounts, unshares and mounts: whatever gives a capability back",
    promise="no capability that reaches the machine comes back",
)
def regain(desk: Desk) -> FaultResult:
    """Ask for rights again."""
    step = """
with open("/proc/self/status") as file:
    held = {line.split(":")[0]: line.split()[1] for line in file if line.startswith(("Cap", "NoNew"))}
assert held["NoNewPrivs"] == "1" and not int(held["CapEff"], 16) >> 21 & 1, str(held)
assert not int(held["CapBnd"], 16) >> 19 & 1, str(held)
assert libc.mount(b"none", b"/proc", b"tmpfs", 0, b"") == -1
"""
    ran = desk.measure(desk.hostile(checks=("single",), top=LIBC, step=step))
    return desk.check_verdicts(ran, code={0}, hx={"works"}, neighbour={"works"})


@fault("75", section=PROBES, done="a probe, as root, writes garbage into the descriptors of pid 1", promise="refused")
def pipe_of_the_keeper(desk: Desk) -> FaultResult:
    """Write into the keeper's pipes."""
    step = """
import marshal
for number in range(3, 20):
    try:
        with open("/proc/1/fd/%d" % number, "wb", buffering=0) as file:
            file.write(marshal.dumps({"killed": None, "exit_code": 0}) + b"garbage")
        print("written", number)
    except OSError:
        continue
"""
    ran = desk.measure(desk.hostile(checks=("single",), step=step))
    return desk.check_verdicts(ran, code={0}, hx={"works"}, neighbour={"works"})


OBJECTS = f"""
{LIBC}
shared, queue, semaphores = libc.shmget(0, 4096, 0o1666), libc.msgget(0, 0o1666), libc.semget(0, 1, 0o1666)
assert min(shared, queue, semaphores) >= 0
libc.semctl(semaphores, 0, 16, ctypes.c_int(1))
assert libc.msgsnd(queue, ctypes.create_string_buffer((1).to_bytes(8, "little") + b"x"), 1, 0) == 0
"""


def objects() -> set[str]:
    """Return every System V object, by kind and number."""
    kinds = ("shm", "msg", "sem")
    return {kind + row.split()[1] for kind in kinds for row in Path("/proc/sysvipc", kind).read_text().splitlines()}


def left_objects(desk: Desk, sandbox: str = "", **variables: str) -> FaultResult:
    """Leave System V objects: none is there after the run."""
    before = objects()
    more = f"environment = {{ DISPLAY = {variables.pop('display')!r} }}" if "display" in variables else ""
    matrix = desk.hostile(checks=("single",), top=OBJECTS, more=more)
    came = desk.check_verdicts(desk.measure(matrix, HARNESS_SANDBOX=sandbox), hx={"works"}, neighbour={"works"})
    left = objects() - before
    return FaultResult(f"{came.what}; {len(left)} objects left", came.held and not left)


@fault(
    "60", section=PROBES, done="System V shared memory, semaphores, a queue are made", promise="they end with the probe"
)
def system_v(desk: Desk) -> FaultResult:
    """Leave System V objects."""
    return left_objects(desk)


@fault(
    "60s",
    section=PROBES,
    done="System V shared memory, semaphores, a queue are made and used, HARNESS_SANDBOX=subreaper",
    promise="they end with the probe",
)
def system_v_subreaper(desk: Desk) -> FaultResult:
    """Leave System V objects where there are no namespaces."""
    return left_objects(desk, "subreaper")


@fault(
    "60d",
    section=PROBES,
    done="System V objects are made by a probe with a display, which shares them with the X server",
    promise="they end with the probe",
)
def system_v_display(desk: Desk) -> FaultResult:
    """Leave System V objects with a display."""
    return left_objects(desk, display=":99")


def hungry(desk: Desk, deed: str, verdicts: set[str], says: str = "", sandbox: str = "") -> FaultResult:
    """Take memory in one way or another, with `memory_mb = 400`."""
    matrix = desk.hostile(checks=("single",), step=deed, case="memory_mb = 400, timeouts = { single = 20 }")
    ran = desk.measure(matrix, HARNESS_SANDBOX=sandbox)
    return desk.check_verdicts(ran, hx=verdicts, neighbour={"works"}, says=says)


MEMFD = """
hog = os.memfd_create("hog")
for _ in range(90):
    os.write(hog, b"x" * (10 << 20))
time.sleep(3)
"""
TOO_MUCH = "`memory_mb` of the case raises that"


@fault(
    "61",
    section=PROBES,
    done="/dev/shm is filled with 1 GB, `memory_mb = 400`",
    promise="`inconclusive`, within bounds",
)
def fill_shared_memory(desk: Desk) -> FaultResult:
    """Fill /dev/shm."""
    deed = "with open('/dev/shm/hog', 'wb') as file:\n    for _ in range(100): file.write(bytes(10 << 20))"
    return hungry(desk, deed, {"inconclusive"})


@fault("62", section=PROBES, done="900 MB in a memfd, `memory_mb = 400`", promise="ended, with the key that raises it")
def memfd(desk: Desk) -> FaultResult:
    """Take memory without a page of one's own."""
    return hungry(desk, MEMFD, {"inconclusive"}, TOO_MUCH)


@fault(
    "62s",
    section=PROBES,
    done="900 MB in a memfd, `memory_mb = 400`, HARNESS_SANDBOX=subreaper",
    promise="ended, with the key that raises it",
)
def memfd_subreaper(desk: Desk) -> FaultResult:
    """Take memory without a page of one's own, where there are no namespaces."""
    return hungry(desk, MEMFD, {"inconclusive"}, TOO_MUCH, "subreaper")


@fault("63", section=PROBES, done="900 MB on the heap, `memory_mb = 400`", promise="ended, with the key that raises it")
def heap(desk: Desk) -> FaultResult:
    """Take memory."""
    return hungry(desk, "hog = bytearray(b'x') * (900 << 20); time.sleep(3)", {"inconclusive"}, TOO_MUCH)


@fault("62r", section=PROBES, done="64 GB of addresses are reserved, `memory_mb = 400`", promise="`works`")
def reserve(desk: Desk) -> FaultResult:
    """Reserve addresses without using them."""
    deed = "import mmap; mmap.mmap(-1, 64 << 30, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | 0x4000).close()"
    return hungry(desk, deed, {"works"})


@fault(
    "76", section=PROBES, done="RLIMIT_FSIZE of 10 bytes is set by the package", promise="its own doing, never `works`"
)
def limit_files(desk: Desk) -> FaultResult:
    """Forbid oneself to write."""
    top = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))"
    ran = desk.measure(desk.hostile(checks=("single",), top=top))
    return desk.check_verdicts(ran, hx={"import_fails", "broken", "inconclusive"}, neighbour={"works"})


@fault(
    "77",
    section=PROBES,
    done="a package raises RuntimeError('No space left on device in the buffer') with room on every disk",
    promise="its own failure: `broken`",
)
def full_buffer(desk: Desk) -> FaultResult:
    """Speak of a full disk."""
    ran = desk.measure(
        desk.hostile(checks=("single",), step="raise RuntimeError('No space left on device in the buffer')")
    )
    return desk.check_verdicts(ran, code={1}, hx={"broken"}, neighbour={"works"})


@fault(
    "77e",
    section=PROBES,
    done="a package raises OSError(ENOSPC) itself",
    promise="`inconclusive`: it cannot be told from a call that failed",
)
def made_up_errno(desk: Desk) -> FaultResult:
    """Raise what the system raises."""
    ran = desk.measure(desk.hostile(checks=("single",), step="raise OSError(28, os.strerror(28))"))
    return desk.check_verdicts(ran, code={3}, hx={"inconclusive"}, neighbour={"works"})


@fault(
    "77b",
    section=BUILDS,
    done="a build prints 'Read-only file system' and fails by something else",
    promise="its own failure: `uninstallable`",
)
def build_mentions(desk: Desk) -> FaultResult:
    """Mention a trouble of the machine in a build."""
    deed = "print('warning: Read-only file system, no cache', flush=True)\nraise ValueError('no such header')"
    ran = desk.measure(sdist_matrix(desk, deed))
    return desk.check_verdicts(ran, code={1}, hx={"uninstallable"}, neighbour={"works"})


USES_SHM = """
import multiprocessing, multiprocessing.shared_memory
lock = multiprocessing.Lock()
block = multiprocessing.shared_memory.SharedMemory(create=True, size=4096)
block.close()
block.unlink()
"""


def without_shm(desk: Desk, verdicts: set[str], sandbox: str = "") -> FaultResult:
    """Measure on a machine whose /dev has no `shm`."""
    hidden = desk.folder / "dev"
    hidden.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "none", str(hidden)], check=True)
    for name in ("null", "zero", "full", "random", "urandom", "tty"):
        subprocess.run(["cp", "-a", f"/dev/{name}", str(hidden)], check=True)
    subprocess.run(["mount", "--move", str(hidden), "/dev"], check=True)
    matrix = desk.hostile(checks=("single",), step=USES_SHM)
    came = desk.check_verdicts(desk.measure(matrix, HARNESS_SANDBOX=sandbox), hx=verdicts, neighbour={"works"})
    return FaultResult(
        f"{came.what}; /dev has {len(list(Path('/dev').iterdir()))} entries",
        came.held and not Path("/dev/shm").exists(),
    )


def needs_root() -> None:
    """Refuse a fault that mounts where that is not allowed."""
    if os.geteuid() != 0:
        msg = "root, who may mount"
        raise Unavailable(msg)


@fault("127", section=MACHINE, done="/dev/shm is missing", promise="the probe has one all the same: `works`")
def no_shared_memory(desk: Desk) -> FaultResult:
    """Hide /dev/shm."""
    needs_root()
    return without_shm(desk, {"works"})


@fault(
    "127s",
    section=MACHINE,
    done="/dev/shm is missing, HARNESS_SANDBOX=subreaper",
    promise="`inconclusive`, the package is not blamed",
)
def no_shared_memory_subreaper(desk: Desk) -> FaultResult:
    """Hide /dev/shm where no namespace supplies one."""
    needs_root()
    return without_shm(desk, {"inconclusive"}, "subreaper")


@fault(
    "128r",
    section=MACHINE,
    done="/dev/shm is read-only, HARNESS_SANDBOX=subreaper",
    promise="`inconclusive` or `works`",
)
def read_only_shared_memory(desk: Desk) -> FaultResult:
    """Let nobody write to /dev/shm."""
    needs_root()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "none", "/dev/shm"], check=True)
    matrix = desk.hostile(checks=("single",), step=USES_SHM)
    ran = desk.measure(matrix, HARNESS_SANDBOX="subreaper")
    return desk.check_verdicts(ran, hx={"inconclusive", "works"}, neighbour={"works"})


def group(kind: str, limit: str, value: str) -> Path:
    """Make a control group with a limit and return its folder; version 1 or 2."""
    needs_root()
    base = Path("/sys/fs/cgroup", kind)
    if not base.is_dir():
        msg = f"control groups of version 1 with {kind}"
        raise Unavailable(msg)
    folder = base / f"fault-{os.getpid()}-{kind}-{value}"
    try:
        folder.mkdir()
        (folder / limit).write_text(value)
    except OSError as error:
        msg = f"a control group of one's own ({error.strerror})"
        raise Unavailable(msg) from None
    return folder


def grouped(desk: Desk, folder: Path, verdicts: set[str], step: str = "pass", says: str = "") -> FaultResult:
    """Measure within a control group."""
    enter = ("sh", "-c", f'echo $$ > {folder}/cgroup.procs && exec "$@"', "sh")
    matrix = desk.hostile(checks=("single",), step=step)
    desk.measure(matrix, "--until", "install")
    try:
        return desk.check_verdicts(desk.under(*enter).measure(matrix, "-j", "1"), hx=verdicts, says=says)
    finally:
        subprocess.run(["rmdir", str(folder)], check=False)


@fault(
    "130",
    section=MACHINE,
    done="the harness runs in a control group of 200 MB, a probe takes 400 MB of the 6,000 MB that it may",
    promise="`inconclusive`, and the line names the control group, not `memory_mb`",
    limit=240,
)
def small_group(desk: Desk) -> FaultResult:
    """Run where the control group is the limit."""
    folder = group("memory", "memory.limit_in_bytes", str(200 << 20))
    return grouped(desk, folder, {"inconclusive"}, "hog = bytearray(b'x') * (400 << 20)", "control group")


@fault("129g", section=MACHINE, done="a memory control group of 200 MB", promise="`works`", limit=240)
def enough_in_the_group(desk: Desk) -> FaultResult:
    """Run where there is just enough."""
    return grouped(desk, group("memory", "memory.limit_in_bytes", str(200 << 20)), {"works"})


@fault("131g", section=MACHINE, done="a pids control group of 8", promise="`inconclusive` or `works`, nobody is blamed")
def few_processes(desk: Desk) -> FaultResult:
    """Run where hardly a process may be started."""
    return grouped(desk, group("pids", "pids.max", "8"), {"inconclusive", "works"})


LIMITS = {"n": "--nofile=40", "cpu": "--cpu=60", "nproc": "--nproc=4096", "fsize": "--fsize=100000000"}


@fault("132u", section=MACHINE, done="ulimits on files, time, processes, sizes", promise="the same verdicts", limit=300)
def limits(desk: Desk) -> FaultResult:
    """Run under limits, one after the other."""
    matrix, results = desk.hostile(checks=("single",)), []
    for name, option in LIMITS.items():
        came = desk.check_verdicts(
            desk.under("prlimit", option).measure(matrix, "--fresh"), hx={"works"}, neighbour={"works"}
        )
        results.append((name, came))
    return FaultResult(
        "; ".join(f"{name}: {came.what}" for name, came in results), all(came.held for _, came in results)
    )


@fault("132h", section=MACHINE, done="env -i with nothing but PATH, without HOME", promise="the same verdicts")
def no_home(desk: Desk) -> FaultResult:
    """Run with an almost empty environment."""
    matrix = desk.hostile(checks=("single",))
    bare = desk.under("env", "-i", f"PATH={os.environ['PATH']}", f"TMPDIR={desk.scratch}", "HARNESS_CONTROLS=")
    return desk.check_verdicts(bare.measure(matrix), code={0}, hx={"works"}, neighbour={"works"})


@fault(
    "132c",
    section=MACHINE,
    done="root without CAP_SYS_ADMIN, as in a plain container",
    promise="another sandbox is taken: `works`",
)
def plain_container(desk: Desk) -> FaultResult:
    """Run as root that may mount nothing."""
    needs_root()
    dropped = "-sys_admin,-sys_ptrace,-setpcap,-setfcap"
    words = ("setpriv", f"--bounding-set={dropped}", f"--inh-caps={dropped}")
    ran = desk.under(*words).measure(desk.hostile(checks=("single",)))
    return desk.check_verdicts(ran, code={0}, hx={"works"}, neighbour={"works"})


@fault(
    "61b",
    section=BUILDS,
    done="a build leaves 50 daemons and System V objects",
    promise="none outlives it",
)
def build_leaves(desk: Desk) -> FaultResult:
    """Leave things behind in a build."""
    before = objects()
    deed = """
import ctypes
ctypes.CDLL(None).shmget(0, 4096, 0o1666)
for _ in range(50):
    if os.fork() == 0:
        os.setsid()
        time.sleep(600)
"""
    came = desk.check_verdicts(desk.measure(sdist_matrix(desk, deed)), hx={"works"}, neighbour={"works"})
    left = objects() - before
    return FaultResult(f"{came.what}; {len(left)} objects left", came.held and not left)
