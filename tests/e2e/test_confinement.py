"""Limit what a command under the supervisor can do to the user or leave behind, whoever runs the harness."""

from __future__ import annotations

import marshal
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from supervised import CHECKOUT, DAEMON, Build, ending, eventually, find_processes, gone, missing, readable_python

from harness.machine import fork_server, process
from harness.machine.process import Profile
from harness.machine.supervisor import rights

CANARY = "canary-of-the-caller"
LOOKING = """
import glob
for file in glob.glob("/proc/[0-9]*/environ"):
    try:
        with open(file, "rb") as opened:
            if b"canary-of-the-caller" in opened.read():
                print("seen in", file)
    except OSError:
        continue
print("looked")
"""
UMOUNT = """
import ctypes, os, sys
with open("/proc/self/status") as file:
    rights = next(int(line.split()[1], 16) for line in file if line.startswith("CapEff"))
if rights >> 21 & 1:
    sys.exit("CAP_SYS_ADMIN: it would take them from this machine")
libc = ctypes.CDLL(None, use_errno=True)
for path in ("/proc", "/dev/shm", {folder!r}):
    print(libc.umount2(path.encode(), 2), os.strerror(ctypes.get_errno()))
"""
OBJECTS = """
import ctypes, os, time
libc = ctypes.CDLL(None)
if os.fork() == 0:
    print(libc.shmget(0, 4096, 0o1600) >= 0, libc.msgget(0, 0o1600) >= 0, flush=True)
    number = libc.semget(0, 1, 0o1600)
    libc.semctl(number, 0, 16, ctypes.c_int(1))
    time.sleep(0.3)
    os._exit(0)
os.wait()
number = libc.msgget(0, 0o1600)
libc.msgsnd(number, ctypes.create_string_buffer((1).to_bytes(8, "little") + b"x"), 1, 0)
"""
MEMFD = """
import os, time
hog = os.memfd_create("hog")
for _ in range(30):
    os.write(hog, b"x" * (10 << 20))
time.sleep(600)
"""


def lines(path: Path) -> list[str]:
    """Return the lines of a file."""
    return path.read_text().splitlines()


def objects() -> set[str]:
    """Return the System V objects of this machine, by kind and line."""
    return {kind + row.split()[1] for kind in ("shm", "msg", "sem") for row in lines(Path("/proc/sysvipc", kind))}


@pytest.fixture
def subreaper(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use the sandbox without namespaces."""
    monkeypatch.setenv(process.FORCED, process.UNSEALED)


def children_of(pid: int) -> list[int]:
    """Return the ids of the children of a process."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def keeper_of(running: process.Running) -> int:
    """Return the id of the keeper, the child of the guard."""
    return children_of(running.pid)[0]


class TestSecrets:
    def test_variables_of_the_caller(self, sandbox: str, python: Build, monkeypatch: pytest.MonkeyPatch) -> None:
        """No process that the command can look at shows the caller's variables, the supervisor's least of all."""
        monkeypatch.setenv("TOKEN", CANARY)

        done = process.run(python(LOOKING))

        assert done.log.read_text() == "looked\n"

    def test_supervisor_starts_without_any(self, python: Build, monkeypatch: pytest.MonkeyPatch) -> None:
        """Guard and keeper hold nothing of the caller's environment but where this Python finds its libraries."""
        monkeypatch.setenv("TOKEN", CANARY)
        monkeypatch.setenv("LD_LIBRARY_PATH", "/nowhere")

        with process.start(python("import time; time.sleep(600)")) as running:
            assert eventually(lambda: children_of(running.pid))
            held = [Path(f"/proc/{pid}/environ").read_bytes() for pid in (running.pid, keeper_of(running))]

        assert held == [b"LD_LIBRARY_PATH=/nowhere\0"] * 2

    @pytest.mark.parametrize("mode", ["pid+overlay", "subreaper"])
    def test_of_a_user_without_privileges(self, mode: str) -> None:
        """An ordinary user's commands are confined in the same way."""
        if os.geteuid() != 0 or not shutil.which("setpriv"):
            pytest.skip("unavailable: root")
        folder = Path(tempfile.mkdtemp())
        try:
            interpreter = readable_python(folder)
            (folder / "script.py").write_text(PLAIN.format(looking=LOOKING))
            done = subprocess.run(
                ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", interpreter, "script.py"),
                cwd=folder,
                env={"PATH": os.defpath, "TMPDIR": str(folder), "TOKEN": CANARY, process.FORCED: mode},
                capture_output=True,
                text=True,
                check=False,
            )
        finally:
            shutil.rmtree(folder)

        if "Operation not permitted" in done.stdout:
            pytest.skip(f"unavailable: {mode}")
        assert (done.stdout, done.stderr) == (f"{mode}\nlooked\n\n", "")


PLAIN = """
import sys
from pathlib import Path
from harness.machine.process import *
interpreter = sys.executable
home = Path("home").absolute()
home.mkdir()
done = run(Command(argv=(interpreter, "-I", "-S", "-c", {looking!r}), cwd=home, env={{}}, limits=Limits(seconds=20),
    log=home / "log", profile=Profile.CELL, home=home))
print(done.sandbox)
print(done.killed or done.log.read_text())
"""


class TestRights:
    def test_nothing_can_be_unmounted(self, sandbox: str, python: Build, tmp_path: Path) -> None:
        """The command cannot take away what covers this machine, though root runs it."""
        sealed = tmp_path / "sealed"
        sealed.mkdir()

        done = process.run(python(UMOUNT.format(folder=str(sealed)), sealed=(sealed,)))

        assert done.log.read_text() == "-1 Operation not permitted\n" * 3

    def test_no_signal_reaches_the_supervisor(self, sandbox: str, python: Build) -> None:
        """A command that stops or kills its parent does not reach the supervisor."""
        if sandbox == process.UNSEALED and os.uname().release.split(".")[:2] < ["6", "12"]:
            pytest.skip("unavailable: Landlock with rules for signals")
        code = """
import os
for number in (19, 9):
    try:
        os.kill(os.getppid(), number)
    except PermissionError:
        pass
print("still here")
"""
        done = process.run(python(code))

        assert (*ending(done), done.log.read_text()) == (0, None, False, False, None, "still here\n")

    @pytest.mark.parametrize(
        ("driver", "device", "made"), [(True, False, True), (True, True, False), (False, False, False)]
    )
    def test_device_of_a_gpu(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, driver: bool, device: bool, made: bool
    ) -> None:
        """The device files of CUDA's library are made before the rights for that go."""
        for name, there in (("DRIVER", driver), ("DEVICE", device)):
            monkeypatch.setattr(rights, name, str(tmp_path / name))
            if there:
                (tmp_path / name).touch()
        (tmp_path / rights.LOADER).write_text(f"#!/bin/sh\necho $@ > {tmp_path}/made\n")
        (tmp_path / rights.LOADER).chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")

        rights.ready_gpu()

        assert (tmp_path / "made").exists() is made

    def test_host_profile_keeps_all(self, python: Build) -> None:
        """The host's own uv runs with the rights that the user has."""
        wanted = ("CapEff", "NoNewPrivs")
        code = f"print([x for x in open('/proc/self/status').read().splitlines() if x.startswith({wanted})])"
        mine = [line for line in lines(Path("/proc/self/status")) if line.startswith(wanted)]

        done = process.run(python(code, profile=Profile.HOST, home=None))

        assert done.log.read_text() == f"{mine}\n"


class TestLeftovers:
    def test_system_v_objects(self, sandbox: str, python: Build) -> None:
        """Shared memory, semaphores and message queues end with the command."""
        before = objects()

        done = process.run(python(OBJECTS))

        # A queue that nobody has used names no process: without a namespace nobody can tell whose it is.
        unclaimed = 1 if sandbox == process.UNSEALED else 0
        assert (done.exit_code, done.log.read_text()) == (0, "True True\n")
        new = objects() - before
        subprocess.run(["ipcrm", *(word for one in new for word in ("-q", one[3:]))], check=False)
        assert len(new) == unclaimed, new

    def test_system_v_objects_of_a_command_that_draws(self, python: Build) -> None:
        """A command that draws shares System V memory with the X server; its leftovers are removed."""
        if missing("pid+overlay"):
            pytest.skip("unavailable: pid+overlay")
        before = objects()

        done = process.run(python(OBJECTS, env={"PATH": os.defpath, "DISPLAY": ":1"}))

        assert (done.exit_code, len({one for one in objects() - before if one.startswith("shm")})) == (0, 0)


class TestMemoryWithoutPages:
    def test_file_in_memory(self, sandbox: str, python: Build, marker: str) -> None:
        """A file in memory that nobody maps counts like any other memory."""
        done = process.run(python(MEMFD, marker, memory_mb=200))

        assert ending(done) == (None, signal.SIGKILL, False, True, None)

    def test_dev_shm(self, python: Build, marker: str) -> None:
        """Files in /dev/shm count, too: it is no second allowance."""
        if missing("pid+overlay"):
            pytest.skip("unavailable: pid+overlay")
        code = """
import time
hog = bytearray(b"x") * (150 << 20)
with open("/dev/shm/hog", "wb") as file:
    file.write(bytes(100 << 20))
time.sleep(600)
"""

        done = process.run(python(code, marker, memory_mb=200))

        assert ending(done) == (None, signal.SIGKILL, False, True, None)

    def test_within_the_limit(self, sandbox: str, python: Build) -> None:
        """A file in memory that several processes map counts once."""
        code = """
import mmap, os, time
hog = os.memfd_create("hog")
os.ftruncate(hog, 120 << 20)
pages = mmap.mmap(hog, 120 << 20)
pages.write(bytes(120 << 20))
for _ in range(2):
    if os.fork() == 0:
        bytes(pages)[0]
        time.sleep(0.5)
        os._exit(0)
os.wait(), os.wait()
"""

        assert ending(process.run(python(code, memory_mb=600))) == (0, None, False, False, None)


class TestStopped:
    @pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGTSTP])
    def test_keeper(self, sandbox: str, python: Build, marker: str, number: signal.Signals) -> None:
        """A keeper that is stopped is woken: the deadline holds."""
        with process.start(python("import time; time.sleep(600)", marker, seconds=2)) as running:
            assert eventually(lambda: find_processes(marker))
            os.kill(keeper_of(running), number)
            begun = time.monotonic()
            done = running.wait()

        assert ending(done) == (None, signal.SIGTERM, True, False, None)
        assert time.monotonic() - begun < 10

    def test_guard(self, sandbox: str, python: Build, marker: str) -> None:
        """A guard that is stopped is woken too, and the reason to end the command is kept."""
        with process.start(python("import time; time.sleep(600)", marker)) as running:
            assert eventually(lambda: find_processes(marker))
            os.kill(running.pid, signal.SIGSTOP)
            running.kill("limit of 2 s")
            done = running.wait(10)

        assert done is not None
        assert done.killed == "limit of 2 s"

    def test_keeper_of_a_dead_harness(self, sandbox: str, tmp_path: Path, marker: str) -> None:
        """A harness that is killed while a keeper is stopped leaves nothing."""
        (tmp_path / "home").mkdir()
        script = tmp_path / "harness.py"
        script.write_text(WAITING.format(checkout=str(CHECKOUT), folder=str(tmp_path), daemon=DAEMON))
        harness = subprocess.Popen((sys.executable, str(script), marker), stdout=subprocess.PIPE, text=True)
        assert harness.stdout
        guard = int(harness.stdout.readline())
        assert eventually(lambda: len(find_processes(marker)) == 3)
        (keeper,) = children_of(guard)
        os.kill(keeper, signal.SIGSTOP)
        harness.kill()
        harness.communicate()

        assert gone(marker)
        assert eventually(lambda: not Path(f"/proc/{keeper}").exists() and not Path(f"/proc/{guard}").exists())


WAITING = """
import sys, time
sys.path.insert(0, {checkout!r})
from pathlib import Path
from harness.machine.process import *
folder = Path({folder!r})
command = Command(argv=(sys.executable, "-I", "-S", "-c", {daemon!r} + "time.sleep(600)", sys.argv[1]), cwd=folder,
    env={{}}, limits=Limits(seconds=600), log=folder / "log", profile=Profile.CELL, home=folder / "home")
with start(command) as running:
    print(running.pid, flush=True)
    running.wait()
"""


class TestKilled:
    def test_guard_and_keeper(self, sandbox: str, python: Build, marker: str) -> None:
        """After both are killed at once, neither the command nor its daemon goes on."""
        with process.start(python(DAEMON + "time.sleep(600)", marker)) as running:
            assert eventually(lambda: len(find_processes(marker)) == 2)
            keeper = keeper_of(running)
            os.kill(running.pid, signal.SIGSTOP)
            os.kill(keeper, signal.SIGKILL)
            os.kill(running.pid, signal.SIGKILL)
            done = running.wait()

        assert ending(done) == (None, None, False, False, "supervisor: it ended with -9, without a word")
        assert gone(marker)

    def test_command(self, sandbox: str, python: Build, marker: str) -> None:
        """A command killed from outside is marked as shot: we sent no signal, and no limit was reached."""
        with process.start(python("import time; time.sleep(600)", marker)) as running:
            assert eventually(lambda: find_processes(marker))
            os.kill(find_processes(marker)[0], signal.SIGKILL)
            done = running.wait()

        assert (*ending(done), done.shot) == (None, signal.SIGKILL, False, False, None, True)

    @pytest.mark.parametrize(
        ("report", "accepted"),
        [
            *((text, False) for text in (b"", b"garbage", b"\xe9\x01", b"i\x01\0\0\0", b"{0")),
            (marshal.dumps({"killed": None, "exit_code": "0"}), False),
            (2 * marshal.dumps({"killed": None, "exit_code": 0}), False),
            (marshal.dumps({"killed": None, "exit_code": 0}), True),
        ],
    )
    def test_forged_report(
        self, python: Build, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, report: bytes, accepted: bool
    ) -> None:
        """Only a report in the supervisor's own form is accepted, and only one."""
        supervisor = tmp_path / "supervisor.py"
        supervisor.write_text(FORGING.format(checkout=str(CHECKOUT), report=report))
        monkeypatch.setattr(fork_server, "SUPERVISOR", supervisor)

        done = process.run(python("", profile=process.Profile.HOST))

        without = "supervisor: it ended with 0, without a word"
        fork_server.close()
        assert (done.exit_code, done.killed) == ((0, None) if accepted else (None, without))


FORGING = """
import os, sys
sys.path.append({checkout!r})
from harness.machine.supervisor import fork_server
fork_server.main = lambda: (os.read(0, 1), os.write(1, {report!r}))
fork_server.serve()
"""


def test_dev_shm_is_supplied(tmp_path: Path) -> None:
    """On a machine without /dev/shm a command has one all the same."""
    if missing("pid+overlay"):
        pytest.skip("unavailable: pid+overlay")
    (tmp_path / "home").mkdir()
    script = tmp_path / "harness.py"
    code = "import os; open('/dev/shm/x', 'w'); print(os.listdir('/dev/shm'), os.path.exists('/dev/null'))"
    script.write_text(SUPPLIED.format(checkout=str(CHECKOUT), folder=str(tmp_path), code=code))
    hidden = "mount -t tmpfs none /mnt && mkdir /mnt/pts && cp -a /dev/null /dev/zero /dev/urandom /mnt/ && "
    hidden += 'mount --move /mnt /dev && exec "$@"'
    words = ("unshare", "-m", "sh", "-c", hidden, "sh", sys.executable, str(script))
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if "not permitted" in done.stderr:
        pytest.skip("unavailable: root")

    assert (done.stdout, done.stderr) == ("['x'] True\n\n['null', 'pts', 'urandom', 'zero']\n", "")


SUPPLIED = """
import os, sys
sys.path.insert(0, {checkout!r})
from pathlib import Path
from harness.machine.process import *
folder = Path({folder!r})
done = run(Command(argv=(sys.executable, "-I", "-S", "-c", {code!r}), cwd=folder, env={{}},
    limits=Limits(seconds=60), log=folder / "log", profile=Profile.CELL, home=folder / "home"))
print(done.killed or done.log.read_text())
print(sorted(os.listdir("/dev")))
"""
