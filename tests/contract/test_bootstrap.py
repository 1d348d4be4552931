"""The door into a cell, and what a probe tells of modules that behave badly; stand-ins are imported as libraries."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest

from harness.machine import interpreters
from harness.model import Case, Level, Outcome
from harness.running import own_suites

HERE = sys.executable


def importing(*names: str, checks: tuple[str, ...] = ("import.modules",)) -> Case:
    """Return a case that only imports."""
    return Case(id="c", env=None, api="", imports=names, checks=checks)


def write(folder: Path, **modules: str) -> None:
    """Write modules into a folder."""
    for name, source in modules.items():
        (folder / f"{name}.py").write_text(dedent(source))


WITNESS = """
    import json, os, sys
    def importable(name):
        try:
            __import__(name)
        except ImportError:
            return False
        return True
    seen = {
        "path": sys.path,
        "argv": len(sys.argv),
        "modules": sorted(sys.modules),
        "ours": [n for n in ("bootstrap", "cell_run", "api_gymnasium", "check_import_modules") if importable(n)],
    }
    with open(os.environ["SEEN"], "w") as file:
        json.dump(seen, file)
"""


def test_nothing_of_ours_can_be_imported(probe, tmp_path: Path) -> None:
    """The in-cell folder is not on `sys.path`, none of its modules has a top-level name, arguments are taken away."""
    write(tmp_path, witness=WITNESS)
    assert probe(HERE, importing("witness"), variables={"SEEN": str(tmp_path / "seen")}).reply.complete
    seen = json.loads((tmp_path / "seen").read_text())
    assert [entry for entry in seen["path"] if "incell" in entry] == []
    assert seen["ours"] == []
    assert seen["argv"] == 1


def test_forgotten_imports_stay_forgotten(probe, tmp_path: Path) -> None:
    """Before the library is imported nothing is loaded that libraries use and forget to import."""
    write(tmp_path, witness=WITNESS)
    assert probe(HERE, importing("witness"), variables={"SEEN": str(tmp_path / "seen")}).reply.complete
    seen = set(json.loads((tmp_path / "seen").read_text())["modules"])
    forgotten = {
        "importlib.resources",
        "importlib.metadata",
        "multiprocessing",
        "concurrent.futures",
        "xml.etree",
        "numpy",
    }
    assert seen & forgotten == set()


def test_a_library_that_closes_every_descriptor(probe, tmp_path: Path) -> None:
    """The reply goes on, and not into a file that got the number of ours."""
    write(tmp_path, closer="import os; os.closerange(3, 256); kept = [open(os.environ['LOG'], 'w') for _ in range(20)]")
    done = probe(HERE, importing("closer"), variables={"LOG": str(tmp_path / "log")})
    assert done["import.modules"].outcome is Outcome.PASSED
    assert done.reply.complete
    assert (tmp_path / "log").read_text() == ""


SPAWNER = """
    import multiprocessing, sys
    from job import look
    if __name__ == "spawner" and multiprocessing.current_process().name == "MainProcess":
        for method in ("spawn", "forkserver"):
            with multiprocessing.get_context(method).Pool(1) as pool:
                entries, main, entered = pool.apply(look)
            assert not [entry for entry in entries if "incell" in entry], entries
            assert main == "__mp_main__" and entered, (main, entered)
"""
JOB = """
    import sys
    def look():
        main = sys.modules["__main__"]
        return sys.path, main.__name__, "_simmatrix_cell" in sys.modules
"""


def test_children_go_through_the_same_door(probe, tmp_path: Path) -> None:
    """Spawned and forkserver children have the package, and not our folder on `sys.path`; they run no checks."""
    write(tmp_path, spawner=SPAWNER, job=JOB)
    done = probe(HERE, importing("spawner"))
    assert done["import.modules"].raised is None
    assert (done.reply.problems, done.reply.complete) == ((), True)


NOISY = """
    import os, sys
    print('{"kind": "end", "seq": 3, "pid": 1, "modules": [], "versions": {}}', flush=True)
    os.write(1, b"\\xff\\x00" * 100000)
    if os.fork() == 0:
        if os.fork() == 0:
            raise RuntimeError("a grandchild comes back")
        sys.exit(5)
    os.wait()
"""


def test_reply_is_pure(probe, tmp_path: Path) -> None:
    """Neither what is printed nor forked children that come back get into the reply."""
    write(tmp_path, noisy=NOISY)
    done = probe(HERE, importing("noisy"))
    assert (done.reply.problems, done.reply.complete) == ((), True)
    assert [(reply.check, reply.outcome) for reply in done.reply.checks] == [("import.modules", Outcome.PASSED)]
    assert done.returncode == 0


@pytest.mark.parametrize(
    ("source", "type_", "message"),
    [
        ("raise ValueError('wrong')", "ValueError", "wrong"),
        ("raise SystemExit(3)", "SystemExit", "3"),
        ("raise KeyboardInterrupt", "KeyboardInterrupt", ""),
        ("import no_such_module", "ModuleNotFoundError", "No module named 'no_such_module'"),
        ("class Own(Exception): pass\nraise Own('\\udcff \\x00')", "broken.Own", "\\udcff \x00"),
        (
            "class Mute(Exception):\n    def __str__(self): 1 / 0\nraise Mute",
            "broken.Mute",
            "(its message cannot be had)",
        ),
    ],
    ids=["exception", "exit", "interrupt", "missing", "odd text", "no text"],
)
def test_failures_are_data(source: str, type_: str, message: str, probe, tmp_path: Path) -> None:
    """Whatever a library raises is told as the library's, and the reply ends as it should."""
    write(tmp_path, broken=source)
    done = probe(HERE, importing("broken"))
    raised = done["import.modules"].raised
    assert raised is not None
    assert (raised.type, raised.message, raised.blame) == (type_, message, "library")
    assert "broken.py" in raised.traceback
    assert (done.reply.problems, done.reply.complete, done.returncode) == ((), True, 0)


def test_messages_are_bounded(probe, tmp_path: Path) -> None:
    """A message of a megabyte keeps its beginning and its end."""
    write(tmp_path, broken="raise ValueError('first' + 'x' * 1000000 + 'last')")
    raised = probe(HERE, importing("broken"))["import.modules"].raised
    assert raised is not None
    assert len(raised.message) <= 20_000
    assert (raised.message[:5], raised.message[-4:]) == ("first", "last")


def test_own_faults_are_ours(probe) -> None:
    """A check that does not exist is blamed on the harness."""
    raised = probe(HERE, importing("json", checks=("import.nothing",)))["import.nothing"].raised
    assert raised is not None
    assert (raised.type, raised.blame) == ("ModuleNotFoundError", "harness")


def test_import_comes_first(probe, tmp_path: Path) -> None:
    """After a failed import the other checks are not even started."""
    write(tmp_path, broken="1 / 0")
    done = probe(HERE, importing("broken", checks=("import.modules", "single.loop")))
    assert [reply.check for reply in done.reply.checks] == ["import.modules"]
    assert done.reply.complete


def test_no_environment_is_skipped(probe) -> None:
    """A check of an environment has no meaning in a case without one."""
    reply = probe(HERE, importing("json", checks=("single.loop",)))["single.loop"]
    assert (reply.outcome, reply.reason) == (Outcome.SKIPPED, "no environment was asked for")


def test_deprecations_are_notes(probe, tmp_path: Path) -> None:
    """Each text of a deprecation warning at import is one note, of which there are at most ten and a last word."""
    write(
        tmp_path,
        old="""
        import warnings
        for number in [0, 0] + list(range(30)):
            warnings.warn("thing %d is old" % number, DeprecationWarning)
        """,
    )
    findings = probe(HERE, importing("old")).reply.findings
    assert [finding.text for finding in findings] == [f"thing {n} is old" for n in range(10)] + [
        "and more of this kind"
    ]
    assert {(finding.check, finding.level) for finding in findings} == {("import.deprecation", Level.NOTE)}


def test_ignored_exceptions_are_findings(probe, tmp_path: Path) -> None:
    """An exception raised in `__del__` appears in the findings, and nowhere else."""
    write(
        tmp_path,
        littering="""
        class Litter:
            def __del__(self):
                raise RuntimeError("too late")
        litter = Litter()
        litter.itself = litter
        del litter
        """,
    )
    done = probe(HERE, importing("littering"))
    assert done.findings == {"import.teardown": ["exception ignored in Litter.__del__: RuntimeError: too late"]}


def test_death_leaves_the_check_open(probe, tmp_path: Path) -> None:
    """A crash leaves a started check without outcome, no last line, and stacks."""
    write(tmp_path, crashing="import ctypes\nctypes.string_at(0)")
    done = probe(HERE, importing("crashing"))
    assert (done["import.modules"].outcome, done.reply.complete, done.returncode) == (None, False, -11)
    stacks = (done.folder / "stacks.txt").read_text()
    assert stacks.startswith("Fatal Python error: Segmentation fault")
    assert "crashing.py" in stacks


def test_slowness_leaves_stacks(probe, tmp_path: Path) -> None:
    """Stacks are written after nine tenths of a limit, and the check goes on."""
    write(tmp_path, slow="import time\ntime.sleep(1)")
    done = probe(HERE, importing("slow"), limit=0.2)
    assert done["import.modules"].outcome is Outcome.PASSED
    assert "slow.py" in (done.folder / "stacks.txt").read_text()


@pytest.mark.parametrize("version", ["3.7", "3.13"])
def test_forked_children_can_end(version: str, probe, tmp_path: Path) -> None:
    """The watch over the limit does not keep a forked child from ending, nor make Python 3.12 warn of the fork."""
    python = interpreters.find(version)
    if python is None:
        pytest.skip(f"unavailable: python{version}")
    write(
        tmp_path,
        forking="""
        import ctypes, os
        child = os.fork()
        if child == 0:
            ctypes.pythonapi.Py_Exit(4)
        assert os.WEXITSTATUS(os.waitpid(child, 0)[1]) == 4
        """,
    )
    done = probe(python.path, importing("forking"), deadline=20)
    assert done["import.modules"].outcome is Outcome.PASSED
    assert done.findings == {}


def test_the_door_of_suites_tells_of_every_module(tmp_path: Path) -> None:
    """A package without a file of its own is told by what was imported of it."""
    write(tmp_path, test_it="import spc.own\ndef test_one(): assert spc.own.A == 1\n")
    (tmp_path / "spc").mkdir()
    write(tmp_path / "spc", own="A = 1\n")
    command = (
        HERE,
        str(own_suites.DOOR),
        str(tmp_path / "told"),
        "spc,absent",
        "-q",
        f"--rootdir={tmp_path}",
        "test_it.py",
    )
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False).returncode

    assert ended == 0
    assert (tmp_path / "told").read_text() == f"spc\t\nspc.own\t{tmp_path}/spc/own.py\n"
