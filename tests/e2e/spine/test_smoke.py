"""The matrix as a pytest suite: items, workers, JUnit, a user's own functions, exit codes."""

from __future__ import annotations

import platform
import re
import signal
import xml.etree.ElementTree as ET
from time import monotonic, sleep

import pytest
from commandline import SMALL, CommandResult, Desk, processes_of

PREFIX = f"py{platform.python_version()}"
GOOD, BLANK = f"small/{PREFIX}_good", f"small/{PREFIX}_blank"
HEALTHY, FRAME = "fake_healthy-Healthy-v0", "fake_blank_frame-BlankFrame-v0"
WHY = "ContractViolation: blank frame: every pixel is [0, 0, 0]"
PHASES = ("import", "single", "vector", "render")
RED = """
[[expect]]
when = { which = "blank" }
verdict = "partial"
phase = "render"
match = "blank frame"
reason = "it paints black"
"""


def smoke(desk: Desk, *arguments: str, **variables: str) -> CommandResult:
    """Run the suite over `small.toml`."""
    return desk.run(
        "--pyargs", "harness.smoke", "--matrix", "small.toml", "-ra", *arguments, module="pytest", **variables
    )


def items(cell: str, *cases: str) -> list[str]:
    """Return the node ids of a cell with these cases."""
    names = ("resolve", "install", *(f"{case}::{phase}" for case in cases for phase in PHASES), "verdict")
    return [f"{cell}::{name}" for name in names]


def ended(ran: CommandResult, outcome: str) -> list[str]:
    """Return the lines of the summary for one outcome."""
    return re.findall(rf"(?m)^{outcome} (.*)$", ran.out)


# --- items -----------------------------------------------------------------------------------------------------


def test_items_are_cells_by_cases_by_phases(desk: Desk) -> None:
    """Items are listed in the order of the plan, and listing them resolves nothing and fetches no repository."""
    desk.matrix("small", 'subject = "git+https://nowhere.invalid/own"\n' + SMALL.read_text())
    ran = smoke(desk, "--collect-only", "-q", "--strict-markers", "-W", "error")
    assert ran.out.splitlines()[:18] == [*items(GOOD, HEALTHY), *items(BLANK, HEALTHY, FRAME)]
    assert ran.code == 0
    assert not {path.name for path in desk.state.glob("*")} & {"locks", "steps", "evidence", "results", "cells"}


def test_a_red_cell_fails_where_it_failed_and_as_a_whole(desk_with_results: Desk) -> None:
    """The message is the decisive line, the check and its evidence, without a traceback."""
    ran = smoke(desk_with_results)
    assert ran.code == 1
    assert ended(ran, "FAILED") == [f"{BLANK}::{FRAME}::render - {WHY}", f"{BLANK}::verdict - partial in render: {WHY}"]
    told = ran.out.partition(" render ___")[2].split("\n", 1)[1].splitlines()[:3]
    assert told[:2] == [WHY, "render.rgb_array failed"]
    assert (desk_with_results.folder / told[2].removeprefix("evidence: ")).is_dir()
    assert "Traceback" not in ran.out
    assert ran.out.splitlines()[-1].strip("= ").startswith("2 failed, 16 passed")


def test_an_expected_failure_is_a_strict_xfail(desk_with_results: Desk) -> None:
    """A cell that is red as expected fails nothing; one that does better fails its verdict."""
    desk_with_results.matrix("small", SMALL.read_text() + RED)
    ran = smoke(desk_with_results)
    assert (ran.code, ended(ran, "FAILED")) == (0, [])
    assert ended(ran, "XFAIL") == [
        f"{BLANK}::{FRAME}::render - {WHY} (it paints black)",
        f"{BLANK}::verdict - partial in render: it paints black",
    ]
    better = RED.replace('"blank"', '"good"', 1)
    desk_with_results.matrix(
        "small", SMALL.read_text() + RED + better + RED.replace('which = "blank"', 'which = "odd"')
    )
    ran = smoke(desk_with_results)
    assert ran.code == 1
    assert ended(ran, "FAILED") == [
        f"{GOOD}::verdict - [XPASS(strict)] {GOOD} does better than expected: works instead of partial "
        "(it paints black)",
        'small::expectations - small.toml: expect[2] matches no cell (reason: "it paints black")',
    ]


def test_another_failure_than_the_expected_one_fails(desk_with_results: Desk) -> None:
    """A failure whose line differs from the expected one is a failure."""
    desk_with_results.matrix("small", SMALL.read_text() + RED.replace('"blank frame"', '"no display"'))
    ran = smoke(desk_with_results)
    assert (ran.code, ended(ran, "XFAIL")) == (1, [])
    assert ended(ran, "FAILED") == [f"{BLANK}::{FRAME}::render - {WHY}", f"{BLANK}::verdict - partial in render: {WHY}"]


SEGFAULT = """
[axes.which.segfault]
cases = [{ env = "fake_segfault:Segfault-v0", api = "gymnasium" }]
"""
CRASHED = f"small/{PREFIX}_segfault::fake_segfault-Segfault-v0"


@pytest.mark.parametrize("workers", [(), ("-n", "2")], ids=["one", "two"])
def test_a_phase_asked_for_alone_runs_what_it_needs(workers: tuple[str, ...], desk: Desk) -> None:
    """A phase selected alone also runs what it needs; if that crashes, the selected item reports the crash."""
    desk.matrix("small", SMALL.read_text().replace("[axes.which.odd]", f"{SEGFAULT}[axes.which.odd]"))
    ran = smoke(desk, "-k", "(segfault or good) and render", "-v", *workers)
    assert ran.code == 1
    assert len(re.findall(rf"PASSED {GOOD}::{HEALTHY}::render|{GOOD}::{HEALTHY}::render PASSED", ran.out)) == 1
    (line,) = ended(ran, f"FAILED {CRASHED}::render -")
    assert line.startswith("not reached, single crashed: killed by SIGSEGV")
    assert ran.out.splitlines()[-1].strip("= ").startswith("1 failed, 2 passed")
    assert "report:" not in ran.out
    measured = [path.read_text() for path in desk.state.glob("results/*/*.json")]
    assert not [text for text in measured if '"phase":"vector"' in text]


def test_node_ids_are_arguments_as_they_are_printed(desk_with_results: Desk) -> None:
    """Node ids of items, cases and cells are arguments, though they name no file; an unknown id is a usage error."""
    asked = ("--matrix", "small.toml", "-v")
    ran = desk_with_results.run(*asked, f"{BLANK}::{FRAME}::single", f"{GOOD}::{HEALTHY}", module="pytest")
    chosen = [f"{GOOD}::{HEALTHY}::{phase}" for phase in PHASES] + [f"{BLANK}::{FRAME}::single"]
    assert re.findall(r"(?m)^(\S+::\S+) PASSED", ran.out) == chosen
    spread = desk_with_results.run(*asked, f"{BLANK}::{FRAME}::single", "-n", "1", module="pytest")
    assert (spread.code, "1 passed" in spread.out) == (0, True)
    ran = desk_with_results.run(*asked, f"small/{PREFIX}_bad::verdict", module="pytest")
    assert (ran.code, ran.err) == (4, f"ERROR: file or directory not found: small/{PREFIX}_bad::verdict\n\n")


def test_markers_choose_phases(desk_with_results: Desk) -> None:
    """`-m PHASE` selects the items of that phase, and deselected items are not judged."""
    ran = smoke(desk_with_results, "-m", "single or render", "--strict-markers")
    assert (ran.code, ended(ran, "FAILED")) == (1, [f"{BLANK}::{FRAME}::render - {WHY}"])
    assert ran.out.splitlines()[-1].strip("= ").startswith("1 failed, 5 passed, 12 deselected")


# --- workers, and what is kept ---------------------------------------------------------------------------------

WITHOUT_FILE = """
import pathlib

def pytest_configure_node(node):
    pathlib.Path("small.toml").unlink(missing_ok=True)
"""


def test_workers_need_no_matrix_and_leave_what_a_run_leaves(desk: Desk) -> None:
    """Workers get the plan from the controller; afterwards `run` finds everything measured and reports the same."""
    matrix = desk.matrix("small", SMALL.read_text() + RED)
    text = matrix.read_text()
    (desk.folder / "conftest.py").write_text(WITHOUT_FILE)
    ran = smoke(desk, "-n", "2", "-v")
    assert not matrix.exists()
    assert (ran.code, len(ended(ran, "XFAIL"))) == (0, 2)
    found = dict(re.findall(r"(?m)^\[(gw\d)\] \[ *\d+%\] \w+ (\S+?)::", ran.out))
    assert len(found) == 1  # both cells have one environment, and so one worker
    assert "simmatrix: 1 partial, 1 works; report: .harness/reports/small" in ran.out
    matrix.write_text(text)
    report = (desk.state / "reports" / "small" / "report.json").read_text()
    again = desk.run("run", "small.toml")
    assert "nothing to do: all 2 results are reused\n" in again.out
    volatile = re.compile(r'"(generated|reused)": ?[^,]*')
    assert volatile.sub("", (desk.state / "reports" / "small" / "report.json").read_text()) == volatile.sub("", report)


def test_a_cell_measured_in_part_is_no_record(desk: Desk) -> None:
    """A cell measured in part has no record and no report; its results are kept all the same."""
    desk.matrix("small", SMALL.read_text())
    ran = smoke(desk, "-k", f"{PREFIX}-good and not verdict")  # the id of earlier versions
    assert (ran.code, "report:" in ran.out) == (0, False)
    assert not list(desk.state.glob("cells/*/small"))
    assert list(desk.state.glob("vault/ac/*/*"))


def test_fresh_measures_each_case_once(desk_with_results: Desk) -> None:
    """`--matrix-fresh` measures known results again, but once for all items of a case."""
    before = runs(desk_with_results)
    ran = smoke(desk_with_results, "--matrix-fresh", "-k", "good", "--durations=0", "-n", "1")
    assert ran.code == 0
    assert runs(desk_with_results) - before == 2  # one process for all checks, and one for its loop to be compared with


def test_cells_can_be_measured_ahead_of_their_items(desk_with_results: Desk) -> None:
    """With `--matrix-jobs` items end as without it, each case is measured once, and nothing that has no item is."""
    desk = desk_with_results
    counts, sessions = [runs(desk)], []
    for jobs in ("1", "2"):
        sessions.append(smoke(desk, "--matrix-fresh", "--matrix-jobs", jobs))
        counts.append(runs(desk))
    alone, ahead = sessions
    assert (ahead.code, ended(ahead, "FAILED")) == (alone.code, ended(alone, "FAILED"))
    assert counts[2] - counts[1] == counts[1] - counts[0]
    chosen = smoke(desk, "--matrix-fresh", "--matrix-jobs", "2", "-k", "good and not verdict")
    # One process for all checks, and one for its loop to be compared with.
    assert (chosen.code, runs(desk) - counts[2]) == (0, 2)


def test_the_first_failure_ends_what_is_measured_ahead(desk: Desk) -> None:
    """With `-x` pytest ends at once, and no process is left behind."""
    text = SMALL.read_text().replace("fake_blank_frame:BlankFrame-v0", "fake_hang:Hang-v0")
    red = text.replace("fake_healthy:Healthy-v0", "fake_blank_frame:BlankFrame-v0")
    desk.matrix("small", 'environment = { FAKE_MARK = "@MARK@" }\n' + red)
    ran = smoke(desk, "--matrix-jobs", "2", "-x", "-v")
    assert (ran.code, ended(ran, "FAILED")) == (1, [f"{GOOD}::{FRAME}::render - {WHY}"])
    assert "hang" not in ran.out
    assert not processes_of(desk.mark)


def runs(desk: Desk) -> int:
    """Count the probe runs that are kept."""
    return sum(len(claim.read_text().splitlines()) for claim in desk.state.glob("vault/ac/*/*"))


# --- JUnit -----------------------------------------------------------------------------------------------------


def test_junit_has_one_suite_per_cell(desk_with_results: Desk) -> None:
    """Each cell has a JUnit suite with its own counts and facts; a user's functions stay in pytest's own suite."""
    (desk_with_results.folder / "test_mine.py").write_text("def test_mine(): pass\n")
    ran = smoke(desk_with_results, "test_mine.py", "--junitxml=j.xml", "-n", "2")
    assert ran.code == 1
    suites = {suite.get("name"): suite for suite in ET.parse(desk_with_results.folder / "j.xml").getroot()}
    counts = {
        name: tuple(int(suite.get(count, "")) for count in ("tests", "failures", "errors", "skipped"))
        for name, suite in suites.items()
    }
    assert counts == {GOOD: (7, 0, 0, 0), BLANK: (11, 2, 0, 0), "pytest": (1, 0, 0, 0)}
    blank = suites[BLANK]
    known = {one.get("name"): one.get("value") for one in blank.findall("properties/property")}
    assert (known["axis.which"], known["verdict"], known["python"]) == ("blank", "partial", platform.python_version())
    assert known.keys() >= {"machine", "lock_sha256", "environment"}
    case = blank.findall("testcase")[9]
    assert (case.get("classname"), case.get("name")) == (f"{BLANK.replace('/', '.')}.{FRAME}", "render")
    assert case[0].get("message", "").splitlines()[0] == WHY
    assert not blank.findall("testcase/properties")


# --- functions of a user ---------------------------------------------------------------------------------------

MINE = """
import pytest

def test_version(cell):
    ran = cell.run("import sys; print(*sys.version_info[:3], sep='.')")
    assert ran.output.strip() == cell.version == cell.axes["python"]
    assert (cell.python.is_file(), cell.installed["fake-healthy"]) == (True, "1.0")

def test_make(cell, env):
    cell.run(f"import gymnasium; gymnasium.make({env.env!r}).reset(seed=1)")

def test_not_in_the_cell(cell):
    cell.run("import pytest")

@pytest.fixture(params=[1, 2])
def other(request):
    return request.param

def test_other(other):
    assert other
"""
THEIRS = """
import pytest

@pytest.fixture
def env():
    return "my own"

@pytest.fixture
def cell():
    return "mine, too"

def test_env(env, cell):
    assert (env, cell) == ("my own", "mine, too")
"""


def test_functions_of_a_user_run_once_for_each_cell_and_case(desk_with_results: Desk) -> None:
    """A user's function runs once for each cell and case, and its `cell.run` code in the cell alone.

    A fixture of the user's own is left alone.
    """
    (desk_with_results.folder / "test_mine.py").write_text(MINE)
    (desk_with_results.folder / "test_theirs.py").write_text(THEIRS)
    asked = ("test_mine.py", "test_theirs.py", "-v", "-rf", "--matrix", "small.toml")
    ran = desk_with_results.run(*asked, module="pytest")
    assert ran.code == 1
    failed = f"test_mine.py::test_not_in_the_cell[{GOOD}] - harness.smoke.tried.CellFailed: {GOOD}: exit code 1"
    assert ended(ran, "FAILED") == [failed, failed.replace(GOOD, BLANK)]
    assert "ModuleNotFoundError: No module named 'pytest'" in ran.out
    assert ran.out.splitlines()[-1].strip("= ").startswith("2 failed, 8 passed")
    for name in (f"test_version[{BLANK}]", f"test_make[{BLANK}-{FRAME}]", "test_other[1]", "test_env"):
        assert re.search(rf"::{re.escape(name)} PASSED", ran.out)
    spread = desk_with_results.run(*asked, "-n", "2", "-k", "version or env", module="pytest")
    assert spread.code == 0
    assert len(set(re.findall(r"\[(gw\d)\].*::test_version", spread.out))) == 1


def test_without_a_matrix_a_function_that_asks_for_a_cell_says_so(desk_with_results: Desk) -> None:
    """Without `--matrix`, a function that uses a cell is skipped.

    Nothing else of the session is touched, and of our modules only the plugin is imported.
    """
    (desk_with_results.folder / "test_mine.py").write_text(MINE)
    loaded = "import sys\n\ndef pytest_sessionfinish():\n    print(sorted(n for n in sys.modules if 'harness' in n))\n"
    (desk_with_results.folder / "conftest.py").write_text(loaded)
    ran = desk_with_results.run("test_mine.py", "-rs", "-s", module="pytest")
    assert ran.code == 0
    reason = "the fixture `cell` needs a matrix: pytest --matrix NAME (a matrix file, or the name of a built-in one)"
    assert ended(ran, "SKIPPED")
    assert all(line.endswith(reason) for line in ended(ran, "SKIPPED"))
    assert "['harness', 'harness.smoke', 'harness.smoke.plugin']" in ran.out


# --- what says nothing about packages --------------------------------------------------------------------------


def test_inconclusive_items_fail_and_missing_ones_are_skipped(desk: Desk) -> None:
    """An index that does not answer fails items with `inconclusive` first in each message.

    An absent Python is a reason to skip.
    """
    text = 'requirements = ["fake-plain"]\nindex = { default = "http://127.0.0.1:9/" }\n'
    text += 'cases = [{ imports = ["fake_plain"] }]\n[axes]\npython = ["host", "3.99"]\n'
    desk.matrix("small", text)
    ran = smoke(desk, UV_HTTP_RETRIES="0")
    assert ran.code == 1
    failed = [line.partition(" - ") for line in ended(ran, "FAILED")]
    assert [name.partition("::")[2] for name, _, _ in failed] == ["resolve", "verdict"]
    assert all(message.startswith("inconclusive: ") or message.startswith("inconclusive in ") for *_, message in failed)
    skipped = ended(ran, "SKIPPED")
    assert any("small/py3.99: unavailable: python 3.99 is not on this machine" in line for line in skipped)
    assert any("not reached: resolve infra" in line for line in skipped)


BAD = {
    ("--matrix", "quickstrat"): (
        'ERROR: quickstrat: neither a matrix file (NAME.toml) nor a built-in matrix; did you mean "quickstart"?\n'
    ),
    ("--matrix", "small.toml", "--matrix", "small.toml"): (
        "ERROR: two matrices have the name small; name only one of them, or rename one\n"
    ),
    (): "ERROR: harness.smoke needs a matrix: pytest --matrix NAME (a matrix file, or the name of a built-in one)\n",
}


@pytest.mark.parametrize("arguments", BAD, ids=" ".join)
def test_bad_input_is_a_usage_error(arguments: tuple[str, ...], desk_with_results: Desk) -> None:
    """Bad input is pytest's code 4 with one sentence and no traceback."""
    ran = desk_with_results.run("--pyargs", "harness.smoke", *arguments, module="pytest")
    assert (ran.code, ran.err.strip()) == (4, BAD[arguments].strip())


def test_a_number_of_jobs_is_at_least_one(desk_with_results: Desk) -> None:
    """Any other text is pytest's code 4, with a sentence."""
    ran = smoke(desk_with_results, "--matrix-jobs", "0")
    assert (ran.code, "argument --matrix-jobs: '0' is not a number of at least 1" in ran.err) == (4, True)


def test_an_empty_selection_is_pytests_own(desk_with_results: Desk) -> None:
    """An empty selection is pytest's code 5."""
    assert smoke(desk_with_results, "-k", "nothing").code == 5


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_an_interrupt_leaves_nothing_behind(desk: Desk, jobs: str) -> None:
    """Ctrl-C ends with pytest's code 2, and no process is left behind."""
    text = SMALL.read_text().replace("fake_healthy:Healthy-v0", "fake_hang:Hang-v0")
    desk.matrix("small", 'environment = { FAKE_MARK = "@MARK@" }\n' + text)
    asked = ("--pyargs", "harness.smoke", "--matrix", "small.toml", "-k", "good", "--matrix-jobs", jobs)
    with desk.started(*asked, module="pytest") as process:
        until = monotonic() + 60
        while not processes_of(desk.mark) and monotonic() < until:
            sleep(0.05)
        assert processes_of(desk.mark)
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 2
    assert not processes_of(desk.mark)
