"""A run that is ended in the middle leaves no process, and the next one goes on from there."""

from __future__ import annotations

import shutil
import signal

import pytest
from commandline import PATIENCE, Desk, Ran, processes_of, wait_for

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
        (signal.SIGINT, 130, "simmatrix: interrupted; finished cells are kept, the same command goes on from there\n"),
        (signal.SIGTERM, 143, "simmatrix: terminated; finished cells are kept, the same command goes on from there\n"),
        (signal.SIGKILL, -signal.SIGKILL, ""),
    ],
    ids=["SIGINT", "SIGTERM", "SIGKILL"],
)
def test_ended_in_the_middle(desk: Desk, number: signal.Signals, code: int, said: str) -> None:
    """The first cell is done and kept, the second is in the middle of a step, the third was not begun."""
    matrix = desk.matrix("m", MATRIX)
    with desk.started("run", matrix, "-j", "1", "--json", FAKE_MARK=desk.mark) as process:
        assert process.stderr
        told = process.stderr.readline()
        wait_for((desk.folder / "gate.reached").exists)
        assert len(processes_of(desk.mark)) >= 4
        process.send_signal(number)
        out, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, out, err) == (code, "", said)
    assert "first: works" in told
    assert not any(desk.state.glob("cells/*/m/*-second.json"))
    wait_for(lambda: not processes_of(desk.mark))
    (desk.folder / "gate").touch()
    cells = desk.run("run", matrix, "-j", "1", "--json").cells("which")
    assert [(cell["verdict"], cell["reused"]) for cell in cells.values()] == [
        ("works", True),
        ("works", False),
        ("works", False),
    ]


def test_a_timeout_is_never_reused(desk: Desk) -> None:
    """What did not end in time may do so the next time: it is measured again."""
    text = MATRIX.replace('Gate-v0", api', 'Gate-v0", timeouts = { single = 1 }, api')
    matrix = desk.matrix("m", text)
    first = desk.run("run", matrix, "-k", "*-second", "--json").cells("which")["second"]
    (desk.folder / "gate").touch()
    second = desk.run("run", matrix, "-k", "*-second", "--json").cells("which")["second"]
    assert (first["verdict"], first["phases"]["single"]) == ("broken", "timed_out")
    assert (second["verdict"], second["reused"]) == ("works", False)


def test_bytecode_that_a_full_disk_cut_short(desk: Desk) -> None:
    """It is compiled anew, and no package is blamed for it."""
    matrix = desk.matrix("m", MATRIX)
    cache = desk.folder / "cache"
    desk.run("run", matrix, "-k", "*-first", "--json", HARNESS_CACHE=str(cache))
    kept = list((cache / "pycache").rglob("fake_healthy*.pyc"))
    for path in kept:
        path.write_bytes(path.read_bytes()[:40])
    cell = desk.run("run", matrix, "-k", "*-first", "--fresh", "--json", HARNESS_CACHE=str(cache)).cells("which")[
        "first"
    ]
    assert kept
    assert (cell["verdict"], cell["reused"]) == ("works", False)
    assert all(path.stat().st_size > 40 for path in kept)


def test_an_environment_that_goes_while_it_is_used_blames_nothing(desk: Desk) -> None:
    """What fails in an environment that somebody removed meanwhile says nothing of packages, and is not kept."""
    text = MATRIX.replace('Gate-v0", api', 'Gate-v0", timeouts = { single = 2 }, api')
    matrix, cache = desk.matrix("m", text), desk.folder / "cache"
    asked = ("run", matrix, "-k", "*-second", "--json")
    with desk.started(*asked, HARNESS_CACHE=str(cache)) as process:
        wait_for((desk.folder / "gate.reached").exists)
        (environment,) = (path for path in cache.glob("environments/*") if path.is_dir())
        shutil.rmtree(environment / "lib")
        out, err = process.communicate(timeout=PATIENCE)
    cell = Ran(code=process.returncode, out=out, err=err).cells("which")["second"]
    assert (cell["verdict"], cell["phases"]["single"]) == ("inconclusive", "infra")
    assert cell["decisive"] == "the environment was taken away, or changed, while it was used"
    (desk.folder / "gate").touch()
    cell = desk.run(*asked, HARNESS_CACHE=str(cache)).cells("which")["second"]
    assert (cell["verdict"], cell["reused"]) == ("works", False)
