"""The verbs beside `run` and `try`: `plan`, `lock`, `report`, `show`, over real results."""

from __future__ import annotations

import json

from commandline import SMALL, Desk


def test_plan_lists_cells_and_what_was_dropped(desk: Desk) -> None:
    """`plan` says what would be run and what not, and runs nothing."""
    desk.matrix("small", SMALL.read_text())
    ran = desk.run("plan", "small.toml", "--json")
    assert ran.code == 0
    good, blank = ran.document["cells"]
    assert (good["axes"]["which"], good["cases"]) == ("good", ["fake_healthy-Healthy-v0"])
    assert (blank["axes"]["which"], blank["expected"]) == ("blank", "works")
    assert [dropped["reason"] for dropped in ran.document["dropped"]] == ["nobody wants it"]
    assert not {path.name for path in desk.state.glob("*")} & {"cells", "results", "evidence", "locks", "reports"}


def test_one_lock_is_printed_and_comes_out_the_same_again(desk: Desk, desk_with_results: Desk) -> None:
    """The same question has the same lock, byte for byte, from an empty state too."""
    first = desk_with_results.run("lock", "small.toml", "-k", "*-good")
    again = desk_with_results.run("lock", "small.toml", "-k", "*-good", "--upgrade")
    assert (first.code, again.code) == (0, 0)
    assert first.out == again.out
    assert first.out in {path.read_text() for path in desk_with_results.state.glob("locks/*.txt")}


def test_locks_of_many_cells_are_listed(desk_with_results: Desk) -> None:
    """Cells that ask the same have one lock; `--json` names its file."""
    ran = desk_with_results.run("lock", "small.toml", "--json")
    paths = {cell["lock"] for cell in ran.document["cells"]}
    assert (ran.code, len(ran.document["cells"]), len(paths)) == (0, 2, 1)
    assert (desk_with_results.folder / paths.pop()).read_text().startswith("cloudpickle==")


def test_a_cell_without_a_lock_is_1(desk: Desk) -> None:
    """`lock` fails where packages contradict each other, with uv's explanation."""
    text = (
        'requirements = ["fake-plain", "fake-unresolvable"]\n'
        'index = { no_index = true, find_links = ["@WHEELS@"] }\n'
        'cases = [{ imports = ["fake_plain"] }]\n[axes]\npython = ["host"]\n'
    )
    ran = desk.run("lock", desk.matrix("m", text), "--json")
    (cell,) = ran.document["cells"]
    assert (ran.code, cell["lock"]) == (1, None)
    assert cell["decisive"].startswith("Because only fake-plain>=1.0 is available")


def test_report_makes_the_page_again(desk_with_results: Desk) -> None:
    """`report` makes the page and the document again from `report.json`, byte for byte, in whatever folder."""
    folder = desk_with_results.state / "reports" / "small"
    page = (folder / "report.md").read_bytes()
    (folder / "report.md").unlink()
    assert desk_with_results.run("report", "small", "--out", "there").code == 1
    assert (desk_with_results.folder / "there" / "report.md").read_bytes() == page
    assert desk_with_results.run("report", folder, "--out", folder).code == 1
    assert (folder / "report.md").read_bytes() == page
    assert desk_with_results.run("report", "small", "--format", "md").out.encode() == page


def test_report_has_the_document_of_the_run(desk_with_results: Desk) -> None:
    """`report --json` is what `run --json` printed, with paths that start here."""
    document = desk_with_results.run("report", "small", "--json").document
    stored = json.loads((desk_with_results.state / "reports" / "small" / "report.json").read_text())
    assert [cell["verdict"] for cell in document["cells"]] == ["works", "partial"]
    assert [cell["key"] for cell in document["cells"]] == [cell["key"] for cell in stored["cells"]]
    assert all((desk_with_results.folder / cell["evidence"]).exists() for cell in document["cells"])


def test_a_file_is_no_folder_for_a_report(desk_with_results: Desk) -> None:
    """A report folder that cannot be written to is reported at once, in one sentence."""
    taken = desk_with_results.folder / "taken"
    taken.write_text("")
    ran = desk_with_results.run("report", "small", "--out", taken)
    assert (ran.code, ran.err) == (2, f"simmatrix: {taken}: no folder to write to: File exists; name another one\n")


def test_the_table_pivots(desk_with_results: Desk) -> None:
    """The terminal's table has a square for each pair of values, and a row for each cell with why it is red."""
    ran = desk_with_results.run("report", "small", "--pivot", "python", "which")
    assert "blank" in ran.out
    assert "ContractViolation: blank frame: every pixel is [0, 0, 0]" in " ".join(ran.out.split())


def test_show_tells_all_of_a_cell(desk_with_results: Desk) -> None:
    """`show` has the verdict, the line that says why, the checks, what is installed, and what to type next."""
    ran = desk_with_results.run("show", "*-blank")
    assert ran.code == 0
    for told in (
        "◐ partial in render",
        "ContractViolation: blank frame: every pixel is [0, 0, 0]",
        "render.rgb_array   failed",
        "gymnasium==1.2.3",
        "next",
    ):
        assert told in ran.out


def test_show_names_a_cell_that_was_not_run(desk_with_results: Desk) -> None:
    """A glob that matches several cells, or none, is bad input; the message names cells."""
    several, none = desk_with_results.run("show", "small/*"), desk_with_results.run("show", "*-odd")
    assert (several.code, none.code) == (2, 2)
    assert "matches 2 combinations; name one of small/py" in several.err
    assert "no combination of this name was measured" in none.err


def test_mistakes_of_a_run_are_refused_before_it_starts(desk: Desk) -> None:
    """Mistakes of a run end with code 2 before it starts.

    A pivot over no axis, one name for two matrices, no cell at all, no number of jobs: nothing is kept.
    """
    desk.matrix("small", SMALL.read_text())
    nothing = 'cases = [{ imports = ["fake_plain"] }]\nexclude = [{ when = { python = ">=3" }, reason = "no" }]\n'
    desk.matrix("nothing", nothing + '[axes]\npython = ["host"]\n')
    mistakes = {
        ("run", "small.toml", "--pivot", "python", "whch"): (
            "--pivot python whch: takes two axes of one matrix; known here: python, which"
        ),
        ("run", "small.toml", "./small.toml"): (
            "two matrices have the name small; name only one of them, or rename one"
        ),
        ("run", "nothing.toml"): ("nothing to do: every combination is left out; `simmatrix plan` gives the reasons"),
    }
    for arguments, sentence in mistakes.items():
        ran = desk.run(*arguments)
        assert (ran.code, ran.out, ran.err) == (2, "", f"simmatrix: {sentence}\n")
    assert desk.run("lock", "small.toml", "-j", "0").code == 2
    assert not desk.state.exists()
