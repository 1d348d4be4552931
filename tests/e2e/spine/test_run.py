"""The results of a run: the document of the contract, the files beside it, exit codes, and reuse by later runs."""

from __future__ import annotations

import json
import platform
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from commandline import SMALL, Desk, DeskRun
from PIL import Image

from harness.model import replace
from harness.probes.vault import Vault

TOP = {"schema", "generated", "machines", "cells", "dropped"}
CELL = {
    "id", "matrix", "axes", "requested_python", "python", "machine", "environment", "supplied", "installed", "lock",
    "lock_sha256", "key", "measured", "reused", "inferred", "attempts", "seconds", "verdict", "unverified", "expected",
    "as_expected", "repairs", "findings", "phases", "cases", "decisive", "diagnoses", "evidence",
}  # fmt: skip
CASE = {"case", "env", "api", "phases", "checks", "frames", "decisive"}
PHASES = ["resolve", "install", "import", "single", "vector", "render"]
"""The keys of the contract; more may be there."""

RED = """
[[expect]]
when = { which = "blank" }
verdict = "partial"
phase = "render"
match = "blank frame"
reason = "it paints black"
"""

APART = """
requirements = ["fake-healthy"]
python_path = ["."]
files = { "raises.py" = "def make(word):\\n    raise ValueError('the word is ' + word)\\n" }

[index]
no_index = true
find_links = ["@WHEELS@"]

[axes]
python = ["host"]
how.one.cases = [{ id = "one", env = "raises:make", api = "gymnasium", kwargs = { word = "one" }, checks = ["single"] }]
how.two.cases = [{ id = "one", env = "raises:make", api = "gymnasium", kwargs = { word = "two" }, checks = ["single"] }]
"""


# --- the document ----------------------------------------------------------------------------------------------


def test_the_document_has_the_keys_of_the_contract(defects: DeskRun, verdicts: DeskRun) -> None:
    """Every cell, whatever became of it, has every key, every phase, and the id that was asked for."""
    for document in (defects.ran.document, verdicts.ran.document):
        assert document.keys() >= TOP
        for cell in document["cells"]:
            assert cell.keys() >= CELL
            asked = any(check.startswith("interop.") for case in cell["cases"] for check in case["checks"])
            assert set(cell["phases"]) == {*PHASES, *(["interop"] if asked else [])}
            for case in cell["cases"]:
                assert case.keys() >= CASE
                assert all(check.partition(".")[0] in {*PHASES, "interop"} for check in case["checks"])


def test_the_document_is_valid_by_its_schema(desk: Desk, defects: DeskRun, verdicts: DeskRun) -> None:
    """`schema report` publishes the shape that `run --json` prints."""
    schema = json.loads(desk.run("schema", "report").out)
    for document in (defects.ran.document, verdicts.ran.document):
        jsonschema.Draft202012Validator(schema).validate(document)


def test_cells_stand_in_the_order_of_the_plan(defects: DeskRun) -> None:
    """However many cells run at a time, the report keeps the order of the plan."""
    planned = defects.desk.run("plan", "defects.toml", "--json").document
    assert [cell["id"] for cell in defects.ran.document["cells"]] == [cell["id"] for cell in planned["cells"]]


def test_facts_of_a_working_cell(small: DeskRun) -> None:
    """A cell names its machine, its Python, what is installed and what was supplied."""
    cell = small.ran.cells("which")["good"]
    assert cell["machine"] in small.ran.document["machines"]
    assert cell["python"] == cell["axes"]["python"]
    assert (cell["installed"]["gymnasium"], cell["installed"]["fake-healthy"]) == ("1.2.3", "1.0")
    assert not {"pip", "setuptools", "pytest"} & set(cell["installed"])
    assert cell["supplied"]["SDL_VIDEODRIVER"] == "dummy"
    assert (cell["reused"], cell["as_expected"], cell["expected"]) == (False, True, "works")
    assert cell["cases"][0]["env"] == "fake_healthy:Healthy-v0"
    assert small.ran.document["dropped"] == [
        {"id": cell["id"].replace("good", "odd"), "reason": "nobody wants it"},
    ]


def test_locks_are_pinned_with_hashes(small: DeskRun) -> None:
    """The lock beside the report holds what was installed, each version with its hashes."""
    cell = small.ran.cells("which")["good"]
    text = (small.desk.folder / cell["lock"]).read_text()
    pins = dict(re.findall(r"(?m)^(\S+)==(\S+) \\\n    --hash=sha256:[0-9a-f]{64}", text))
    assert pins == cell["installed"]


def test_frames_are_small_pictures(small: DeskRun) -> None:
    """The first and the last frame are kept as PNGs beside the report."""
    (case,) = small.ran.cells("which")["good"]["cases"]
    paths = [small.desk.folder / frame for frame in case["frames"]]
    assert [path.name.split("--")[1] for path in paths] == ["render.rgb_array-first", "render.rgb_array-last"]
    for path in paths:
        with Image.open(path) as image:
            assert (image.format, image.size) == ("PNG", (48, 32))


def test_the_folder_holds_the_same(small: DeskRun) -> None:
    """`report.json` is the document with paths of its own; `report.md` has a row for every cell."""
    folder = small.desk.state / "reports" / "small"
    document = json.loads((folder / "report.json").read_text())
    assert _without_paths(document) == _without_paths(small.ran.document)
    for cell in document["cells"]:
        assert (folder / cell["lock"]).is_file()
        assert (folder / cell["evidence"]).exists()
        assert all((folder / frame).is_file() for case in cell["cases"] for frame in case["frames"])
        assert f"`{cell['id'].partition('/')[2]}`" in (folder / "report.md").read_text()


# --- exit codes ------------------------------------------------------------------------------------------------


def test_a_red_cell_that_nobody_expects_is_1(small: DeskRun) -> None:
    """A cell without expectation is expected to work."""
    assert small.ran.code == 1
    assert small.ran.cells("which")["blank"]["as_expected"] is False


@pytest.mark.parametrize(
    ("expect", "options", "code"),
    [
        (RED, (), 0),
        (RED.replace("blank frame", "no display"), (), 1),
        (RED.replace('"render"', '"vector"'), (), 1),
        (RED.replace('"partial"', '"broken"').replace('phase = "render"', ""), (), 1),
        (RED + 'until = "2020-01-01"', (), 1),
        (RED + 'until = "2999-01-01"', (), 0),
        (RED + RED.replace("blank", "good", 1), (), 1),
        (RED + 'until = "2020-01-01"', ("--fail-on", "unexpected"), 0),
        (RED, ("-k", "*-good", "--fail-on", "not_run"), 0),
    ],
    ids=["fits", "line", "phase", "verdict", "past", "future", "better", "stale-allowed", "kept-cells-count"],
)
def test_expectations(desk_with_results: Desk, expect: str, options: tuple[str, ...], code: int) -> None:
    """An expectation holds for verdict, phase and line, until its date; one that is stale fails unless allowed."""
    matrix = desk_with_results.matrix("small", SMALL.read_text() + expect)
    assert desk_with_results.run("run", matrix, "--json", *options).code == code


def test_an_expectation_of_no_cell_is_stale(desk_with_results: Desk) -> None:
    """An expectation that nothing fits is named, and fails."""
    desk_with_results.matrix(
        "small", SMALL.read_text() + RED + RED.replace('when = { which = "blank" }', 'cells = "*-x"')
    )
    ran = desk_with_results.run("run", "small.toml", "--json")
    assert ran.code == 1
    assert ran.document["stale"] == ['small.toml: expect[1] matches no cell (reason: "it paints black")']


def test_a_run_without_an_answering_index_exits_with_3(desk: Desk) -> None:
    """An index that does not answer is a fault of the network alone."""
    text = 'requirements = ["fake-plain"]\nindex = { default = "http://127.0.0.1:9/" }\n'
    matrix = desk.matrix("m", text + 'cases = [{ imports = ["fake_plain"] }]\n[axes]\npython = ["host"]\n')
    ran = desk.run("run", matrix, UV_HTTP_RETRIES="0")
    assert ran.code == 3
    assert "inconclusive" in ran.out


BAD = {
    ("run", "nowhere.toml"): "nowhere.toml: cannot be read: No such file or directory",
    ("run", "typo.toml"): 'typo.toml: requirments: unknown key; did you mean "requirements"?',
    ("run", "small.toml", "-k", "*mujoco*"): (
        f"-k *mujoco*: none of the 2 combinations matches; one of them is small/py{platform.python_version()}_good"
    ),
    ("run", "quickstrat"): (
        'quickstrat: neither a matrix file (NAME.toml) nor a built-in matrix; did you mean "quickstart"?'
    ),
    ("show", "small/nothing"): (
        "show small/nothing: no combination of this name was measured; `simmatrix known` lists what was measured"
    ),
    ("report",): "nothing was measured here yet; run `simmatrix run quickstart`, or name a report.json",
}


@pytest.mark.parametrize("arguments", BAD, ids=" ".join)
def test_bad_input_is_2(desk: Desk, arguments: tuple[str, ...]) -> None:
    """Bad input is one sentence on stderr, and leaves no result behind."""
    desk.matrix("small", SMALL.read_text())
    desk.matrix("typo", SMALL.read_text().replace("requirements", "requirments"))
    ran = desk.run(*arguments)
    assert (ran.code, ran.out, ran.err) == (2, "", f"simmatrix: {BAD[arguments]}\n")
    assert not {path.name for path in desk.state.glob("*")} & {"cells", "results", "evidence", "locks", "reports"}


# --- again -----------------------------------------------------------------------------------------------------


def test_a_second_run_has_nothing_to_do(desk_with_results: Desk) -> None:
    """Results are reused, even without the cache and the network, and the run says so."""
    ran = desk_with_results.run("run", "small.toml", "--offline", HARNESS_CACHE=str(desk_with_results.folder / "empty"))
    assert "nothing to do: all 2 results are reused\n" in ran.out
    assert ran.out.splitlines()[-1] == "report: .harness/reports/small"
    document = json.loads((desk_with_results.state / "reports" / "small" / "report.json").read_text())
    assert [cell["reused"] for cell in document["cells"]] == [True, True]


def test_the_second_report_says_the_same(desk_with_results: Desk, small: DeskRun) -> None:
    """Reuse changes nothing of what a report says but that it was reused."""
    again = desk_with_results.run("run", "small.toml", "--json")
    assert again.code == small.ran.code
    assert _without_paths(again.document) == _without_paths(small.ran.document)


def test_fresh_measures_again_from_the_caches(desk_with_results: Desk) -> None:
    """`--fresh --offline` takes environments and packages from the caches, and results from nowhere."""
    ran = desk_with_results.run("run", "small.toml", "--fresh", "--offline", "-k", "*-good", "--json")
    cell = ran.cells("which")["good"]
    assert (cell["verdict"], cell["reused"]) == ("works", False)


def test_an_offline_resolution_is_made_again_with_the_network(desk: Desk) -> None:
    """An offline resolution may be older than the newest release: a later run with the network resolves again.

    The later run then keeps its own answer.
    """
    matrix = desk.matrix("small", SMALL.read_text())
    asked = ("run", matrix, "-k", "*-good", "--until", "resolve", "--json")
    cells = [desk.run(*asked, *more).cells("which")["good"] for more in (("--offline",), (), ())]
    assert [cell["reused"] for cell in cells] == [False, False, True]


@pytest.mark.parametrize(
    ("change", "again"),
    [
        pytest.param(('BlankFrame-v0"', 'BlankFrame-v0", seed = 8'), {"blank"}, id="seed"),
        pytest.param(('BlankFrame-v0"', 'BlankFrame-v0", steps = 30'), {"blank"}, id="steps"),
        pytest.param(('BlankFrame-v0"', 'BlankFrame-v0", timeouts = { single = 77 }'), {"blank"}, id="limit"),
        pytest.param(('BlankFrame-v0"', 'BlankFrame-v0", kwargs = { max_episode_steps = 9 }'), {"blank"}, id="kwargs"),
        pytest.param(("[axes]", '[axes.more]\nx = { environment = { ANOTHER = "1" } }\n[axes]'), None, id="variable"),
    ],
)
def test_changed_cells_are_measured_again(
    change: tuple[str, str], again: set[str] | None, desk_with_results: Desk
) -> None:
    """Settings and variables of a cell are part of its results' key: only the changed cells are measured again."""
    matrix = desk_with_results.matrix("small", SMALL.read_text().replace(*change, 1))
    cells = desk_with_results.run("run", matrix, "--until", "single", "--json").cells("which")
    known = again if again is not None else set(cells)
    assert {name for name, cell in cells.items() if not cell["reused"]} == known


def test_a_variable_of_the_user_that_cells_see_is_measured_again(desk_with_results: Desk) -> None:
    """A user's variable that reaches a cell is part of its results' key, too."""
    asked = ("run", "small.toml", "--until", "single", "-k", "*-good", "--json")
    cells = desk_with_results.run(*asked, __EGL_VENDOR_LIBRARY_DIRS="/usr/share/glvnd/egl_vendor.d").cells("which")
    assert cells["good"]["reused"] is False


def test_a_red_phase_is_measured_again_on_another_system(desk_with_results: Desk) -> None:
    """A red phase is measured again on a changed system, for example with a new library; a passed one is reused."""
    vault = Vault(desk_with_results.state)
    claims = sorted((vault.folder / "ac").glob("*/*"))
    assert claims
    for claim in claims:
        key = claim.parent.name + claim.name
        runs = [reading.run for reading in vault.readings(vault.runs(key))]
        claim.unlink()
        for run in runs:
            vault.put(replace(run, host=replace(run.host, conditions="before")), key)
    for path in desk_with_results.state.glob("cells/*/small/*.json"):
        path.write_text(re.sub(r'"mark":"\w+"', '"mark":"before"', path.read_text()))
    cells = desk_with_results.run("run", "small.toml", "--json").cells("which")
    assert (cells["good"]["reused"], cells["blank"]["reused"]) == (True, False)
    assert cells["blank"]["verdict"] == "partial"


def test_a_failed_build_is_tried_again_on_another_system(desk: Desk) -> None:
    """A failed build is reused on the same system only: a new compiler or header may fix it."""
    text = 'requirements = ["fake-build-failure"]\nindex = { no_index = true, find_links = ["@WHEELS@"] }\n'
    text += 'cases = [{ imports = ["fake_build_failure"] }]\n[axes]\npython = ["host"]\n'
    asked = ("run", desk.matrix("m", text), "--json")
    cells = [desk.run(*asked).document["cells"][0] for _ in range(2)]
    for path in (*desk.state.glob("steps/*/*.json"), *desk.state.glob("installed/*/*.json")):
        path.write_text(re.sub(r'"conditions":"\w+"', '"conditions":"before"', path.read_text()))
    cells.append(desk.run(*asked).document["cells"][0])
    assert [(cell["verdict"], cell["reused"]) for cell in cells] == [
        ("uninstallable", False),
        ("uninstallable", True),
        ("uninstallable", False),
    ]


def test_verify_rebuilds_a_damaged_environment(desk: Desk) -> None:
    """`--verify` makes an environment again if its files differ from its wheels."""
    own = desk.folder / "own-cache"
    asked = ("run", desk.matrix("small", SMALL.read_text()), "-k", "*-good", "--json")
    key = desk.run(*asked, HARNESS_CACHE=str(own)).cells("which")["good"]["key"]
    (module,) = (own / "environments" / key).glob("lib/python3*/site-packages/fake_healthy.py")
    content = module.read_text()
    module.unlink()
    module.write_text("raise RuntimeError('not the file of the wheel')\n")
    cell = desk.run(*asked, "--verify", HARNESS_CACHE=str(own)).cells("which")["good"]
    assert (cell["verdict"], cell["key"], cell["reused"]) == ("works", key, False)
    assert module.read_text() == content


def test_until_stops_and_a_later_run_goes_on(desk: Desk) -> None:
    """`--until import` is no verdict; the run after it measures what is missing."""
    matrix = desk.matrix("small", SMALL.read_text())
    first = desk.run("run", matrix, "--until", "import", "-k", "*-good", "--json")
    cell = first.cells("which")["good"]
    assert (first.code, cell["verdict"], cell["decisive"]) == (0, "not_run", "only the import was tried")
    assert [cell["phases"][phase] for phase in PHASES] == ["passed"] * 3 + ["not_reached"] * 3
    measured = cell["measured"]
    second = desk.run("run", matrix, "-k", "*-good", "--json").cells("which")["good"]
    assert (second["verdict"], second["reused"]) == ("works", False)
    assert second["measured"] >= measured


def test_out_goes_elsewhere(desk_with_results: Desk) -> None:
    """`--out DIR` writes the whole report to another folder."""
    ran = desk_with_results.run("run", "small.toml", "--out", "there")
    document = json.loads((desk_with_results.folder / "there" / "report.json").read_text())
    assert ran.out.splitlines()[-1] == "report: there"
    assert all((desk_with_results.folder / "there" / cell["lock"]).is_file() for cell in document["cells"])


def test_progress_is_plain_lines(small: DeskRun) -> None:
    """If the output is not a terminal, each finished cell is one line on stderr."""
    lines = small.ran.err.splitlines()
    assert len(lines) == 2
    assert all(
        re.match(r"\[[12]/2\] small/py\S+_(good: works|blank: partial in render) \(\d+\.\d s\)", x) for x in lines
    )


def _without_paths(document: dict[str, Any]) -> dict[str, Any]:
    """Return a document without the paths, times and reuse marks in which equal results may differ."""
    kept: dict[str, Any] = json.loads(json.dumps(document))
    for cell in kept["cells"]:
        for key in ("lock", "evidence", "reused", "seconds"):
            cell[key] = None
        for case in cell["cases"]:
            case["frames"] = [Path(frame).name for frame in case["frames"]]
            case["evidence"] = sorted(case["evidence"])
    return {**kept, "generated": None}


def test_evidence_of_another_measurement_lies_apart(desk: Desk) -> None:
    """A second measurement neither overwrites the files of the first one nor is read beside them."""
    matrix = desk.matrix("small", SMALL.read_text())
    found = []
    for _ in range(2):
        cell = desk.run("run", matrix, "-k", "*-blank", "--fresh", "--json").cells("which")["blank"]
        folder = desk.state / "evidence" / Path(cell["evidence"]).name
        found.append((folder, {path.name: path.read_bytes() for path in folder.iterdir()}))
        (folder / "stacks.txt").write_text("of the first alone")
    assert found[0][0] != found[1][0]
    assert "stacks.txt" not in found[1][1]
    assert {name: (found[0][0] / name).read_bytes() for name in found[0][1]} == found[0][1]


def test_evidence_of_other_arguments_lies_apart(desk: Desk) -> None:
    """Two cells of one environment, whose cases differ in arguments alone, keep what each of them raised."""
    ran = desk.run("run", desk.matrix("apart", APART), "--json")

    told = {}
    for how, cell in ran.cells("how").items():
        log = (desk.folder / cell["cases"][0]["evidence"]["single"] / "reply.jsonl").read_text()
        told[how] = (cell["decisive"], re.findall(r"the word is \w+", log)[0])
    assert told == {
        "one": ("ValueError: the word is one", "the word is one"),
        "two": ("ValueError: the word is two", "the word is two"),
    }
