"""Many cells: no work is done twice, memory is not exceeded, and a shard is a part of the whole report."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest
from commandline import SMALL, Desk
from test_fetch import Index

from harness.machine import capacity, interpreters, store
from harness.machine.capacity import Reading
from harness.machine.files.file_locks import exclusive
from harness.model import Phase, replace
from harness.reports.text import progress
from harness.running import open_matrix, scheduler

PATIENCE = 60.0
GATES = """
requirements = [@FAKES@]
index = { no_index = true, find_links = ["@WHEELS@"] }
cases = [{ env = "fake_gate:Gate-v0", api = "gymnasium" }]

[axes]
python = ["host"]
"""
ONE_GATE = 'environment = { FAKE_GATE = "@FOLDER@/gate" }\n'
TWO_GATES = """
[axes.gate]
one = { environment = { FAKE_GATE = "@FOLDER@/one" } }
two = { environment = { FAKE_GATE = "@FOLDER@/two" } }
"""
ONE_LOCK = """
[axes.bound]
none = { environment = { FAKE_GATE = "@FOLDER@/gate" } }
loose = { environment = { FAKE_GATE = "@FOLDER@/gate" }, constraints = ["fake-gate<99"] }
"""


def wait_for(happened: Callable[[], bool]) -> None:
    """Wait until `happened` returns true; fail after `PATIENCE` seconds."""
    deadline = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.05)


# --- once ------------------------------------------------------------------------------------------------------


def test_combinations_of_one_lock_are_measured_once(desk: Desk) -> None:
    """Two questions with the same lock are measured once, though their cells run at the same time.

    Both rows of the report have that measurement.
    """
    matrix = desk.matrix("m", GATES + ONE_LOCK)
    (desk.folder / "gate").touch()
    cells = desk.run("run", matrix, "-j", "2", "--until", "single", "--json").cells("bound")
    assert cells["none"]["lock_sha256"] == cells["loose"]["lock_sha256"]
    assert [cell["phases"]["single"] for cell in cells.values()] == ["passed", "passed"]
    records = [json.loads(path.read_text()) for path in desk.state.glob("cells/*/m/*.json")]
    reused = [{phase["reused"] for phase in record["cases"][0]["phases"][:2]} for record in records]
    assert sorted(reused, key=str) == [{False}, {True}]
    assert cells["none"]["cases"] == cells["loose"]["cases"]
    assert not list(desk.state.glob("claims/*.lock-soft"))


def test_processes_share_what_they_measure(desk: Desk) -> None:
    """A second run of the same cell waits for the first, and takes its result."""
    matrix = desk.matrix("m", ONE_GATE + GATES)
    reached = desk.folder / "gate.reached"
    asked = ("run", matrix, "--until", "single", "--json")
    with desk.started(*asked) as first:
        wait_for(reached.exists)
        reached.unlink()
        with desk.started(*asked) as second:
            wait_for(lambda: any(desk.state.glob("claims/*")))
            time.sleep(2)  # it would be there long before
            assert not reached.exists()
            (desk.folder / "gate").touch()
            said = [json.loads(process.communicate(timeout=PATIENCE)[0]) for process in (first, second)]
    assert [document["cells"][0]["phases"]["single"] for document in said] == ["passed", "passed"]
    assert [document["cells"][0]["reused"] for document in said] == [False, True]


def resolving(desk: Desk, monkeypatch: pytest.MonkeyPatch, matrix: Path) -> list[Path]:
    """Return the lock files that are held while the question of each cell is resolved."""
    monkeypatch.setenv("HARNESS_CACHE", str(desk.cache))
    monkeypatch.setenv("HARNESS_STATE", str(desk.state))
    opened = store.open_store()
    plan = open_matrix.set_instant(open_matrix.load(str(matrix), print), opened)
    host = interpreters.find("host")
    assert host
    return [opened.claim_file(store.question_key(cell.question, host)) for cell in plan.cells]


def test_processes_share_what_they_resolve(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two runs that wait for the turn to resolve one question, the second takes the answer of the first."""
    matrix = desk.matrix("m", ONE_GATE + GATES)
    (file,) = resolving(desk, monkeypatch, matrix)
    asked = ("run", matrix, "--until", "resolve", "--json")
    with ExitStack() as held:
        held.enter_context(exclusive(file))
        with desk.started(*asked) as first, desk.started(*asked) as second:
            time.sleep(2)  # both would be done before
            assert (first.poll(), second.poll()) == (None, None)
            held.close()
            said = [json.loads(process.communicate(timeout=PATIENCE)[0]) for process in (first, second)]
    assert [document["cells"][0]["phases"]["resolve"] for document in said] == ["passed", "passed"]
    assert sorted(document["cells"][0]["reused"] for document in said) == [False, True]


def test_installs_go_on_beside_probes(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    """One cell is probed before the other is resolved, and the other is installed while that probe runs."""
    gates = GATES.replace("@FAKES@", '"fake-gate"')
    matrix = desk.matrix("m", gates + TWO_GATES.replace('two" } }', 'two" }, requirements = ["fake-plain"] }'))
    _, two = resolving(desk, monkeypatch, matrix)
    with ExitStack() as held:
        held.enter_context(exclusive(two))
        with desk.started("run", matrix, "-j", "1", "--until", "single", "--json") as running:
            wait_for((desk.folder / "one.reached").exists)
            assert len(list(desk.state.glob("installed/*/*"))) == 1
            held.close()
            wait_for(lambda: len(list(desk.state.glob("installed/*/*"))) == 2)
            assert not (desk.folder / "two.reached").exists()
            (desk.folder / "one").touch()
            (desk.folder / "two").touch()
            cells = json.loads(running.communicate(timeout=PATIENCE)[0])["cells"]
    assert [cell["phases"]["single"] for cell in cells] == ["passed", "passed"]


# --- memory ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("free", "both"), [(3000, False), (5000, True)], ids=["little", "enough"])
def test_memory_decides_how_many_run(desk: Desk, monkeypatch: pytest.MonkeyPatch, free: int, both: bool) -> None:
    """Two probes of up to 2 GB run one after the other with 3 GB free, and side by side with 5 GB."""
    if capacity.default_jobs() < 2:
        pytest.skip("unavailable: a second core")
    monkeypatch.setenv("HARNESS_CACHE", str(desk.cache))
    monkeypatch.setenv("HARNESS_STATE", str(desk.state))
    opened = store.open_store()
    plan = open_matrix.set_instant(open_matrix.load(str(desk.matrix("m", GATES + TWO_GATES)), print), opened)
    settings = scheduler.Settings(
        jobs=capacity.AUTO, until=Phase.SINGLE, reading=lambda: Reading(free_mb=free, held_mb=(0, 0))
    )
    one, two = (desk.folder / name for name in ("one", "two"))
    with ThreadPoolExecutor(1) as pool:
        board = progress.Progress(2, 2, progress.headline)
        records = pool.submit(scheduler.run, plan.cells, opened, settings, board)
        try:
            wait_for((desk.folder / "one.reached").exists)
            if both:
                wait_for((desk.folder / "two.reached").exists)
            else:
                time.sleep(2)
                assert not (desk.folder / "two.reached").exists()
        finally:
            one.touch()
            two.touch()
        assert [record.cases[0].phases[1].outcome for record in records.result()] == ["passed", "passed"]


def test_the_peak_of_a_probe_is_recorded(desk_with_results: Desk) -> None:
    """The peak memory of a probe is stored with its result, for the next run."""
    (record,) = (json.loads(path.read_text()) for path in desk_with_results.state.glob("cells/*/small/*_good.json"))
    peaks = [phase["peak_mb"] for case in record["cases"] for phase in case["phases"] if phase["checks"]]
    assert len(peaks) == 4
    assert all(10 < peak < 2000 for peak in peaks)


# --- order and parts -------------------------------------------------------------------------------------------


def test_the_longest_goes_first(desk_with_results: Desk) -> None:
    """Cells start in the order of their recorded seconds, longest first, whatever the order of the plan."""
    for path in desk_with_results.state.glob("cells/*/small/*.json"):
        seconds = 99.0 if path.stem.endswith("_blank") else 0.5
        path.write_text(json.dumps({**json.loads(path.read_text()), "seconds": seconds}))
    ran = desk_with_results.run("run", "small.toml", "--fresh", "--until", "import", "-j", "1", "--offline")
    assert [line.partition(":")[0].rpartition("_")[2] for line in ran.err.splitlines()] == ["blank", "good"]


def test_a_shard_tells_of_its_own_cells_only(desk_with_results: Desk) -> None:
    """A shard reports all other cells as `not_run`, though they were measured here before: `merge` combines shards."""
    report = desk_with_results.folder / "past.json"
    shards = [desk_with_results.run("run", "small.toml", "--shard", f"{number}/3", "--json") for number in (1, 2, 3)]
    verdicts = [{name: cell["verdict"] for name, cell in shard.cells("which").items()} for shard in shards]
    assert verdicts == [
        {"good": "not_run", "blank": "partial"},
        {"good": "works", "blank": "not_run"},
        {"good": "not_run", "blank": "not_run"},
    ]
    assert [shard.code for shard in shards] == [1, 0, 0]
    assert shards[2].err == "shard 3/3: 0 of 2 cells\n"
    document = json.loads((desk_with_results.state / "reports" / "small" / "report.json").read_text())
    for cell in document["cells"]:
        cell["seconds"] = 99.0 if cell["id"].endswith("good") else 1.0
    report.write_text(json.dumps(document))
    first = desk_with_results.run(
        "run", "small.toml", "--shard", "1/2", "--durations", report, "--fail-on", "not_run", "--json"
    )
    assert (first.code, first.cells("which")["good"]["verdict"]) == (0, "works")


def test_only_failed(desk_with_results: Desk) -> None:
    """`--only-failed` measures only cells that were red and not expected to be."""
    ran = desk_with_results.run("run", "small.toml", "--only-failed", "--json")
    cells = ran.cells("which")
    assert (cells["blank"]["reused"], cells["good"]["reused"]) == (False, True)
    assert [line.partition(" ")[0] for line in ran.err.splitlines()] == ["[1/1]"]
    expect = '\n[[expect]]\nwhen = { which = "blank" }\nverdict = "partial"\nreason = "it paints black"\n'
    desk_with_results.matrix("small", SMALL.read_text() + expect)
    ran = desk_with_results.run("run", "small.toml", "--only-failed")
    assert (ran.code, ran.err) == (0, "nothing to do: no combination failed or was inconclusive the last time\n")
    assert "nothing was measured\n" in ran.out


def test_less_is_not_kept_over_more(desk_with_results: Desk) -> None:
    """`lock` after `run` keeps the results measured with the same lock."""
    desk_with_results.run("lock", "small.toml")
    cells = desk_with_results.run("report", "--json").cells("which")
    assert {name: cell["verdict"] for name, cell in cells.items()} == {"good": "works", "blank": "partial"}


def test_a_wrong_number_of_jobs_is_refused(desk: Desk) -> None:
    """`-j` takes a number or `auto`."""
    ran = desk.run("run", desk.matrix("small", SMALL.read_text()), "-j", "many")
    assert (ran.code, ran.err.splitlines()[-1]) == (
        2,
        "simmatrix run: error: argument -j/--jobs: 'many' is neither a number of at least 1 nor `auto`",
    )


# --- with the network, then without ------------------------------------------------------------------------------


def test_until_install_then_offline(desk: Desk, serve: Callable[..., str], tmp_path: Path) -> None:
    """`--until install` fetches all that a later `--offline` run needs without a network."""
    text = SMALL.read_text().replace('no_index = true, find_links = ["@WHEELS@"]', 'default = "@INDEX@"')
    assert "@INDEX@" in text
    matrix = desk.matrix("small", text.replace("@INDEX@", serve(Index(desk.wheels))))
    own = {"HARNESS_CACHE": str(tmp_path / "own-cache")}
    first = replace(desk, online=True).run("run", matrix, "--until", "install", "--json", **own)
    assert [cell["phases"]["install"] for cell in first.document["cells"]] == ["passed", "passed"]
    assert not list((desk.state / "results").glob("*"))
    second = desk.run("run", matrix, "--offline", "-k", "*-good", "--json", **own)
    cell = second.cells("which")["good"]
    assert (cell["verdict"], cell["phases"]["resolve"], cell["reused"]) == ("works", "passed", False)


# --- nothing changed ---------------------------------------------------------------------------------------------


def test_an_unchanged_run_writes_nothing(desk_with_results: Desk) -> None:
    """A run without changes writes no record and no report; an edited report is written again."""
    desk_with_results.run("run", "small.toml")
    folder = desk_with_results.state / "reports" / "small"
    files = [*desk_with_results.state.glob("cells/*/small/*.json"), *folder.rglob("*.*")]
    before = {path: (path.stat().st_mtime_ns, path.stat().st_ino) for path in files}
    ran = desk_with_results.run("run", "small.toml")
    assert {path: (path.stat().st_mtime_ns, path.stat().st_ino) for path in files} == before
    assert "nothing to do: all 2 results are reused\n" in ran.out
    (folder / "report.md").write_text("somebody else's\n")
    desk_with_results.run("run", "small.toml")
    assert "## Combinations" in (folder / "report.md").read_text()
    expect = '\n[[expect]]\nwhen = { which = "blank" }\nverdict = "partial"\nreason = "it paints black"\n'
    desk_with_results.matrix("small", SMALL.read_text() + expect)
    assert "it paints black" in desk_with_results.run("run", "small.toml").out


def test_only_what_was_reused_changes(desk_with_results: Desk) -> None:
    """A report says which results were reused; where nothing else changed, it is as if it were made again."""
    folder = desk_with_results.state / "reports" / "small"
    desk_with_results.run("run", "small.toml", "--fresh")
    assert [cell["reused"] for cell in json.loads((folder / "report.json").read_text())["cells"]] == [False, False]
    page = (folder / "report.md").stat().st_ino
    desk_with_results.run("run", "small.toml")
    report = json.loads((folder / "report.json").read_text())
    assert (folder / "report.md").stat().st_ino == page
    assert [cell["reused"] for cell in report["cells"]] == [True, True]
    (folder.parent / "small.note").unlink()
    desk_with_results.run("run", "small.toml")
    assert json.loads((folder / "report.json").read_text()) | {"generated": report["generated"]} == report
