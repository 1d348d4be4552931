"""`accept`: turn failures measured here, or reported by other machines, into expectations that hold at once."""

from __future__ import annotations

import json

from commandline import Desk


def test_accepted_cells_are_as_expected(desk_with_results: Desk) -> None:
    """The new table is printed and added to the file, the rest of the file stays, and the next run ends with 0."""
    path = desk_with_results.folder / "small.toml"
    before = path.read_text()
    assert desk_with_results.run("run", "small.toml").code == 1

    tried = desk_with_results.run("accept", "small.toml", "-k", "*", "--reason", "it draws nothing", "--dry-run")
    assert path.read_text() == before
    made = desk_with_results.run(
        "accept", "small.toml", "-k", "*", "--reason", "it draws nothing", "--until", "2999-12-31"
    )

    assert (tried.code, made.code) == (0, 0)
    assert path.read_text() == before + "\n" + made.out
    assert made.out == (
        '[[expect]]\nwhen = { which = "blank" }\nverdict = "partial"\nphase = "render"\n'
        "code = \"render.blank\"\ndata = { got = '\\[0, 0, 0\\]' }\n"
        'reason = "it draws nothing"\nuntil = "2999-12-31"\n'
    )
    assert tried.out == made.out.replace('until = "2999-12-31"\n', "")
    assert made.err == "small.toml: 1 cell accepted with 1 table\n"
    assert desk_with_results.run("run", "small.toml").code == 0
    again = desk_with_results.run("accept", "small.toml", "-k", "*", "--reason", "again")
    assert (again.code, again.out, again.err) == (
        0, "", "nothing to accept: 2 combinations work or fail as expected\n"
    )  # fmt: skip


def test_a_report_from_elsewhere(desk_with_results: Desk) -> None:
    """`--report` uses the results of other machines; if they differ, nothing is accepted and the exit code is 1."""
    report = desk_with_results.state / "reports" / "small" / "report.json"
    made = json.loads(report.read_text())
    red = next(cell for cell in made["cells"] if cell["verdict"] == "partial")
    made["cells"].append({**red, "verdict": "works", "machine": "elsewhere", "decisive": None, "phase": None})
    report.write_text(json.dumps(made))

    mixed = desk_with_results.run("accept", "small.toml", "-k", "*-blank", "--reason", "x", "--report", "small")

    here = red["machine"]
    assert (mixed.code, mixed.out) == (1, "")
    assert f"{red['id']}: partial on {here}, works on elsewhere; no expectation fits them all" in mixed.err


def test_mistakes(desk_with_results: Desk) -> None:
    """Bad input ends with code 2 and writes nothing.

    No such cell, nothing measured, another matrix, a day that has passed, or no reason.
    """
    path = desk_with_results.folder / "small.toml"
    report = desk_with_results.state / "reports" / "small"
    path.write_text(path.read_text().replace("requirements = [", 'requirements = ["fake-plain", '))
    before = path.read_text()
    wrong = {
        ("-k", "*odd", "--reason", "x"): "-k *odd: none of the 2 combinations matches",
        (
            "-k",
            "*",
            "--reason",
            "x",
        ): "small: no results on this machine; run `simmatrix run` first, or name a report.json",
        ("-k", "*", "--reason", "x", "--report", report): "has changed in the matrix since; measure it again",
        ("-k", "*", "--reason", "x", "--until", "2020-01-01"): "2020-01-01 has passed already",
        ("-k", "*", "--reason", " "): "give the reason why these combinations fail",
    }
    for arguments, sentence in wrong.items():
        ran = desk_with_results.run("accept", "small.toml", *arguments)
        assert (ran.code, ran.out) == (2, "")
        assert sentence in ran.err
    assert path.read_text() == before
