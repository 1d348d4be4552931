"""A run that is stopped in the middle leaves no process, and the next run continues from there."""

from __future__ import annotations

import os
import pty
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from commandline import PATIENCE, CommandResult, Desk, find_descendants, processes_of, wait_for

MATRIX = """
requirements = [@FAKES@]
index = { no_index = true, find_links = ["@WHEELS@"] }
environment = { FAKE_GATE = "@FOLDER@/gate", FAKE_MARK = "@MARK@" }

[axes]
python = ["host"]

[axes.which.first]
cases = [{ env = "fake_healthy:Healthy-v0", api = "gymnasium" }]

[axes.which.second]
cases = [{ env = "fake_gate:Gate-v0", api = "gymnasium" }]

[axes.which.third]
cases = [{ env = "fake_pictureless:Pictureless-v0", api = "gymnasium" }]
"""


@pytest.mark.parametrize(
    ("number", "code", "said"),
    [
        (
            signal.SIGINT,
            130,
            "simmatrix: interrupted; finished results are kept, and the same command continues from there\n",
        ),
        (
            signal.SIGTERM,
            143,
            "simmatrix: terminated; finished results are kept, and the same command continues from there\n",
        ),
        (
            signal.SIGHUP,
            143,
            "simmatrix: terminated; finished results are kept, and the same command continues from there\n",
        ),
        (signal.SIGKILL, -signal.SIGKILL, ""),
    ],
    ids=["SIGINT", "SIGTERM", "SIGHUP", "SIGKILL"],
)
def test_ended_in_the_middle(desk: Desk, number: signal.Signals, code: int, said: str) -> None:
    """A signal ends a run in its second cell: the finished cell is kept, the other two are measured later."""
    matrix = desk.matrix("m", MATRIX)
    with desk.started("run", matrix, "-j", "1", "--json", FAKE_MARK=desk.mark) as process:
        assert process.stderr
        told = process.stderr.readline()
        wait_for((desk.folder / "gate.reached").exists)
        started = find_descendants(process.pid)
        assert len(started) >= 3
        assert {*started} & {*processes_of(desk.mark)}
        process.send_signal(number)
        out, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, out, err) == (code, "", said)
    assert "first: works" in told
    assert not any(desk.state.glob("cells/*/m/*-second.json"))
    wait_for(lambda: not processes_of(desk.mark) and not any(Path(f"/proc/{pid}").exists() for pid in started))
    (desk.folder / "gate").touch()
    cells = desk.run("run", matrix, "-j", "1", "--json").cells("which")
    assert [(cell["verdict"], cell["reused"]) for cell in cells.values()] == [
        ("works", True),
        ("works", False),
        ("works", False),
    ]


def test_a_timeout_is_never_reused(desk: Desk) -> None:
    """A cell that timed out is measured again: it may end in time."""
    text = MATRIX.replace('Gate-v0", api', 'Gate-v0", timeouts = { single = 1 }, api')
    matrix = desk.matrix("m", text)
    first = desk.run("run", matrix, "-k", "*-second", "--json").cells("which")["second"]
    (desk.folder / "gate").touch()
    second = desk.run("run", matrix, "-k", "*-second", "--json").cells("which")["second"]
    assert (first["verdict"], first["phases"]["single"]) == ("broken", "timed_out")
    assert (second["verdict"], second["reused"]) == ("works", False)


def test_bytecode_that_a_full_disk_cut_short(desk: Desk) -> None:
    """Truncated bytecode is compiled again, and no package is blamed for it."""
    matrix = desk.matrix("m", MATRIX)
    cache = desk.folder / "cache"
    asked = ("run", matrix, "-k", "*-first", "--json")
    for options in ((), ("--fresh",)):  # the first notes what is needed, the next has it compiled
        desk.run(*asked, *options, HARNESS_CACHE=str(cache))
    kept = [path for path in (cache / "pycache").rglob("code") if path.is_file()]
    for path in kept:
        path.write_bytes(path.read_bytes()[:100])
    cell = desk.run(*asked, "--fresh", HARNESS_CACHE=str(cache)).cells("which")["first"]
    assert kept
    assert (cell["verdict"], cell["reused"]) == ("works", False)


def test_an_environment_that_goes_while_it_is_used_blames_nothing(desk: Desk) -> None:
    """An environment that was deleted during a run is made again, and the case is measured again in that run."""
    text = MATRIX.replace('Gate-v0", api', 'Gate-v0", timeouts = { single = 2 }, api')
    matrix, cache = desk.matrix("m", text), desk.folder / "cache"
    with desk.started("run", matrix, "-k", "*-second", "--json", HARNESS_CACHE=str(cache)) as process:
        wait_for((desk.folder / "gate.reached").exists)
        (environment,) = (path for path in cache.glob("environments/*") if path.is_dir())
        shutil.rmtree(environment / "lib")
        (desk.folder / "gate.reached").unlink()
        wait_for((desk.folder / "gate.reached").exists)  # which takes an environment with all that it needs
        (desk.folder / "gate").touch()
        out, err = process.communicate(timeout=PATIENCE)
    cell = CommandResult(code=process.returncode, out=out, err=err).cells("which")["second"]
    assert (cell["verdict"], cell["reused"]) == ("works", False)


KILLED = "killed by SIGKILL, by whom cannot be told: perhaps the system for want of memory, a service or a person"


def probe_of(desk: Desk) -> int:
    """Return the id of the probe of the waiting cell: the only marked process that runs `bootstrap.py`."""
    wait_for(lambda: any(b"bootstrap.py" in command(pid) for pid in processes_of(desk.mark)))
    return next(pid for pid in processes_of(desk.mark) if b"bootstrap.py" in command(pid))


def command(pid: int) -> bytes:
    """Return the command line of a process, or nothing if it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("sandbox", ["", "subreaper"])
def test_a_probe_that_somebody_kills(desk: Desk, times: int, sandbox: str) -> None:
    """A killed probe is run once more; killed twice it is inconclusive, blames no package, and is not reused."""
    matrix = desk.matrix("m", MATRIX)
    asked = ("run", matrix, "-k", "*-second", "--json")
    with desk.started(*asked, HARNESS_SANDBOX=sandbox) as process:
        for _ in range(times):
            wait_for((desk.folder / "gate.reached").exists)
            (desk.folder / "gate.reached").unlink()
            os.kill(probe_of(desk), signal.SIGKILL)
        if times == 1:
            (desk.folder / "gate").touch()
        out, err = process.communicate(timeout=PATIENCE)
    cell = CommandResult(code=process.returncode, out=out, err=err).cells("which")["second"]
    if times == 1:
        assert (cell["verdict"], cell["attempts"]) == ("works", 2)
        return
    assert (process.returncode, cell["verdict"], cell["phases"]["single"]) == (3, "inconclusive", "infra")
    assert cell["decisive"] == KILLED
    (desk.folder / "gate").touch()
    cell = desk.run(*asked, HARNESS_SANDBOX=sandbox).cells("which")["second"]
    assert (cell["verdict"], cell["reused"]) == ("works", False)


def test_a_closed_terminal(desk: Desk) -> None:
    """A closed terminal (an ssh session that ends) ends a run like any signal: finished cells are kept."""
    matrix = desk.matrix("m", MATRIX)
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(desk.folder)
        words = (sys.executable, "-m", "harness", "run", str(matrix), "-j", "1")
        os.execve(words[0], words, desk.environment({"FAKE_MARK": desk.mark}))
    wait_for((desk.folder / "gate.reached").exists)
    os.close(terminal)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    wait_for(lambda: not processes_of(desk.mark))
    (desk.folder / "gate").touch()
    cells = desk.run("run", matrix, "-j", "1", "--json").cells("which")
    assert code == 143
    assert [(cell["verdict"], cell["reused"]) for cell in cells.values()][:2] == [("works", True), ("works", False)]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_at_the_first_moment(desk: Desk, number: signal.Signals) -> None:
    """A signal during start-up ends the command with its sentence, never with a traceback."""
    matrix = desk.matrix("m", MATRIX)
    said = "simmatrix: terminated; finished results are kept, and the same command continues from there\n"
    ended = []
    for milliseconds in range(20, 140, 15):
        with desk.started("run", matrix, "--json", FAKE_MARK=desk.mark) as process:
            time.sleep(milliseconds / 1000)
            process.send_signal(number)
            out, err = process.communicate(timeout=PATIENCE)
        ended.append((process.returncode, out, err))
    wait_for(lambda: not processes_of(desk.mark))
    before_python = (-number, "", "")  # while Python itself, or what closes the network, is loaded
    assert set(ended) - {before_python} == {(143, "", said)}


@pytest.mark.parametrize("home", ["kept", "none"])
def test_almost_no_environment(desk: Desk, home: str) -> None:
    """A run works with only PATH and HOME of its caller's variables, and also without HOME."""
    matrix = desk.matrix("m", MATRIX.replace("[axes.which.second]", "[axes.which.late]"))
    given = {"PATH": os.environ["PATH"], **({"HOME": str(desk.folder)} if home == "kept" else {})}
    words = (sys.executable, "-m", "harness", "run", matrix, "-k", "*-first", "--json")
    done = subprocess.run(words, cwd=desk.folder, env=given, capture_output=True, text=True, check=False)
    cell = CommandResult(code=done.returncode, out=done.stdout, err=done.stderr).cells("which")["first"]
    assert (done.returncode, cell["verdict"]) == (0, "works")
