"""The matrix in nox, as a user types it: nox itself loads a noxfile and runs the listed sessions."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from commandline import Desk

ROOT = Path(__file__).parents[3]
NOXFILE = 'from harness import noxface\n\nnoxface.cells("small.toml")\n'
PLAIN = 'requirements = ["fake-plain"]\ncases = [{ imports = ["fake_plain"] }]\n'
AWAY = PLAIN + 'index = { default = "http://127.0.0.1:9/simple" }\n[axes]\npython = ["host", "3.99"]\n'
ONLY_IMPORTED = PLAIN + 'index = { no_index = true, find_links = ["@WHEELS@"] }\n[axes]\npython = ["host"]\n'
NEVER_EXPANDED = PLAIN + '[axes]\npython = ["host"]\nmujoco = { range = ">=3" }\n'
BIG = PLAIN + f'[axes]\nmode = {{ variable = {[str(n) for n in range(60)]} }}\npython = ["3.9", "3.10"]\n'


def list_sessions(text: str) -> list[str]:
    """Return the sessions that `nox -l` prints, without their descriptions."""
    return re.findall(r"^[*-] (\S+)", text, re.MULTILINE)


def results(path: Path) -> dict[str, tuple[str, str | None]]:
    """Return the result and reason of each session, from nox's report."""
    sessions = json.loads(path.read_text())["sessions"]
    return {session["signatures"][0]: (session["result"], session["reason"]) for session in sessions}


def minor(desk: Desk) -> str:
    """Return the Python of the tests in the form that cells use."""
    label = desk.run("plan", "small.toml", "--json").document["cells"][0]["id"]
    return label.partition("/py")[2].partition("_")[0]


@pytest.fixture
def nox_desk(desk_with_results: Desk) -> Desk:
    """Return a working folder with a noxfile, in which the small matrix was run before."""
    (desk_with_results.folder / "noxfile.py").write_text(NOXFILE)
    return desk_with_results


def test_sessions_are_listed_as_they_can_be_selected(nox_desk: Desk) -> None:
    """nox lists one session per cell, none selected by default, and a big matrix as one session per Python.

    A matrix that cannot be planned is listed too, with its error.
    """
    nox_desk.matrix("range", NEVER_EXPANDED)
    nox_desk.matrix("big", BIG)
    asked = "range.toml, smal.toml,quickstrat,big.toml,./small.toml"
    python = minor(nox_desk)

    ran = nox_desk.run("-l", module="nox", HARNESS_MATRICES=asked)

    small = [f"cell(small/py{python}_good)", f"cell(small/py{python}_blank)"]
    unplanned = [f"cell({name})" for name in ("range.toml", "smal.toml", "quickstrat")]
    assert (ran.code, list_sessions(ran.out)) == (0, [*small, *unplanned, "matrix(big/py3.9)", "matrix(big/py3.10)"])
    assert f"- {small[0]} [small,py{python}] -> Measure one cell, or reuse what is known of it." in ran.out
    assert ran.err.splitlines() == [
        "simmatrix: range.toml: its ranges were never expanded, which asks the index; "
        "run `simmatrix lock range.toml` without --offline",
        "simmatrix: smal.toml: cannot be read: No such file or directory",
        'simmatrix: quickstrat: neither a matrix file (NAME.toml) nor a built-in matrix; did you mean "quickstart"?',
    ]

    for asked_for in ([small[1]], ["cell(range.toml)"], ["matrix(big/py3.9)"]):
        chosen = nox_desk.run("-l", "--json", "-s", *asked_for, module="nox", HARNESS_MATRICES=asked)
        assert [session["session"] for session in json.loads(chosen.out)] == asked_for
    chosen = nox_desk.run("-l", "--json", "-t", "big", "-p", "3.10", module="nox", HARNESS_MATRICES=asked)
    assert [session["session"] for session in json.loads(chosen.out)] == ["matrix(big/py3.10)"]


def test_a_session_ends_as_its_cell(nox_desk: Desk) -> None:
    """A session has the result of its cell: passed, failed with the decisive line, skipped, or inconclusive."""
    nox_desk.matrix("away", AWAY)
    nox_desk.matrix("only", ONLY_IMPORTED)
    python = minor(nox_desk)

    ran = nox_desk.run(
        *("-t", "small", "away", "only", "mistyped", "--report", "report.json", "--", "--offline"),
        module="nox",
        HARNESS_MATRICES="away.toml,only.toml,mistyped",
    )

    ended = results(nox_desk.folder / "report.json")
    assert ran.code == 1
    assert ended[f"cell(small/py{python}_good)"] == ("success", None)
    blank = ended[f"cell(small/py{python}_blank)"]
    assert blank[0] == "aborted"
    assert str(blank[1]).startswith("not as expected: partial in render: ")
    unsure = ended[f"cell(away/py{python})"]
    assert unsure[0] == "aborted"
    assert str(unsure[1]).startswith("inconclusive in resolve: ")
    missing = ended["cell(away/py3.99)"]
    assert missing[0] == "skipped"
    assert str(missing[1]).startswith("unavailable: python 3.99 is not on this machine")
    imported = ended[f"cell(only/py{python})"]
    assert imported[0] == "skipped"
    assert str(imported[1]).startswith("not run: ")
    assert ended["cell(mistyped)"][0] == "aborted"
    assert "harness run small.toml -k small/" in ran.err


def test_cells_run_side_by_side(desk: Desk) -> None:
    """nox's parallel mode runs sessions at once; the report that they share holds them all."""
    (desk.folder / "noxfile.py").write_text(NOXFILE)
    desk.matrix("small", (Path(__file__).parent / "small.toml").read_text())

    ran = desk.run("--parallel", "2", "-t", "small", module="nox")

    assert "No selected session allows parallel execution" not in ran.err
    report = json.loads((desk.state / "reports" / "small" / "report.json").read_text())
    assert [(cell["verdict"], cell["as_expected"]) for cell in report["cells"]] == [("works", True), ("partial", False)]
    assert all((desk.state / "reports" / "small" / cell["lock"]).is_file() for cell in report["cells"])


def test_our_noxfile_needs_nothing_but_nox(nox_desk: Desk) -> None:
    """A nox that was installed without the harness lists all other sessions, and one line says how to get the cells."""
    apart = "import sys; sys.modules['msgspec'] = None; from nox.__main__ import main; main()"
    (nox_desk.folder / "apart.py").write_text(apart)

    ours = nox_desk.run("-l", "-f", ROOT / "noxfile.py", module="nox")
    without = nox_desk.run("-l", "-f", ROOT / "noxfile.py", module="apart")

    own = ["lint", "tests", "endurance", "controls", "history", "newest", "costs", "report", "site"]
    own += ["pyz", "docs", "release"]
    assert [name for name in list_sessions(ours.out) if not name.startswith("cell(quickstart/")] == own
    assert len(list_sessions(ours.out)) == 6 + len(own)
    assert (without.code, list_sessions(without.out)) == (0, own)
    assert re.findall(r"^\* (\S+)", without.out, re.MULTILINE) == ["lint", "tests"]
    assert without.err == (
        "simmatrix cannot be imported (import of msgspec halted; None in sys.modules): uvx --with-editable . nox\n"
    )
