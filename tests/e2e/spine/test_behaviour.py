"""Behaviour from set states: `freeze`, `compare`, and the families and boundaries of a report."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
import wheelhouse as fakes
from commandline import Desk

HEAD = """
axes = { python = ["host"], fake-swing = ["1.0", "1.1", "2.0"] }
requirements = ["gymnasium"]
index = { no_index = true, find_links = ["@WHEELS@"] }
"""
SEED = HEAD + '[[cases]]\nenv = "fake_swing:Swing-v0"\napi = "gymnasium"\nchecks = ["import", "single.loop"]\n'
MATRIX = SEED.replace('"single.loop"]', '"single.loop", "behave"]\nbank = "swing.npz"')
CELL = "swing/py*_fake-swing-{}"


@pytest.fixture
def frozen(desk: Desk) -> Desk:
    """Return a desk with the bank of states that release 1.0 made, and all that they lead to there."""
    desk.matrix("swing", SEED)
    made = desk.run("freeze", "swing.toml/" + CELL.format("1.0").partition("/")[2], "--out", "swing.npz")
    assert (made.code, made.out.partition(",")[0]) == (0, "fake_swing:Swing-v0: 300 states")
    return desk


def check(desk: Desk, version: str) -> tuple[int, str]:
    """Check a release against the frozen file."""
    ran = desk.run("freeze", f"swing.toml/py*_fake-swing-{version}", "--check", "swing.npz")
    return ran.code, ran.out.strip() or ran.err.strip().splitlines()[-1]


def test_a_frozen_file_finds_more_gravity_and_passes_over_rounding(frozen: Desk) -> None:
    """A change of 0.1 % fails with a sentence; sums in another order, which differ in bits, do not."""
    assert check(frozen, "1.0") == (0, "fake_swing:Swing-v0: behaves identically, to the bit")
    assert check(frozen, "1.1") == (0, "fake_swing:Swing-v0: behaves the same, up to rounding")
    code, text = check(frozen, "2.0")
    assert code == 1
    assert text.startswith("fake_swing:Swing-v0: behaves otherwise; the next state of the environment differs in ")


def test_a_frozen_file_is_readable_without_us(frozen: Desk) -> None:
    """It is a file of NumPy's: states, what each leads to, and facts as JSON."""
    with np.load(frozen.folder / "swing.npz") as arrays:
        assert arrays["state.state"].shape == (300, 2)
        assert arrays["out.observation"].shape == (300, 2)
        facts = json.loads(arrays["facts"].tobytes())
    assert (facts["form"], facts["env"], facts["repeats"]) == (1, "fake_swing:Swing-v0", True)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda content: content[: len(content) // 2], "File is not a zip file"),
        (lambda content: b"", "File is not a zip file"),
        (None, "its numbers are not those that it was written with"),
    ],
)
def test_a_spoilt_file_is_refused_in_a_sentence(frozen: Desk, spoil: object, said: str) -> None:
    """A file that was cut off, and one with an altered number, end with 2 and what to do."""
    path = frozen.folder / "swing.npz"
    if callable(spoil):
        path.write_bytes(spoil(path.read_bytes()))
    else:
        with np.load(path) as arrays:
            parts = {name: arrays[name].copy() for name in arrays.files}
        parts["out.reward"][3] += 1
        np.savez(path, **parts)
    code, text = check(frozen, "1.0")
    assert code == 2
    assert said in text
    assert text.endswith("write it again with `simmatrix freeze CELL --out FILE`")


def test_a_report_has_families_and_boundaries_that_come_back_from_its_evidence(frozen: Desk) -> None:
    """1.0 and 1.1 are one family, 2.0 another; the boundary names the package, and judging again changes nothing."""
    frozen.matrix("swing", MATRIX)
    ran = frozen.run("run", "swing.toml", "--out", "out", "--json")
    assert ran.code == 0, ran.err
    cells = ran.cells("fake-swing")
    cases = {version: cell["cases"][0] for version, cell in cells.items()}
    assert {version: case["behaviour"]["family"] for version, case in cases.items()} == {
        "1.0": "A",
        "1.1": "A",
        "2.0": "B",
    }
    assert {version: case["phases"]["behave"] for version, case in cases.items()} == dict.fromkeys(cases, "passed")
    assert cases["1.1"]["behaviour"]["classes"]["dynamics"] == "round_off"
    (boundary,) = ran.document["boundaries"]
    assert (boundary["axis"], boundary["before"], boundary["after"]) == ("fake-swing", "1.1", "2.0")
    assert (boundary["kind"], boundary["moved"], boundary["between"]) == ("changed", {}, [])
    page = (frozen.folder / "out" / "report.md").read_text(encoding="utf-8")
    assert "| environment / fake-swing | 1.0 to 1.1 | 2.0 |\n" in page
    assert "### fake-swing 1.1 to 2.0" in page
    before = {path.name: path.read_bytes() for path in Path(frozen.folder / "out").glob("report.*")}
    for path in Path(frozen.folder / "out").glob("report.*"):
        path.unlink()
    again = frozen.run("report", "--judge-again", "--write", "out")
    assert again.code == 0, again.err
    assert {path.name: path.read_bytes() for path in Path(frozen.folder / "out").glob("report.*")} == before


def test_compare_says_what_differs_and_needs_a_common_environment(frozen: Desk) -> None:
    """Exit status 0 for the same behaviour, 1 for another one, 2 where nothing can be compared."""
    cells = [f"swing.toml/py*_fake-swing-{version}" for version in ("1.0", "1.1", "2.0")]
    same = frozen.run("compare", cells[0], cells[1])
    assert (same.code, same.out.splitlines()[-3]) == (0, "fake_swing:Swing-v0: behaves the same, up to rounding")
    other = frozen.run("compare", cells[0], cells[2], "--json")
    assert other.code == 1
    assert other.document["moved"] == {"fake-swing": ["1.0", "2.0"]}
    assert other.document["environments"][0]["kind"] == "changed"
    none = frozen.run("compare", cells[0], cells[1], "--env", "Ant-v5")
    assert none.code == 2
    assert "the two cells have no environment Ant-v5 in common" in none.err


def test_bisect_finds_the_release_that_behaves_otherwise(desk: Desk) -> None:
    """The certificate names the last release that behaves like the good end, and the first that does not."""
    desk.matrix("swing", SEED)
    cell = "swing.toml/py*_fake-swing-2.0"
    ran = desk.run("bisect", cell, "--axis", "fake-swing", "--behaves", "--good", "1.0", "--out", "found", "--json")
    assert ran.code == 0, ran.err
    assert (ran.document["good"]["candidate"], ran.document["bad"]["candidate"]) == ("1.1", "2.0")
    assert ran.document["predicate"]["behaves"] == "fake_swing:Swing-v0 behaves differently from fake-swing 1.0"
    assert ran.document["claim"].startswith("fake-swing 1.1 is the last that behaves the same, up to rounding, and ")
    assert "fake-swing 2.0 the first that behaves otherwise; the next state" in ran.document["claim"]
    page = (desk.folder / "found" / "bisect.md").read_text(encoding="utf-8")
    assert "fake_swing:Swing-v0 behaves differently from fake-swing 1.0." in page

    ends = ("--good", "1.0", "--bad", "1.1")
    same = desk.run("bisect", cell, "--axis", "fake-swing", "--behaves", *ends, "--out", "alike", COLUMNS="80")
    said = " ".join(same.out.split())
    assert (same.code, "the bad end 1.1: behaves the same, up to rounding" in said) == (1, True)
    assert all(len(line) <= 80 or line.startswith(("repeat it: ", "written: ")) for line in same.out.splitlines())
    unnamed = desk.run("bisect", cell, "--axis", "fake-swing", "--behaves")
    assert (unnamed.code, "name the end with the right behaviour by --good" in unnamed.err) == (2, True)


def test_an_environment_whose_state_cannot_be_set_is_compared_in_seeded_runs(desk: Desk) -> None:
    """Short runs from seeded resets pass over rounding, find more gravity, and the sentence says how it was seen."""
    desk.matrix("hidden", SEED.replace("fake-swing", "fake-hidden").replace("fake_swing:Swing", "fake_hidden:Hidden"))
    frozen = desk.run("freeze", "hidden.toml/py*_fake-hidden-1.0", "--out", "hidden.npz")
    assert (frozen.code, frozen.out.partition(",")[0]) == (0, "fake_hidden:Hidden-v0: 300 states")
    runs = [desk.run("freeze", f"hidden.toml/py*_fake-hidden-{one}", "--check", "hidden.npz") for one in ("1.1", "2.0")]
    seen = "; its state cannot be set, so short runs from seeded resets were compared"
    assert (runs[0].code, runs[0].out.strip()) == (
        0,
        f"fake_hidden:Hidden-v0: behaves the same, up to rounding{seen}",
    )
    assert (runs[1].code, " ".join(runs[1].out.split()).endswith(seen)) == (1, True)
    assert runs[1].out.startswith("fake_hidden:Hidden-v0: behaves otherwise; the next state of the environment differs")


PROJECT = """
[build-system]
requires = []
build-backend = "_backend"
backend-path = ["."]
[project]
name = "own-swing"
version = "1.0"
"""
HOOKS = """
import os
def files(entries):
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "own_swing.py")) as file:
        entries["own_swing.py"] = file.read()
    return entries
"""
OWN = """
subject = "."
axes = { python = ["host"] }
index = { no_index = true, find_links = ["@WHEELS@"] }
[[cases]]
env = "own_swing:Swing-v0"
api = "gymnasium"
"""
WORKFLOW = "simmatrix freeze matrices/own.toml/py* --check own.npz"
"""The line of a workflow; the one before it installs simmatrix."""


def test_a_planted_change_of_gravity_in_a_package_under_test_fails_its_ci(desk: Desk) -> None:
    """The line of a workflow passes over code that changes nothing, and fails with a sentence for 0.1 % of gravity."""
    code = (fakes.FAKES / "swing" / "fake_swing.py").read_text(encoding="utf-8").replace("@VERSION@", "1.0")
    about = {
        "name": "own-swing",
        "version": "1.0",
        "metadata": fakes.metadata("1.0", {"name": "own-swing", "requires": ["gymnasium"]}),
    }
    texts = {
        "pyproject.toml": PROJECT,
        "about.json": json.dumps(about),
        "_backend.py": (fakes.FAKES / "_backend.py").read_text(encoding="utf-8"),
        "build_hooks.py": HOOKS,
        "own_swing.py": code,
    }
    for name, text in texts.items():
        (desk.folder / name).write_text(text, encoding="utf-8")
    (desk.folder / "matrices").mkdir()
    desk.matrix("matrices/own", OWN)
    frozen = desk.run("freeze", "matrices/own.toml/py*", "--out", "own.npz")
    assert frozen.code == 0, frozen.err

    (desk.folder / "own_swing.py").write_text(code + "\nUNUSED = 1\n", encoding="utf-8")
    same = desk.run(*shlex.split(WORKFLOW)[1:])
    assert (same.code, same.out.strip()) == (0, "own_swing:Swing-v0: behaves identically, to the bit")

    (desk.folder / "own_swing.py").write_text(code.replace("9.81 * ", "9.81 * 1.001 * "), encoding="utf-8")
    other = desk.run(*shlex.split(WORKFLOW)[1:])
    assert other.code == 1
    assert other.out.startswith("own_swing:Swing-v0: behaves otherwise; the next state of the environment differs in ")
