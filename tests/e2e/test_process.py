"""Real processes run under the real supervisor; each test leaves none behind."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import uuid
from contextlib import suppress
from pathlib import Path

import pytest
from supervised import CHECKOUT, DAEMON, Build, ending, eventually, find_processes, gone, missing, readable_python

from harness.machine import process
from harness.machine.process import Profile
from harness.model.errors import BadInput
from harness.packages.environments import bytecode


class TestEnds:
    @pytest.mark.parametrize(
        ("code", "exit_code", "number"),
        [
            ("import ctypes; ctypes.string_at(0)", None, signal.SIGSEGV),
            ("import os; os.abort()", None, signal.SIGABRT),
            ("import os; os._exit(3)", 3, None),
            ("import sys; sys.exit('no')", 1, None),
            ("import sys; sys.exit(127)", 127, None),
            ("import os; os.kill(os.getpid(), 9)", None, signal.SIGKILL),
            ("pass", 0, None),
        ],
    )
    def test_code_or_signal(
        self, sandbox: str, python: Build, code: str, exit_code: int | None, number: int | None
    ) -> None:
        """An exit code and a signal are told apart, whatever ended the process."""
        done = process.run(python(code))

        assert ending(done) == (exit_code, number, False, False, None)
        assert (done.sandbox, done.stray) == (sandbox, 0)

    def test_missing_program(self, sandbox: str, python: Build) -> None:
        """A missing program never ran: it has no exit code, and the reason is given."""
        done = process.run(python("", argv=("no-such-program", "--help")))

        assert ending(done) == (
            None,
            None,
            False,
            False,
            "supervisor: cannot run no-such-program: No such file or directory",
        )

    def test_missing_folder(self, python: Build, tmp_path: Path) -> None:
        """A missing working folder is distinguished from a missing program."""
        done = process.run(python("", cwd=tmp_path / "absent"))

        assert done.killed == f"supervisor: cannot enter {tmp_path / 'absent'}: No such file or directory"

    def test_hang(self, sandbox: str, python: Build, marker: str) -> None:
        """A hang that ignores SIGTERM ends at its deadline."""
        code = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)"

        done = process.run(python(code, marker, seconds=0.5))

        assert ending(done) == (None, signal.SIGKILL, True, False, None)

    def test_deadline_is_polite_first(self, sandbox: str, python: Build) -> None:
        """At its deadline a command may still write its last output."""
        code = "import signal, sys, time; signal.signal(signal.SIGTERM, lambda *_: sys.exit('last')); time.sleep(600)"

        done = process.run(python(code, seconds=0.5))

        assert ending(done) == (1, None, True, False, None)
        assert done.log.read_text() == "last\n"

    def test_double_fork(self, sandbox: str, python: Build, marker: str) -> None:
        """A daemon in a session of its own, with the output pipe open, neither delays the end nor outlives it."""
        done = process.run(python(DAEMON, marker))

        assert (*ending(done), done.stray) == (0, None, False, False, None, 1)
        assert find_processes(marker) == []

    def test_many_strays(self, sandbox: str, python: Build, marker: str) -> None:
        """Processes that keep forking are all ended."""
        code = """
import os, time
for _ in range(4):
    if os.fork() == 0:
        while True:
            if os.fork() == 0:
                time.sleep(0.05)
                os._exit(0)
            time.sleep(0.02)
            try:
                while os.waitpid(-1, os.WNOHANG)[0]: pass
            except ChildProcessError:
                pass
time.sleep(0.2)
"""

        done = process.run(python(code, marker))

        assert done.exit_code == 0
        assert done.stray >= 4
        assert find_processes(marker) == []

    def test_helper_that_ends_by_itself(self, sandbox: str, python: Build) -> None:
        """A helper that ends right after its parent is no stray."""
        done = process.run(python("import os, time\nif os.fork() == 0: time.sleep(0.05)"))

        assert (done.exit_code, done.stray) == (0, 0)

    def test_kill(self, sandbox: str, python: Build, marker: str) -> None:
        """The reason given to `kill` is kept."""
        with process.start(python("import time; time.sleep(600)", marker)) as running:
            assert eventually(lambda: find_processes(marker))
            assert running.poll() is None
            assert running.wait(0.01) is None
            running.kill("limit of 2 s")
            done = running.wait()

        assert ending(done) == (None, signal.SIGTERM, False, False, "limit of 2 s")
        assert running.poll() is done

    def test_left_block(self, sandbox: str, python: Build, marker: str) -> None:
        """An exception in the `with` block ends the command."""

        def interrupted() -> None:
            with process.start(python(DAEMON + "time.sleep(600)", marker)):
                assert eventually(lambda: len(find_processes(marker)) == 2)
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            interrupted()

        assert find_processes(marker) == []

    def test_in_parallel(self, sandbox: str, python: Build, tmp_path: Path) -> None:
        """Threads run commands at the same time, each with its own end."""
        codes: dict[int, int | None] = {}

        def work(number: int) -> None:
            command = python(
                f"import time; time.sleep(0.2); raise SystemExit({number})", log=tmp_path / f"{number}.log"
            )
            codes[number] = process.run(command).exit_code

        threads = [threading.Thread(target=work, args=(number,)) for number in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

        assert codes == {number: number for number in range(8)}


class TestOutput:
    def test_both_streams(self, sandbox: str, python: Build) -> None:
        """Standard output and error go to the log, in order; there is nothing to read and no terminal."""
        code = """
import os, sys
print("out", flush=True)
print("err", file=sys.stderr, flush=True)
print(repr(sys.stdin.read()), os.getsid(0) == os.getpid(), sorted(os.listdir("/proc/self/fd")))
"""

        done = process.run(python(code))

        assert done.log.read_text() == "out\nerr\n'' True ['0', '1', '2', '3']\n"
        assert not done.truncated

    def test_endless(self, sandbox: str, python: Build, marker: str) -> None:
        """Of endless output the log keeps head and tail and says how much it left out; the command never blocks."""
        code = """
import os, sys
os.write(1, b"first")
for _ in range(200): os.write(1, b"x" * 100000)
os.write(1, b"last")
"""

        done = process.run(python(code, marker, output_kb=64))

        text = done.log.read_text()
        assert done.exit_code == 0
        assert done.truncated
        assert text.startswith("firstxxx")
        assert text.endswith("xxxlast")
        assert f"x\n[... {20_000_009 - 65536} bytes left out here ...]\nx" in text

    def test_endless_until_the_deadline(self, sandbox: str, python: Build, marker: str) -> None:
        """Output without end ends at the deadline, the log within its bounds."""
        done = process.run(python("while True: print('y' * 1000)", marker, seconds=0.5, output_kb=64))

        assert done.timed_out
        assert 65536 < done.log.stat().st_size < 65536 + 100

    def test_endless_stray(self, sandbox: str, python: Build, marker: str) -> None:
        """A stray that prints without end is ended like any other."""
        done = process.run(python("import os\nif os.fork() == 0:\n    while True: print('z' * 1000)", marker))

        assert (done.exit_code, done.stray) == (0, 1)


class TestMemory:
    def test_hog(self, sandbox: str, python: Build, marker: str) -> None:
        """More resident memory than allowed ends everything."""
        code = "import time; hog = bytearray(b'x') * (300 << 20); time.sleep(600)"

        done = process.run(python(code, marker, memory_mb=150))

        assert ending(done) == (None, signal.SIGKILL, False, True, None)

    def test_hog_among_children(self, sandbox: str, python: Build, marker: str) -> None:
        """The limit is for all processes together."""
        code = """
import os, time
for _ in range(3):
    if os.fork() == 0:
        break
hog = bytearray(b"x") * (100 << 20)
time.sleep(600)
"""

        done = process.run(python(code, marker, memory_mb=250))

        assert ending(done) == (None, signal.SIGKILL, False, True, None)

    def test_shared_pages(self, sandbox: str, python: Build) -> None:
        """Pages that forked children share count once."""
        code = """
import os, time
hog = bytearray(b"x") * (200 << 20)
for _ in range(4):
    if os.fork() == 0:
        time.sleep(0.6)
        os._exit(0)
time.sleep(0.6)
for _ in range(4): os.wait()
"""

        done = process.run(python(code, memory_mb=400))

        assert ending(done) == (0, None, False, False, None)

    def test_reserved_addresses(self, sandbox: str, python: Build) -> None:
        """Reserving addresses is not using memory."""
        code = "import mmap; mmap.mmap(-1, 64 << 30, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | 0x4000)"

        assert process.run(python(code, memory_mb=150)).exit_code == 0


class TestPrivacy:
    def test_environment(self, sandbox: str, python: Build, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """The command sees the variables it was given and those of its private home, no other."""
        monkeypatch.setenv("PYTHONPATH", "/nowhere")
        monkeypatch.setenv("PIP_INDEX_URL", "https://example.invalid")
        home = tmp_path / "home"

        done = process.run(python("", argv=("/usr/bin/env",), env={"GIVEN": "yes", "HOME": "/elsewhere"}))

        assert dict(line.split("=", 1) for line in done.log.read_text().splitlines()) == {
            "GIVEN": "yes",
            "HOME": str(home),
            "TMPDIR": str(tmp_path / "tmp"),
            "XDG_CACHE_HOME": str(home / ".cache"),
            "XDG_CONFIG_HOME": str(home / ".config"),
            "XDG_DATA_HOME": str(home / ".local/share"),
            "XDG_STATE_HOME": str(home / ".local/state"),
            "XDG_RUNTIME_DIR": str(home / ".run"),
        }
        assert (tmp_path / "tmp").is_dir()

    def test_a_command_that_removes_home_keeps_its_temporary_folder(
        self, sandbox: str, python: Build, tmp_path: Path
    ) -> None:
        """Python falls back to no folder of the machine, and can still write to its own."""
        code = "import os, tempfile; os.rename(os.environ['HOME'], os.environ['HOME'] + '.gone'); "
        code += "open(os.path.join(os.environ['TMPDIR'], 'x'), 'w').close(); print(tempfile.gettempdir())"

        done = process.run(python(code))

        assert (done.log.read_text(), sandbox) == (f"{tmp_path / 'tmp'}\n", done.sandbox)

    def test_host_profile(self, python: Build) -> None:
        """The profile of the host's uv leaves the environment as it is given."""
        done = process.run(python("", argv=("/usr/bin/env",), profile=Profile.HOST, home=None, env={"HOME": "/mine"}))

        assert (done.log.read_text(), done.sandbox) == ("HOME=/mine\n", "subreaper")

    def test_signals_are_restored(self, sandbox: str, python: Build) -> None:
        """Signals that the harness ignores or blocks are neither ignored nor blocked in the command."""
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR1})
        try:
            done = process.run(python("print([x for x in open('/proc/self/status') if x[:6] in ('SigBlk', 'SigIgn')])"))
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)

        # Python itself ignores SIGPIPE and SIGXFSZ.
        assert done.log.read_text() == "['SigBlk:\\t0000000000000000\\n', 'SigIgn:\\t0000000001001000\\n']\n"

    def test_shared_memory(self, python: Build) -> None:
        """/dev/shm is the command's own."""
        if not process.sandbox_mode().startswith("pid"):
            pytest.skip("unavailable: mount namespaces")
        name = f"shm-{uuid.uuid4().hex}"
        code = f"import os; assert os.listdir('/dev/shm') == []; open('/dev/shm/{name}', 'w')"

        assert process.run(python(code)).exit_code == 0
        assert not Path("/dev/shm", name).exists()

    def test_processes(self, python: Build) -> None:
        """Only the command's own processes are to be seen, under their right numbers."""
        if not process.sandbox_mode().startswith("pid"):
            pytest.skip("unavailable: PID namespaces")
        code = "import os; print(sorted(p for p in os.listdir('/proc') if p.isdigit()) == ['1', str(os.getpid())])"

        assert process.run(python(code)).log.read_text() == "True\n"


WRITES = """
import os
open("new.txt", "w").write("new")
open("changed.txt", "a").write("more")
os.remove("removed.txt")
os.mkdir("folder")
open("folder/inner.txt", "w").close()
os.mkdir("kept/__pycache__")
open("kept/__pycache__/a.pyc", "w").close()
os.mkdir("__pycache__")
print(sorted(os.listdir(".")), open("changed.txt").read())
"""


@pytest.fixture
def sealed(tmp_path: Path) -> Path:
    """Return a folder like an environment, with a hard link to one of its files elsewhere; its name needs quoting."""
    folder = tmp_path / "odd, name: with\\all"
    (folder / "kept").mkdir(parents=True)
    (folder / "kept/a.py").write_text("")
    (folder / "removed.txt").write_text("here")
    (folder / "changed.txt").write_text("old")
    (tmp_path / "twin.txt").hardlink_to(folder / "changed.txt")
    return folder


def contents(folder: Path) -> dict[str, str | None]:
    """Return every path below a folder, with the text of files."""
    return {str(p.relative_to(folder)): p.read_text() if p.is_file() else None for p in folder.rglob("*")}


class TestSealed:
    @pytest.fixture(params=["pid+overlay", "subreaper+overlay"])
    def overlay(self, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
        if missing(request.param):
            pytest.skip(f"unavailable: {request.param}")
        monkeypatch.setenv(process.FORCED, request.param)

    @pytest.mark.usefixtures("overlay")
    def test_writes_are_kept_out_and_reported(self, python: Build, sealed: Path, tmp_path: Path) -> None:
        """A writer into its environment succeeds, is reported, and changes neither folder nor hard-linked twin."""
        before = contents(sealed)

        done = process.run(python(WRITES, cwd=sealed, sealed=(sealed,)))

        seen = "['__pycache__', 'changed.txt', 'folder', 'kept', 'new.txt'] oldmore\n"
        assert (done.exit_code, done.log.read_text()) == (0, seen)
        assert done.written == ("changed.txt", "new.txt", "removed.txt", "folder", "folder/inner.txt")
        assert contents(sealed) == before
        assert (tmp_path / "twin.txt").read_text() == "old"
        assert list((tmp_path / "home/.sealed").iterdir()) == []

    @pytest.mark.usefixtures("overlay")
    def test_each_run_starts_clean(self, python: Build, sealed: Path) -> None:
        """A run starts without the writes of an earlier one, though both have the same home."""
        first = process.run(python(WRITES, cwd=sealed, sealed=(sealed,)))
        second = process.run(python("open('changed.txt').read()", cwd=sealed, sealed=(sealed,)))

        assert first.written
        assert (second.exit_code, second.written) == (0, ())

    @pytest.mark.usefixtures("overlay")
    def test_writable_below_sealed(self, python: Build, sealed: Path) -> None:
        """A folder declared writable keeps what is written, and it is no finding."""
        command = python(
            "open('kept/new.txt', 'w').write('new')", cwd=sealed, sealed=(sealed,), writable=(sealed / "kept",)
        )

        assert process.run(command).written == ()
        assert (sealed / "kept/new.txt").read_text() == "new"

    @pytest.mark.usefixtures("overlay")
    def test_seen_after_a_crash(self, python: Build, sealed: Path) -> None:
        """Written files are reported even if the writer died."""
        done = process.run(python("open('x', 'w'); import os; os.abort()", cwd=sealed, sealed=(sealed,)))

        assert (done.signal, done.written) == (signal.SIGABRT, ("x",))

    @pytest.mark.usefixtures("overlay")
    def test_list_is_bounded(self, python: Build, sealed: Path) -> None:
        """A flood of files is listed up to a hundred."""
        done = process.run(python("for i in range(300): open(f'f{i}', 'w')", cwd=sealed, sealed=(sealed,)))

        assert len(done.written) == 100

    @pytest.mark.usefixtures("overlay")
    def test_byte_code_is_reported_apart(self, python: Build, sealed: Path, tmp_path: Path) -> None:
        """Byte code over a kept folder is seen by the run, named in its report, and goes with it; poison does, too."""
        kept = tmp_path / "kept code"
        (kept / "a").mkdir(parents=True)
        (kept / "a/old.cpython-311.pyc").write_bytes(b"old")
        before = contents(kept)
        code = """
import os
os.makedirs("b" * 200 + "/c")
for path in ("a/old.cpython-311.pyc", "a/new.cpython-311.pyc", "b" * 200 + "/c/x.pyc", "text.txt"):
    open(path, "wb").write(b"poison")
os.makedirs("folder.pyc")
os.symlink("/etc/passwd", "link.pyc")
for part in range(6):
    os.mkdir("d" * 200)
    os.chdir("d" * 200)
open("deep.pyc", "w")
"""

        done = process.run(python(code, cwd=kept, sealed=(sealed,), byte_code=(kept,)))

        assert (done.exit_code, done.written) == (0, ())
        assert sorted(done.compiled) == [
            "a/new.cpython-311.pyc",
            "a/old.cpython-311.pyc",
            f"{'b' * 200}/c/x.pyc",
        ]
        assert contents(kept) == before

    @pytest.mark.parametrize("name", [name for name in process.SANDBOXES if "+" in name])
    def test_the_harness_s_own_folders_take_no_write(
        self, python: Build, sealed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
    ) -> None:
        """A cache is read-only for a probe, but not its own folders in it, nor what is laid over its environment."""
        if missing(name):
            pytest.skip(f"unavailable: {name}")
        monkeypatch.setenv(process.FORCED, name)
        cache = tmp_path / "cache"
        (cache / "home").mkdir(parents=True)
        (cache / "work").mkdir()
        environment = sealed.rename(cache / "environment")
        code = """
def write(path):
    try:
        open(path, "w").write("poison")
    except OSError as error:
        print(error.strerror)
    else:
        print("written")

for path in ("../stored", "../environment/changed.txt", "../work/own", "own"):
    write(path)
"""

        settings = {"cwd": cache / "home", "home": cache / "home", "sealed": (environment,), "shielded": (cache,)}
        done = process.run(python(code, writable=(cache / "work",), **settings))

        over = "written" if name.endswith("overlay") else "Read-only file system"
        assert done.log.read_text().splitlines() == ["Read-only file system", over, "written", "written"]
        assert (environment / "changed.txt").read_text() == "old"
        assert [(cache / where / "own").read_text() for where in ("work", "home")] == ["poison"] * 2

    @pytest.mark.parametrize("name", [name for name in process.SANDBOXES if "+" in name])
    def test_the_library_of_the_interpreter_takes_no_write(
        self, python: Build, monkeypatch: pytest.MonkeyPatch, name: str
    ) -> None:
        """Its byte code is lent to all runs, so no run may leave some there."""
        if missing(name):
            pytest.skip(f"unavailable: {name}")
        monkeypatch.setenv(process.FORCED, name)
        code = "import os, tempfile; tempfile.TemporaryFile(dir=os.path.dirname(os.__file__))"

        done = process.run(python(code, shielded=bytecode.shielded(Path(sys.executable))))

        assert done.exit_code == 1
        assert "Read-only file system" in done.log.read_text()

    @pytest.mark.parametrize("name", ["pid+readonly", "subreaper+readonly"])
    def test_read_only(self, python: Build, sealed: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
        """Without an overlay, a sealed folder refuses writes."""
        if missing(name):
            pytest.skip(f"unavailable: {name}")
        monkeypatch.setenv(process.FORCED, name)
        before = contents(sealed)

        done = process.run(python("open('new.txt', 'w')", cwd=sealed, sealed=(sealed,)))

        assert done.exit_code == 1
        assert "Read-only file system" in done.log.read_text()
        assert contents(sealed) == before


HARNESS = """
import os, sys
sys.path.insert(0, {checkout!r})
from pathlib import Path
from harness.machine.process import *
folder = Path({folder!r})
command = Command(argv=(sys.executable, "-I", "-S", "-c", {daemon!r} + "time.sleep(600)", sys.argv[1]), cwd=folder,
    env={{}}, limits=Limits(seconds=600), log=folder / "log", profile=Profile.CELL, home=folder / "home")
"""

STOPPER = """
import threading, time
from harness.machine import process
ends = [sandbox_mode()]
thread = threading.Thread(target=lambda: ends.append(run(command)))
thread.start()
while not process.resident_mb(): time.sleep(0.01)
stop()
thread.join()
print(ends[-1].killed)
try:
    run(command)
except Exception as error:
    print(error)
"""


def harness_script(folder: Path, ending: str) -> Path:
    """Write a program that uses the supervisor as the harness does."""
    (folder / "home").mkdir()
    script = folder / "harness.py"
    script.write_text(HARNESS.format(checkout=str(CHECKOUT), folder=str(folder), daemon=DAEMON) + ending)
    return script


def parent_of(pid: int) -> int:
    """Return the id of the parent of a process."""
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


class TestDeaths:
    @pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
    def test_harness(self, sandbox: str, python: Build, tmp_path: Path, marker: str, number: int) -> None:
        """If the harness dies by any signal, everything below it ends."""
        script = harness_script(tmp_path, "run(command)")
        harness = subprocess.Popen((sys.executable, str(script), marker), stderr=subprocess.DEVNULL)
        assert eventually(lambda: len(find_processes(marker)) == 3)

        harness.send_signal(number)
        harness.wait()

        assert gone(marker)

    def test_guard(self, sandbox: str, python: Build, marker: str) -> None:
        """If the supervisor is killed, everything below it ends, and the command is not blamed."""
        with process.start(python(DAEMON + "time.sleep(600)", marker)) as running:
            assert eventually(lambda: len(find_processes(marker)) == 2)
            os.kill(running.pid, signal.SIGKILL)
            done = running.wait()

        assert ending(done) == (None, None, False, False, "supervisor: it ended with -9, without a word")
        assert gone(marker)

    def test_keeper(self, sandbox: str, python: Build, marker: str) -> None:
        """If the keeper is killed, everything below it ends, and the command is not blamed."""
        with process.start(python(DAEMON + "time.sleep(600)", marker)) as running:
            assert eventually(lambda: len(find_processes(marker)) == 2)
            guard = running.pid
            os.kill(int(Path(f"/proc/{guard}/task/{guard}/children").read_text()), signal.SIGKILL)
            done = running.wait()

        assert ending(done) == (None, None, False, False, "supervisor: the keeper ended with -9")
        assert find_processes(marker) == []

    def test_fork_server(self, sandbox: str, python: Build, tmp_path: Path, marker: str) -> None:
        """If the server that forks guards is killed, what runs goes on to its end, and the next command has another."""
        later = python("print('later')", log=tmp_path / "later")
        with process.start(python("import time; time.sleep(1); print('done')", marker)) as running:
            assert eventually(lambda: find_processes(marker))
            os.kill(parent_of(running.pid), signal.SIGKILL)
            after = process.run(later)
            done = running.wait()

        assert [(one.exit_code, one.killed, one.log.read_text()) for one in (done, after)] == [
            (0, None, "done\n"),
            (0, None, "later\n"),
        ]

    def test_stopped_fork_server(self, sandbox: str, python: Build, marker: str) -> None:
        """If the server is stopped, it is woken: what runs ends, and the next command starts."""
        with process.start(python("import time; time.sleep(1)", marker)) as running:
            assert eventually(lambda: find_processes(marker))
            server = parent_of(running.pid)
            os.kill(server, signal.SIGSTOP)
            done = running.wait()
        os.kill(server, signal.SIGSTOP)
        after = process.run(python("print('later')"))

        assert [(one.exit_code, one.killed) for one in (done, after)] == [(0, None)] * 2

    def test_guards_hold_no_files_of_others(self, python: Build) -> None:
        """A guard has its own three streams open, and of other pipes and sockets only the keeper's report."""

        def strange() -> set[str]:
            held = {}
            for path in Path(f"/proc/{second.pid}/fd").iterdir():
                with suppress(FileNotFoundError):  # it was closed since it was listed
                    held[path.name] = str(path.readlink())
            streams = {held.pop(name, "") for name in ("0", "1", "2")}
            return {target for target in held.values() if target.startswith(("pipe:", "socket:"))} - streams

        sleeping = python("import time; time.sleep(600)")
        with process.start(sleeping), process.start(sleeping) as second:
            assert eventually(lambda: len(strange()) == 1)

    def test_stop(self, tmp_path: Path, marker: str) -> None:
        """`stop` ends the commands that other threads wait for, and nothing starts afterwards."""
        script = harness_script(tmp_path, STOPPER)

        harness = subprocess.run((sys.executable, str(script), marker), capture_output=True, text=True, check=True)

        assert harness.stdout == "interrupted\nInterrupted: no further command is started.\n"


class TestMode:
    def test_is_one_of_the_known(self) -> None:
        """The detected sandbox mode is one of the published names."""
        assert process.sandbox_mode() in process.SANDBOXES

    def test_unknown_name(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A forced mode that does not exist is bad input."""
        monkeypatch.setenv(process.FORCED, "jail")

        with pytest.raises(BadInput) as caught:
            process.sandbox_mode()

        assert str(caught.value) == (
            "HARNESS_SANDBOX: there is no 'jail'; it is one of pid+overlay, pid+readonly, subreaper+overlay, "
            "subreaper+readonly, subreaper."
        )

    def test_nested(self, python: Build, sealed: Path) -> None:
        """A sandbox inside an overlay, which cannot hold another upper layer, keeps its upper layer in memory."""
        if missing("pid+overlay"):
            pytest.skip("unavailable: pid+overlay")
        (sealed / "work").mkdir()
        code = f"import sys; sys.path.append({str(CHECKOUT)!r})" + SEALER

        done = process.run(python(code, cwd=sealed, sealed=(sealed,)))

        assert done.log.read_text() == f"pid+overlay {os.getuid()} 0 None ('written',) 1 []\n"

    def test_unprivileged(self, tmp_path: Path) -> None:
        """A user without privileges gets a sandbox that seals as well as root's."""
        if os.geteuid() != 0 or not shutil.which("setpriv"):
            pytest.skip("unavailable: root")
        folder = Path(tempfile.mkdtemp())
        try:
            interpreter = readable_python(folder)
            (folder / "script.py").write_text(SEALER)
            environment = {"PATH": os.defpath, "TMPDIR": str(folder)}
            done = subprocess.run(
                ("setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", interpreter, str(folder / "script.py")),
                capture_output=True,
                text=True,
                check=False,
                env=environment,
                cwd=folder,
            )
        finally:
            shutil.rmtree(folder)

        if done.stdout.startswith("subreaper"):
            pytest.skip("unavailable: user namespaces")
        assert (done.stdout, done.stderr) == ("pid+overlay 65534 0 None ('written',) 1 []\n", "")


SEALER = """
import os, sys
from pathlib import Path
from harness.machine.process import *
mode = sandbox_mode()
folder = Path("work").absolute()
home, sealed = folder / "home", folder / "sealed"
home.mkdir()
sealed.mkdir()
code = "import os; open('written', 'w'); os.fork() or os.execv('/bin/sleep', ['sleep', '60']); print(os.getuid())"
done = run(Command(argv=(sys.executable, "-I", "-S", "-c", code), cwd=sealed, env={}, limits=Limits(seconds=20),
    log=folder / "log", profile=Profile.CELL, home=home, sealed=(sealed,)))
print(mode, done.log.read_text().strip(), done.exit_code, done.killed, done.written, done.stray, list(sealed.iterdir()))
"""
