"""Known failures and changes: a red cell with its cause, what cures it, what does not, what was hidden behind it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from typing import Any

import pytest
from commandline import CommandResult, Desk, DeskRun

XML = "ValueError: XML Error: top-level default class 'main' cannot be renamed / Element 'default', line 0"
BLANK = "ContractViolation: blank frame: every pixel is [0, 0, 0]"
SIGNATURES = """
[[signature]]
id = "default-renamed"
phases = ["vector"]
pattern = '''XML Error: top-level default class 'main' cannot be renamed'''
packages = ["fake-layers<2"]
cause = "the model gives its outermost default class a name"
examples = [
    "XML Error: top-level default class 'main' cannot be renamed",
    "ValueError: XML Error: top-level default class 'main' cannot be renamed",
    "XML Error: top-level default class 'main' cannot be renamed / Element 'default', line 0",
]
references = ["https://example.org/issues/1"]
remedy = { requirements = ["fake-layers>=3"] }
[[signature]]
id = "reset"
phases = ["vector"]
pattern = '''(?:ConnectionReset|BrokenPipe)Error|^EOFError'''
masks = true
cause = "a worker is gone"
examples = ["ConnectionResetError", "BrokenPipeError", "again: ConnectionResetError"]
remedy = { text = "look at the worker" }
"""
MATRIX = """
requirements = ["fake-layers==1.0"]
index = { no_index = true, find_links = ["@WHEELS@"] }
axes = { python = ["host"], which = { red = {} } }
cases = [{ env = "fake_layers:Layers-v0", api = "gymnasium" }]

[[expect]]
when = { which = "red" }
verdict = "partial"
phase = "vector"
signature = "default-renamed"
reason = "a model of old"

[[change]]
name = "cure"
cells = "*-red"
remedy_of = "default-renamed"
reason = "it is the remedy"

[[change]]
name = "half"
cells = "*-red"
requirements = ["fake-layers==2.0"]
reason = "the next release"
expect = { verdict = "partial", phase = "render", match = "blank frame" }

[[change]]
name = "advice"
cells = "*-red"
environment = { LAYERS = "please" }
advice = true
reason = "a forum says so"
expect = { verdict = "partial", signature = "default-renamed" }
"""


def signatures_variable(desk: Desk) -> dict[str, str]:
    """Write the signatures, and return the variable that makes a command use them."""
    folder = desk.folder / "signatures"
    folder.mkdir(exist_ok=True)
    (folder / "layers.toml").write_text(SIGNATURES, encoding="utf-8")
    return {"HARNESS_SIGNATURES": str(folder)}


@pytest.fixture(scope="session")
def changed(once: Callable[[str, Callable[[Desk], CommandResult]], DeskRun]) -> DeskRun:
    """Return a run of a red cell and three changes of it."""
    return once(
        "changed", lambda desk: desk.run("run", desk.matrix("layers", MATRIX), "-j", "2", **signatures_variable(desk))
    )


@pytest.fixture
def measured_folder(desk: Desk, changed: DeskRun) -> Desk:
    """Return a working folder in which the red cell and its changes were measured before."""
    shutil.copytree(changed.desk.state, desk.state)
    desk.matrix("layers", MATRIX)
    signatures_variable(desk)
    return desk


def cells(desk: Desk, folder: str = ".harness/reports/layers") -> dict[str, dict[str, Any]]:
    """Return the cells of a report by the part of their id after the base's label."""
    made = json.loads((desk.folder / folder / "report.json").read_text(encoding="utf-8"))
    return {cell["id"].partition("_red")[2] or "red": cell for cell in made["cells"]}


def test_cause_changes_and_proof(changed: DeskRun) -> None:
    """The cause is listed before its mask, and the changed cell proves its remedy; all cells are as expected."""
    found = cells(changed.desk)
    red = found["red"]
    ends = {name: (cell["verdict"], cell["phase"], cell["decisive"]) for name, cell in found.items()}
    assert changed.ran.code == 0
    assert ends == {
        "red": ("partial", "vector", XML),
        "_with-cure": ("works", None, None),
        "_with-half": ("partial", "render", BLANK),
        "_with-advice": ("partial", "vector", XML),
    }
    deepest, mask = red["diagnoses"]
    assert (deepest["signature"], deepest["proven"], deepest["seen"]) == ("default-renamed", True, XML)
    assert (deepest["proof"], deepest["remedy"]) == (found["_with-cure"]["id"], {"requirements": ["fake-layers>=3"]})
    assert (mask["signature"], mask["masks"], mask["proven"]) == ("reset", True, False)
    assert found["_with-cure"]["change"]["remedy_of"] == ["default-renamed"]
    assert found["_with-cure"]["installed"]["fake-layers"] == "3.0"
    assert (found["_with-half"]["diagnoses"], found["_with-half"]["change"]["remedy_of"]) == ([], [])
    assert not found["_with-advice"]["diagnoses"][0]["proven"]


def test_page_and_terminal_say_what_each_change_did(changed: DeskRun) -> None:
    """Page and terminal say whether a change cures, uncovers another failure or makes no difference.

    Cause, remedy and its proof with a lock stand beside the failure.
    """
    page = (changed.desk.state / "reports" / "layers" / "report.md").read_text(encoding="utf-8")
    before, base = f"partial in vector: {XML}", f"`{cells(changed.desk)['red']['id'].partition('/')[2]}`"
    for row in (
        f"### {base}\n\n    {before}\n",
        "| **fixes it** | cure: install `fake-layers>=3` | it is the remedy | `works` |",
        "| **another failure behind it** | half: install `fake-layers==2.0` | the next release "
        f"| `partial in render: {BLANK}` |",
        f"| **no difference** | advice: set `LAYERS=please` | advice: a forum says so | `{before}` |",
    ):
        assert row in page
    assert "\nThe model gives its outermost default class a name.\n" in page
    assert "\nKnown issue: [example.org](https://example.org/issues/1). " in page
    assert f"- Proven: {base[:-1]}_with-cure` works, with the lock [locks/" in page
    out = changed.ran.out
    assert "default-renamed: the model gives its outermost default class a name" in out
    assert f"fix: install fake-layers>=3 (proven by {base[1:-1]}_with-cure)" in out
    assert "fixes it: cure: install `fake-layers>=3` " in out


def test_show_says_whether_the_remedy_is_proven(measured_folder: Desk) -> None:
    """`show` says whether the remedy is proven, and why a change was tried."""
    shown = measured_folder.run("show", "*-red", **signatures_variable(measured_folder))
    told = "known as default-renamed\n  cause      the model gives its outermost default class a name\n"
    assert told in shown.out
    assert "  remedy     install `fake-layers>=3`\n  proven     by layers/" in shown.out
    other = measured_folder.run("show", "*_with-half", **signatures_variable(measured_folder)).out
    assert " with half: install `fake-layers==2.0`\n  tried because: the next release\n" in other


def test_try_says_cause_and_remedy(desk: Desk) -> None:
    """`try` prints cause, remedy and link of a failure after the decisive line."""
    links = {"PIP_FIND_LINKS": str(desk.wheels), "PIP_NO_INDEX": "1"}
    asked = ("fake-layers==1.0", "--env", "fake_layers:Layers-v0", "--api", "gymnasium")
    ran = desk.run("try", *asked, **links, **signatures_variable(desk))
    assert (ran.code, ran.out.splitlines()[1:5]) == (
        1,
        [
            XML,
            "cause: the model gives its outermost default class a name",
            "remedy: install `fake-layers>=3`",
            "see: https://example.org/issues/1",
        ],
    )


def test_another_cause_than_the_one_expected(measured_folder: Desk) -> None:
    """A cell that fails by another cause than the expected one is not as expected.

    An expected cause that is no known failure is bad input.
    """
    path, variables = measured_folder.folder / "layers.toml", signatures_variable(measured_folder)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('signature = "default-renamed"\nreason', 'signature = "reset"\nreason'))
    ran = measured_folder.run("run", "layers.toml", **variables)
    assert ran.code == 1
    assert "not as expected, which was partial in vector by reset: a model of old" in ran.out
    again = measured_folder.run("run", "layers.toml", "--only-failed", **variables)
    assert "1 combination measured, 0 reused" in again.out
    path.write_text(text.replace('signature = "default-renamed"\nreason', 'signature = "default-named"\nreason'))
    wrong = measured_folder.run("run", "layers.toml", **variables)
    assert (wrong.code, wrong.err) == (
        2,
        'simmatrix: layers.toml: expect[0].signature: no signature is called "default-named"; '
        'did you mean "default-renamed"?\n',
    )


def test_accept_speaks_of_a_changed_cell_by_its_label(measured_folder: Desk) -> None:
    """`accept` names a changed cell by its label and accepts only that cell; the next run is as expected."""
    path, variables = measured_folder.folder / "layers.toml", signatures_variable(measured_folder)
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(line for line in lines if "blank frame" not in line), encoding="utf-8")
    assert measured_folder.run("run", "layers.toml", **variables).code == 1
    made = measured_folder.run("accept", "layers.toml", "-k", "*", "--reason", "black", **variables)
    label = cells(measured_folder)["_with-half"]["id"].partition("/")[2]
    assert (made.code, made.out.splitlines()[:2]) == (0, ["[[expect]]", f'cells = "{label}"'])
    assert measured_folder.run("run", "layers.toml", **variables).code == 0


def test_remedies_are_proven_on_demand(measured_folder: Desk) -> None:
    """`--prove` also runs the red cell with the remedy of its known failure; no expectation applies to that cell."""
    path, variables = measured_folder.folder / "layers.toml", signatures_variable(measured_folder)
    path.write_text(
        MATRIX.partition("[[change]]")[0].replace("@WHEELS@", str(measured_folder.wheels)), encoding="utf-8"
    )
    plain = measured_folder.run("run", "layers.toml", **variables)
    assert (plain.code, list(cells(measured_folder)), cells(measured_folder)["red"]["diagnoses"][0]["proven"]) == (
        0,
        ["red"],
        False,
    )
    ran = measured_folder.run("run", "layers.toml", "--prove", **variables)
    found = cells(measured_folder)
    assert (ran.code, list(found)) == (0, ["red", "_with-default-renamed"])
    assert "1 failed combination to measure again, each with the fix of a known issue\n" in ran.err
    proof = found["_with-default-renamed"]
    assert (proof["verdict"], proof["as_expected"], proof["base"]) == ("works", None, found["red"]["id"])
    assert found["red"]["diagnoses"][0]["proof"] == proof["id"]
    (measured_folder.folder / "signatures" / "layers.toml").write_text(
        SIGNATURES.replace(">=3", "==1.0"), encoding="utf-8"
    )
    nothing = measured_folder.run("run", "layers.toml", "--prove", **variables)
    assert "no fix of a known issue is left to try\n" in nothing.err
    wrong = SIGNATURES.replace("fake-layers>=3", "fake-layers==2.0")
    (measured_folder.folder / "signatures" / "layers.toml").write_text(wrong, encoding="utf-8")
    again = measured_folder.run(
        "run", "layers.toml", "--prove", "-j", "1", HARNESS_SIGNATURES=variables["HARNESS_SIGNATURES"]
    )
    found = cells(measured_folder)
    assert (again.code, found["_with-default-renamed"]["verdict"]) == (0, "partial")
    assert not found["red"]["diagnoses"][0]["proven"]
    assert "another failure behind it: default-renamed" in again.out


def test_a_new_reason_for_a_change_changes_no_result(measured_folder: Desk) -> None:
    """A new reason for a change keeps the stored results, also in a run of other cells only."""
    path = measured_folder.folder / "layers.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("the next release", "one more"), encoding="utf-8")
    ran = measured_folder.run("run", "layers.toml", "-k", "*-red", **signatures_variable(measured_folder))
    assert (ran.code, cells(measured_folder)["_with-half"]["change"]["reason"]) == (0, "one more")
    assert cells(measured_folder)["_with-half"]["verdict"] == "partial"


def test_shards_are_merged_with_their_proof(measured_folder: Desk) -> None:
    """`merge` combines a cell with its cure from another shard."""
    variables = signatures_variable(measured_folder)
    parts = [f"part-{number}" for number in (1, 2)]
    for number, part in enumerate(parts, start=1):
        measured_folder.run("run", "layers.toml", "--shard", f"{number}/2", "--out", part, **variables)
    where = {
        name: part
        for part in parts
        for name in cells(measured_folder, part)
        if cells(measured_folder, part)[name]["measured"]
    }
    assert where["red"] != where["_with-cure"]
    assert not cells(measured_folder, where["red"])["red"]["diagnoses"][0]["proven"]
    assert measured_folder.run("merge", *parts, "--out", "whole", **variables).code == 0
    assert cells(measured_folder, "whole")["red"]["diagnoses"][0]["proven"]
