"""Our own display is reachable from a cell's sandbox, and ends with the process that started it."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from spine.commandline import closed_network, processes_of

from harness.machine import display, gl_probe, this_machine
from harness.machine.process import Command, Limits, Profile, run
from harness.model import replace
from harness.standalone.failures.lines import normalise

PROBE = str(Path(gl_probe.__file__))
KEEPING = """
import sys, time
from pathlib import Path
from harness.machine.display import open_display
from harness.machine.process import Command, Limits, Profile

folder = Path(sys.argv[1])
env, limits = {"DISPLAY": "virtual"}, Limits(seconds=1)
command = Command(argv=(), cwd=folder, env=env, limits=limits, log=folder / "log", profile=Profile.HOST)
with open_display(command, folder):
    print("there", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def xvfb() -> None:
    """Skip the test if Xvfb, an X server without a screen, is missing."""
    if display.program() is None:
        pytest.skip("missing library: xvfb")


def asking(folder: Path) -> Command:
    """Return a command that examines OpenGL on its display, in a sandbox like a cell's.

    It writes to `answer.json`.
    """
    (folder / "home").mkdir()
    return Command(
        argv=(sys.executable, "-I", "-S", PROBE, "display", str(folder / "answer.json")),
        cwd=folder / "home",
        env={**this_machine.base_environment(), "DISPLAY": "virtual"},
        limits=Limits(seconds=60),
        log=folder / "log.txt",
        profile=Profile.CELL,
        home=folder / "home",
    )


def server(folder: Path, script: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a program called Xvfb first on PATH."""
    program = folder / "Xvfb"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(folder))


@pytest.mark.usefixtures("xvfb")
class TestReach:
    def test_from_the_sandbox(self, tmp_path: Path) -> None:
        """A cell with processes, mounts and a TMPDIR of its own makes an OpenGL context on it."""
        with display.open_display(asking(tmp_path), tmp_path / "display") as seen:
            run(seen.command)
            lost = seen.lost()
            socket = display.SOCKETS / f"X{seen.command.env['DISPLAY'].removeprefix(':')}"
            there = socket.exists()

        assert '"version":' in (tmp_path / "answer.json").read_text()
        assert lost is None
        assert (there, socket.exists()) == (True, False)

    def test_not_by_others(self, tmp_path: Path) -> None:
        """A client without the cookie is rejected."""
        with display.open_display(asking(tmp_path), tmp_path / "display") as seen:
            run(replace(seen.command, env={**seen.command.env, "XAUTHORITY": "/nowhere"}))
            name = seen.command.env["DISPLAY"]

        assert (tmp_path / "answer.json").read_text() == f'{{"missing": "nothing answers at DISPLAY={name}"}}'

    def test_two_at_once(self, tmp_path: Path) -> None:
        """Each probe has its own display with its own number, which is not part of the evidence."""
        told = asking(tmp_path)
        with display.open_display(told, tmp_path / "a") as one, display.open_display(told, tmp_path / "b") as other:
            name = one.command.env["DISPLAY"]
            assert name != other.command.env["DISPLAY"]
            assert normalise(f'Cannot connect to "{name}"', one.places) == 'Cannot connect to ":0"'

    def test_another_namespace_of_the_network(self, tmp_path: Path) -> None:
        """A server takes no socket from a server in another network namespace: ours stays during and after it."""
        prefix = closed_network()
        if not prefix:
            pytest.skip("unavailable: namespaces")
        argv = (*prefix, sys.executable, "-c", KEEPING, str(tmp_path / "other"))
        (tmp_path / "other").mkdir()
        with display.open_display(asking(tmp_path), tmp_path / "display") as seen:
            socket = display.SOCKETS / f"X{seen.command.env['DISPLAY'].removeprefix(':')}"
            before = socket.stat().st_ino
            with subprocess.Popen(argv, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True) as other:
                assert other.stdout
                assert other.stdout.readline() == "there\n"
                during = socket.stat().st_ino
                other.send_signal(signal.SIGINT)
            after = socket.stat().st_ino

        assert before == during == after


@pytest.mark.usefixtures("xvfb")
def test_ends_with_the_harness(tmp_path: Path) -> None:
    """No process of the display is left after the harness is killed."""
    mark = f"MESA_MARK={tmp_path}"
    argv = (sys.executable, "-c", KEEPING, str(tmp_path))
    with subprocess.Popen(
        argv, stdout=subprocess.PIPE, text=True, env={"MESA_MARK": str(tmp_path), "PATH": "/usr/bin"}
    ) as one:
        assert one.stdout
        assert one.stdout.readline() == "there\n"
        before = processes_of(mark)
        one.kill()
    until = time.monotonic() + 10
    while processes_of(mark) and time.monotonic() < until:
        time.sleep(0.05)

    assert len(before) >= 2
    assert processes_of(mark) == []


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("echo starting; echo 'no screens found' >&2; exit 1", "Xvfb ended with exit code 1: no screens found"),
        ("kill -11 $$", "Xvfb crashed with signal 11"),
    ],
)
def test_a_display_that_does_not_start_is_reported_in_its_own_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, reason: str
) -> None:
    """A display that does not start is reported in the server's own words."""
    server(tmp_path, script, monkeypatch)

    with pytest.raises(display.NoDisplayError) as caught, display.open_display(asking(tmp_path), tmp_path / "display"):
        pass

    assert str(caught.value) == reason


def test_a_display_that_ends_too_early_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A display that ends too early is lost, and its exit code is reported."""
    server(tmp_path, "echo 77 >&3; exit 3", monkeypatch)

    with display.open_display(asking(tmp_path), tmp_path / "display") as seen:
        while not seen.lost():
            time.sleep(0.01)

        assert (seen.command.env["DISPLAY"], seen.lost()) == (":77", "the virtual display ended with exit code 3")


def test_one_that_was_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A display named by a matrix is opened with the user's authority file, by default the usual one."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XAUTHORITY", raising=False)
    (tmp_path / ".Xauthority").touch()

    with display.open_display(replace(asking(tmp_path), env={"DISPLAY": ":4"}), tmp_path / "display") as seen:
        assert seen.command.env == {"DISPLAY": ":4", "XAUTHORITY": str(tmp_path / ".Xauthority")}
