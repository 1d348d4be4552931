"""`explain` runs a command unchanged, keeps all its output, and explains its failure."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

SIGNATURES = """
[[signature]]
id = "wings"
phases = ["vector"]
pattern = "ValueError: no wings"
packages = ["flyer<2"]
cause = "flyer 1 has none"
references = ["https://example.org/wings"]
examples = ["ValueError: no wings", "ValueError: no wings at all", "again: ValueError: no wings"]
[signature.remedy]
requirements = ["flyer>=2"]

[[signature]]
id = "reset"
phases = ["vector"]
pattern = "ConnectionResetError"
masks = true
generic = true
cause = "a worker ended"
references = ["https://example.org/reset"]
examples = ["ConnectionResetError", "ConnectionResetError: it is gone", "again: ConnectionResetError"]
[signature.remedy]
text = "look at the worker"
"""
WORKER = """
import multiprocessing, sys, time
def work():
    raise ValueError("no wings")
if __name__ == "__main__":
    child = multiprocessing.get_context("fork").Process(target=work)
    child.start()
    child.join()
    print("\\n" * 3000)
    raise ConnectionResetError(104, "Connection reset by peer")
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with two known failures, a state of its own, and nothing measured."""
    folder = tmp_path / "signatures"
    folder.mkdir()
    (folder / "flyer.toml").write_text(SIGNATURES)
    monkeypatch.setenv("HARNESS_SIGNATURES", str(folder))
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def explain(*arguments: str, given: str | bytes = b"") -> subprocess.CompletedProcess[bytes]:
    """Run `explain` to its end."""
    sent = given.encode() if isinstance(given, str) else given
    return subprocess.run(
        [sys.executable, "-m", "harness", "explain", *arguments],
        input=sent,
        capture_output=True,
        timeout=60,
        check=False,
    )


def python(code: str) -> tuple[str, ...]:
    """Return a command that runs some code."""
    return ("--", sys.executable, "-c", code)


def environment(place: Path, version: str) -> str:
    """Return the Python of an environment that has this version of flyer."""
    site = place / "env" / "lib" / f"python3.{sys.version_info.minor}" / "site-packages"
    (site / "flyer-1.dist-info").mkdir(parents=True)
    (site / "flyer-1.dist-info" / "METADATA").write_text(f"Name: flyer\nVersion: {version}\n")
    (site / "pip-25.0.dist-info").mkdir()
    (place / "env" / "pyvenv.cfg").write_text(f"home = {sys.base_prefix}/bin\nversion = 3.{sys.version_info.minor}.1\n")
    (place / "env" / "bin").mkdir()
    (place / "env" / "bin" / "python").symlink_to(sys.executable)
    return str(place / "env" / "bin" / "python")


def test_the_error_of_a_worker_is_the_cause(place: Path) -> None:
    """A worker's own error is the cause, though its parent's error comes last.

    The known failure is matched with the packages of the command's interpreter.
    """
    (place / "train.py").write_text(WORKER)
    done = explain("--", environment(place, "1.5"), "train.py")
    told = done.stderr.decode()
    assert done.returncode == 1
    assert b"ValueError: no wings" in done.stderr
    last = told[told.index("explain: python failed: exit code 1") :]
    assert "cause:     flyer 1 has none\n" in last
    assert "remedy:    install `flyer>=2`\n" in last
    assert "reference: https://example.org/wings\n" in last
    assert "hidden by: ConnectionResetError: [Errno 104] Connection reset by peer\n" in last
    assert f"next:      {place}/env/bin/python -m pip install 'flyer>=2'\n" in last
    kept = Path(last.rpartition("output:")[2].strip())
    assert kept.parent == place / "state" / "outputs"
    assert "ValueError: no wings" in kept.read_text()


def test_other_versions_speak_against_a_cause(place: Path) -> None:
    """Installed versions that contradict a known failure make the cause unknown; the answer says how to go on."""
    done = explain("--", environment(place, "2.1"), "-c", "raise ValueError('no wings')")
    assert done.returncode == 1
    assert b"failed:    ValueError: no wings" in done.stderr
    assert b"cause:     unknown: no known failure fits" in done.stderr
    assert b"search for: ValueError: no wings" in done.stderr


def test_a_command_that_works_is_not_spoken_of(place: Path) -> None:
    """A command that works leaves nothing behind: its streams stay apart, and it reads stdin."""
    done = explain(*python("import sys; print(sys.stdin.read()); print('err', file=sys.stderr)"), given="given\n")
    assert (done.returncode, done.stdout, done.stderr) == (0, b"given\n\n", b"err\n")
    assert list((place / "state").rglob("*.log")) == []


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize(
    ("command", "code"),
    [
        (python("import sys; sys.exit(37)"), 37),
        (python("import os; os.kill(os.getpid(), 11)"), 139),
        (python("import os; os.abort()"), 134),
        (("--", "/nowhere/at/all"), 127),
        (("--", "/"), 126),
        (("--", "sh", "-c", "exit 3"), 3),
    ],
    ids=["exit", "segfault", "abort", "missing", "folder", "shell"],
)
def test_the_exit_code_is_the_command_s(command: tuple[str, ...], code: int) -> None:
    """The exit code is the command's, in the form of a shell."""
    assert explain(*command).returncode == code


@pytest.mark.usefixtures("place")
def test_json_has_stdout_for_itself() -> None:
    """With `--json` the command's stdout goes to stderr."""
    done = explain("--json", *python("print('out', flush=True); raise ValueError('no wings')"))
    made = json.loads(done.stdout)
    assert done.returncode == 1
    assert done.stderr.startswith(b"out\n")
    assert (made["schema"], made["decisive"]) == (1, "ValueError: no wings")
    assert json.loads(explain("--json", *python("1")).stdout)["diagnoses"] == []


def test_options_of_the_command_are_the_command_s(place: Path) -> None:
    """Options after the command belong to it, also those that look like ours and a second `--`."""
    (place / "show.py").write_text("import sys; print(sys.argv[1:])")
    done = explain("--", sys.executable, "show.py", "--json", "--python", "x", "--", "-h")
    assert done.stdout == b"['--json', '--python', 'x', '--', '-h']\n"


def test_a_command_runs_without_a_state_folder(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If no state folder can be written, the command runs, and its output is kept in a temporary file."""
    monkeypatch.setenv("HARNESS_STATE", os.devnull + "/state")
    monkeypatch.setenv("TMPDIR", str(place))
    done = explain(*python("print('out'); raise SystemExit(5)"))
    assert (done.returncode, done.stdout) == (5, b"out\n")
    kept = Path(done.stderr.decode().rpartition("output:")[2].strip())
    assert (kept.parent, kept.read_text()) == (place, "out\n")


@pytest.mark.usefixtures("place")
def test_big_output_passes_whole() -> None:
    """A big output is shown and kept whole, and need not be text."""
    code = "import os; os.write(1, bytes(range(256)) * 40_000); raise ValueError('no wings')"
    done = explain(*python(code))
    assert done.stdout == bytes(range(256)) * 40_000
    kept = Path(done.stderr.decode().rpartition("output:")[2].strip())
    assert kept.stat().st_size > 256 * 40_000


def test_the_order_of_both_streams_stays(place: Path) -> None:
    """If both streams go to one place, their order is kept."""
    code = "import os\nfor n in range(500): os.write(1 + n % 2, b'%d\\n' % n)\nraise SystemExit(1)"
    with (place / "out").open("wb") as out:
        subprocess.run(
            [sys.executable, "-m", "harness", "explain", *python(code)], stdout=out, stderr=out, timeout=60, check=False
        )
    lines = (place / "out").read_bytes().split(b"\n")[:500]
    assert lines == [b"%d" % n for n in range(500)]


@pytest.mark.usefixtures("place")
def test_children_that_outlive_the_command_write_on() -> None:
    """Children that outlive the command go on writing; their output comes through and is kept."""
    late = "import time; time.sleep(2); print('late')"
    code = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {late!r}]); sys.exit(1)"
    process = subprocess.Popen(
        [sys.executable, "-m", "harness", "explain", *python(code)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    output, told = process.communicate(timeout=60)
    assert (process.returncode, output) == (1, b"late\n")
    assert Path(told.decode().rpartition("output:")[2].strip()).read_bytes() == b"late\n"


@pytest.mark.usefixtures("place")
def test_nobody_looks_any_more() -> None:
    """If the reader of the output closes it (`| head`), the command gets a broken pipe, as it would without us."""
    code = "import os\nwhile True: os.write(1, b'y\\n' * 1000)"
    process = subprocess.Popen(
        [sys.executable, "-m", "harness", "explain", *python(code)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    with process:
        assert process.stdout
        process.stdout.read(10)
        process.stdout.close()
        assert process.stderr
        told = process.stderr.read()
    assert process.returncode == 1
    assert b"BrokenPipeError" in told


@pytest.mark.usefixtures("place")
def test_a_terminal_stays_a_terminal() -> None:
    """In a terminal the command has a terminal of the same size, and gets the typed input."""
    code = (
        "import os, sys; print(sys.stdout.isatty(), sys.stderr.isatty(), sys.stdin.isatty(),"
        " os.get_terminal_size().columns); print(input()[::-1]); sys.exit(3)"
    )
    code_out, output = in_terminal([sys.executable, "-m", "harness", "explain", *python(code)], b"hello\n")
    assert code_out == 3
    assert b"True True True 91\r\n" in output
    assert b"olleh\r\n" in output
    assert b"explain: python" in output


@pytest.mark.usefixtures("place")
def test_ctrl_c_goes_to_the_command() -> None:
    """Ctrl-C goes to the command, which handles it; its own exit code is returned."""
    code = (
        "import os, signal, sys, time; signal.signal(2, lambda *_: (os.write(1, b'cleaned up\\n'), sys.exit(9)));"
        " os.write(1, b'ready'); time.sleep(50)"
    )
    code_out, output = in_terminal([sys.executable, "-m", "harness", "explain", *python(code)], b"\x03", after=b"ready")
    assert (code_out, output.partition(b"explain:")[0].count(b"cleaned up\r\n")) == (9, 1)


@pytest.mark.usefixtures("place")
def test_an_interruption_is_not_explained() -> None:
    """A command ended by Ctrl-C is not explained."""
    done = explain(*python("import os, signal; signal.signal(2, signal.SIG_DFL); os.kill(os.getpid(), 2)"))
    assert (done.returncode, b"cause" in done.stderr) == (130, False)


@pytest.mark.usefixtures("place")
def test_a_signal_to_us_ends_the_command() -> None:
    """SIGTERM is passed on to the command, and the exit code says so."""
    code = "import os, time; print(os.getpid(), flush=True); time.sleep(50)"
    process = subprocess.Popen(
        [sys.executable, "-m", "harness", "explain", *python(code)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout
    child = int(process.stdout.readline())
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGTERM
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)


def in_terminal(argv: list[str], typed: bytes, after: bytes = b"") -> tuple[int, bytes]:
    """Run a command in a terminal of 91 columns, and type something once it has written `after`.

    Return its code and output.
    """
    pid, terminal = pty.fork()
    if pid == 0:
        os.execv(argv[0], argv)
    import fcntl
    import struct
    import termios

    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 91, 0, 0))
    output, sent, until = b"", False, time.monotonic() + 60
    while time.monotonic() < until:
        if after in output and not sent:
            sent = os.write(terminal, typed) > 0
        try:
            piece = os.read(terminal, 4096)
        except OSError:
            break
        output += piece
    _, status = os.waitpid(pid, 0)
    os.close(terminal)
    return os.waitstatus_to_exitcode(status), output


# --- texts -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["file", "dash", "stdin"])
def test_a_text_is_explained(place: Path, how: str) -> None:
    """A text from a file or stdin is explained on stdout, with code 0 if the cause is known."""
    (place / "a.log").write_text("flyer==1.0\nValueError: no wings\n")
    text = (place / "a.log").read_bytes()
    done = explain(*{"file": ["a.log"], "dash": ["-"], "stdin": []}[how], given=b"" if how == "file" else text)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"cause:     flyer 1 has none\n" in done.stdout


@pytest.mark.usefixtures("place")
def test_unknown_is_an_answer() -> None:
    """A failure without a known cause is answered with the decisive line, "unknown" and code 1."""
    done = explain(given="Traceback (most recent call last):\n  File \"a.py\", line 1, in f\nKeyError: 'x'\n")
    assert done.returncode == 1
    assert done.stdout.decode().splitlines()[:2] == [
        "failed:    KeyError: 'x' (in single)",
        "cause:     unknown: no known failure fits",
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("no.log",), "simmatrix: explain: no.log: cannot be read: No such file or directory\n"),
        (("-",), "simmatrix: explain: stdin is empty; give the complete output of the failed command\n"),
        (("--python", "/nowhere", "a.log"), "simmatrix: explain --python /nowhere: there is no Python; name an"
         " interpreter or the folder of an environment\n"),
        (("--",), "simmatrix: explain: there is no command after --\n"),
        (("a.log", "--", "true"), "simmatrix: explain: a FILE or a command, not both: a.log stands before --\n"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_one_line(place: Path, arguments: tuple[str, ...], message: str) -> None:
    """Bad input is reported in one line, with code 2."""
    (place / "a.log").write_text("ValueError: no wings\n")
    done = explain(*arguments)
    assert (done.returncode, done.stderr.decode()) == (2, message)
