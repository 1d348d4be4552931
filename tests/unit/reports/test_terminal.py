"""Test the output for people: the whole Markdown page, and the lines that fit a terminal."""

import argparse
import io
import re
from pathlib import Path

import msgspec
import pytest
from rich.cells import cell_len
from rich.console import Console
from specimens import check_golden, quick_document

from harness.commands import report as report_verb
from harness.machine.console import MOST_WIDTH
from harness.model import Verdict, replace
from harness.model.report_types import SYMBOLS, word
from harness.reports import document
from harness.reports.tables import tables
from harness.reports.tables.table_types import Pivot, Square
from harness.reports.template_files import read_template
from harness.reports.text import markdown_texts, report_markdown, terminal

TEMPLATE = read_template(report_markdown.TEMPLATE)


def page(report: tables.Report | None = None) -> str:
    """Return the Markdown page of `quick`."""
    return report_markdown.markdown(report or tables.report(quick_document()), TEMPLATE)


def screen(width: int, report: tables.Report | None = None) -> list[str]:
    """Return the lines on a terminal of this width."""
    output = io.StringIO()
    console = Console(file=output, width=width, highlight=False, markup=False, color_system=None)
    terminal.show(report or tables.report(quick_document()), console)
    return output.getvalue().splitlines()


def test_page(tmp_path: Path) -> None:
    """The whole page of a small matrix."""
    check_golden("report.md", page(), tmp_path)


def test_page_of_a_stored_document() -> None:
    """A page made again from its report.json is the same to the byte."""
    stored = document.read(document.encode(quick_document()), "report.json")

    assert report_markdown.markdown(tables.report(stored), TEMPLATE) == page()


def test_tables_of_the_page_are_whole() -> None:
    """Every row of a table has as many cells as its head, whatever the lines say."""
    lines = page().splitlines()
    heads = [number for number, line in enumerate(lines) if line.startswith("| ---")]
    assert len(heads) == 6
    for head in heads:
        columns = lines[head].count("|")
        rows = iter(lines[head - 1 :])
        for line in rows:
            if not line.startswith("|"):
                break
            assert line.replace("\\|", "").count("|") == columns, line


def test_page_without_anything_to_explain() -> None:
    """A page of working cells has no empty sections."""
    made = quick_document()
    green = msgspec.structs.replace(made.cells[0], findings=(), lock=None, repairs=())
    alone = msgspec.structs.replace(made, cells=(green,), dropped=())

    text = report_markdown.markdown(tables.report(alone), TEMPLATE)

    assert [line for line in text.splitlines() if line.startswith("#")] == [
        "# quick: what works together",
        "## Environments tried",
        "## Combinations",
        "## Measured on",
    ]
    assert "\n\n\n" not in text


def test_page_with_expectations_out_of_date() -> None:
    """Expectations out of date have a section."""
    made = msgspec.structs.replace(quick_document(), stale=("expect[0] matches no cell",))

    assert (
        "## Expectations out of date\n\n- expect[0] matches no cell\n\n"
        in report_markdown.markdown(tables.report(made), TEMPLATE)
    )  # fmt: skip


@pytest.mark.parametrize("width", [50, 80, 100, 200])
def test_terminal_fits(width: int) -> None:
    """No line is wider than the terminal."""
    assert max(map(cell_len, screen(width))) <= width


@pytest.mark.parametrize("width", [80, 100, 200])
def test_terminal_cuts_nothing_off(width: int) -> None:
    """Long lines are wrapped: every cell's name and reason is there in full."""
    text = "".join("".join(screen(width)).split())

    for row in tables.report(quick_document()).sheets[0].rows:
        assert row.label in text
        assert row.why.replace(" ", "") in text


def test_terminal_tells_all() -> None:
    """Verdicts by symbol and word, the pivot, reasons, findings, what was left out, and the machine."""
    text = " ".join("\n".join(screen(120)).split())

    for verdict in (Verdict.WORKS, Verdict.PARTIAL, Verdict.UNAVAILABLE, Verdict.NOT_RUN, Verdict.UNRESOLVABLE):
        assert f"{SYMBOLS[verdict]} {word(verdict)}" in text
    assert "mujoco \\ gymnasium" in text
    assert "hid behind ConnectionResetError: [Errno 104] Connection reset by peer (vector.sync)" in text
    assert "not known; the matrix says: gymnasium 0.29 reads a field that mujoco 3.0 renamed" in text
    assert "as expected: gymnasium 0.29 reads a field that mujoco 3.0 renamed" in text
    assert "not verified: render (no EGL)" in text
    assert "the render mode 'depth_array' does not work (single.check_env; warning): 2 cells" in text
    assert "gymnasium 1.2 needs Python 3.10: 2 combinations" in text
    assert "measured on linux-x86_64: architecture x86_64; egl llvmpipe, Mesa/X.org, 4.5 Mesa 22.3.6; gpu none" in text


def test_terminal_names_the_machine_where_there_are_several() -> None:
    """With results of several machines each says where it was measured, and squares say whose is which."""
    made = quick_document()
    twin = msgspec.structs.replace(made.cells[0], machine="z")
    broken = msgspec.structs.replace(made.cells[2], machine="z", verdict=Verdict.BROKEN, decisive="no GL")

    several = msgspec.structs.replace(made, cells=(*made.cells, twin, broken))
    lines = screen(120, tables.report(several, ("python", "gymnasium")))

    assert "8 combinations, 10 results on 2 machines" in lines[0]
    said = " ".join(" ".join(lines).split())
    assert "Machines: 1 linux-x86_64, 2 z." in said
    assert any("2: ✘ 1/2" in line for line in lines)
    assert (said.count(" on every machine "), said.count(" on z ")) == (1, 2)  # the second among the causes


def test_page_says_which_machine_found_what() -> None:
    """A cell is explained once for all machines that agree, and by machine where they do not."""
    made = quick_document()
    twin = msgspec.structs.replace(made.cells[1], machine="z")
    broken = msgspec.structs.replace(made.cells[2], machine="z", verdict=Verdict.BROKEN, decisive="no GL")

    text = page(tables.report(msgspec.structs.replace(made, cells=(*made.cells, twin, broken))))

    both = "`py3.9_gymnasium-0.29.1_mujoco-3.3.7`, `py3.11_gymnasium-0.29.1_mujoco-3.3.7` on `linux-x86_64`"
    assert f"\n**{both}: ◐ partial in render.**\n" in text
    assert "\n**`py3.11_gymnasium-0.29.1_mujoco-3.3.7` on `z`: ✘ broken in render.**\n" in text
    assert "\nNo known issue fits.\n\n    no GL\n" in text
    assert "Machines: 1 linux-x86_64, 2 z." in text


def test_markup_is_text() -> None:
    """Square brackets in a decisive line are printed, not obeyed."""
    made = quick_document()
    odd = msgspec.structs.replace(made.cells[1], decisive="IndexError: [bold]x[/bold]")

    lines = screen(100, tables.report(msgspec.structs.replace(made, cells=(odd,))))

    assert any("IndexError: [bold]x[/bold]" in line for line in lines)


REPORTS = sorted((Path(__file__).parents[3] / "reports").glob("*/report.json"))


@pytest.mark.parametrize("width", [80, 100, 140])
@pytest.mark.parametrize("path", REPORTS, ids=lambda path: path.parent.name)
def test_committed_reports_can_be_read_at_every_width(path: Path, width: int) -> None:
    """No line is too wide; every value of the table's axes is whole, and no sign is apart from its tasks."""
    report = tables.report(document.read(path.read_bytes(), str(path)))
    output = io.StringIO()
    console = Console(file=output, width=width, highlight=False, markup=False, color_system=None)
    terminal.show_summary(report, console)
    lines = output.getvalue().splitlines()

    assert max(map(cell_len, lines)) <= width
    assert "…" not in output.getvalue()
    for pivot in (sheet.pivot for sheet in report.sheets if sheet.pivot):
        text = "".join(output.getvalue().split())
        marks = {name: {report_markdown.mark(pivot, one) for square in row for one in square}
                 for name, row in zip(pivot.rows, pivot.squares, strict=True)}  # fmt: skip
        if "more rows in which all works" in output.getvalue():
            marks = {name: row for name, row in marks.items() if not all(mark.startswith("✔") for mark in row)}
        assert all(part in text for name in (*marks, *pivot.columns) for part in name.split("-"))
        for mark in set().union(*marks.values()):
            assert any(mark in line for line in lines)


def test_many_reports_are_shown_by_their_counts(capsys: pytest.CaptureFixture[str]) -> None:
    """Of more than eight reports each has its name and counts, and nothing else; of eight all is shown."""
    arguments = argparse.ArgumentParser()
    report_verb.add_arguments(arguments)
    names = [str(path) for path in REPORTS[:9]]

    report_verb.main(arguments.parse_args(names))
    overview = capsys.readouterr().out
    report_verb.main(arguments.parse_args(names[1:]))
    full = capsys.readouterr().out

    assert overview.endswith("\n\n9 reports; one in full: simmatrix report MATRIX\n")
    assert len(overview.splitlines()) < 9 * 6 < len(full.splitlines())
    for path in REPORTS[1:9]:
        assert any(line.startswith(f"{path.parent.name}: ") for line in overview.splitlines())
        assert any(line.startswith(f"{path.parent.name}: ") for line in full.splitlines())


def test_terminal_has_the_width_that_columns_says(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """COLUMNS is the width of an output that is no terminal; without it, 100."""
    widths = []
    for columns in ("140", "80", "", "wide"):
        monkeypatch.setenv("COLUMNS", columns)
        terminal.show(tables.report(quick_document()))
        widths.append(max(map(cell_len, capsys.readouterr().out.splitlines())))

    assert [80 < widths[0] <= 140, widths[1] <= 80, 80 < widths[2] <= 100, widths[2] == widths[3]] == [True] * 4


def test_terminal_has_a_sane_width(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Whatever COLUMNS says, no line is filled up to it."""
    monkeypatch.setenv("COLUMNS", "20000")
    terminal.show(replace(tables.report(quick_document()), stale=("word " * 1000,)))
    assert MOST_WIDTH - 5 <= max(map(cell_len, capsys.readouterr().out.splitlines())) <= MOST_WIDTH


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        ("install `mujoco<3`", "install `mujoco<3`"),
        ("`a|b` or c|d", "`a\\|b` or c\\|d"),
        ("take <option> out, *now*; 1 < 2", "take `<option>` out, \\*now\\*; 1 < 2"),
        ("<class 'x'> in ``<y>``", "`<class 'x'>` in ``<y>``"),
    ],
)
def test_code_is_shown_as_it_is_typed(text: str, cell: str) -> None:
    """A code span holds no HTML, since people copy it; prose begins no tag, and ends no cell of a table."""
    assert report_markdown.table_cell(text) == cell


def test_no_fix_of_a_committed_report_is_escaped() -> None:
    """In the reports on GitHub, too: an entity inside a code span is shown as it stands."""
    pages = [path.with_name("report.md").read_text(encoding="utf-8") for path in REPORTS]
    codes = [found[0] for text in pages for found in markdown_texts.CODE.finditer(text)]

    assert [code for code in codes if re.search(r"&(?:\w+|#\d+);", code)] == []
    assert any("<" in code for code in codes)


def test_page_begins_with_the_result() -> None:
    """The table follows, then place and time of measurement, environments, failures, and the list of all."""
    heads = [line for line in page().splitlines() if line.startswith(("#", "**", "| mujoco ", "Measured on"))]

    assert heads[0] == "# quick: what works together"
    assert heads[1].startswith("**2 of 8 combinations work. 3 results are not as expected.** 8 combinations: ")
    assert heads[2].startswith("| mujoco ╲ gymnasium |")
    assert heads[3] == (
        "Measured on 2026-11-21 on one machine: Linux x86-64, CPU only. Not covered: macOS, Windows, arm64, GPUs."
    )
    sections = [line for line in heads if line.startswith("## ")]
    assert sections[:3] == ["## Environments tried", "## What does not work, and why", "## Combinations"]


def test_title_of_a_matrix() -> None:
    """A matrix whose cells fail on purpose says so; the number of its main cells stands in its title."""
    made = quick_document()
    matrices = {"quick": msgspec.structs.replace(made.matrices["quick"], title="{cells} deliberate crashes")}

    assert page(tables.report(msgspec.structs.replace(made, matrices=matrices))).startswith(
        "# quick: 8 deliberate crashes\n"
    )


def test_findings_on_reproducibility_come_first() -> None:
    """However few cells have them; which cells is said by the values of their axes, not by a list."""
    made = quick_document()
    finding = made.cells[0].findings[0]
    common = msgspec.structs.replace(finding, check="single.check_env", text="a complaint")
    rare = msgspec.structs.replace(finding, check="single.repeat.same", text="another trajectory")
    cells = tuple(
        msgspec.structs.replace(cell, findings=(common, rare) if place == 2 else (common,))
        for place, cell in enumerate(made.cells)
    )
    text = page(tables.report(msgspec.structs.replace(made, cells=cells)))

    summaries = [line for line in text.splitlines() if line.startswith("<summary>") and "finding" in line]
    assert summaries == [
        "<summary>Reproducibility: 1 finding</summary>",
        "<summary>API conformance: 1 finding</summary>",
    ]
    assert text.index("- another trajectory (single.repeat.same; warning): `py3.11_") < text.index("- a complaint")
    assert "- a complaint (single.check_env; warning): all 8 combinations\n" in text


def test_many_combinations_left_out_are_counted() -> None:
    """A selection or a strategy leaves out hundreds."""
    made = quick_document()
    gone = tuple(msgspec.structs.replace(made.dropped[0], id=f"quick/{number}") for number in range(700))

    assert "\n- gymnasium 1.2 needs Python 3.10: 700 combinations\n" in page(
        tables.report(msgspec.structs.replace(made, dropped=gone))
    )


def test_green_rows_of_a_long_small_table_are_counted() -> None:
    """Of 70 rows a terminal shows the one in which something does not work; 60 are all shown."""
    told = tables.report(quick_document())
    works = Square(machine="m", verdict=Verdict.WORKS, passed=1, tried=1)
    squares = [((replace(works, verdict=Verdict.BROKEN) if number == 7 else works,),) for number in range(70)]

    def shown(rows: int) -> list[str]:
        names = tuple(f"row{number}" for number in range(rows))
        pivot = Pivot(down="a", across="b", rows=names, columns=("1",), squares=tuple(squares[:rows]))
        lines = screen(100, replace(told, sheets=(replace(told.sheets[0], pivot=pivot),)))
        return [line.strip() for line in lines if line.startswith("  row") or "in which all works" in line]

    assert len(shown(60)) == 60
    row, more = shown(70)
    assert row.startswith("row7 ")
    assert more == "69 more rows in which all works"


def test_patches_are_listed_on_a_terminal() -> None:
    """The verdict says `patched`, and the changes are listed below."""
    lines = screen(200)

    assert [line.split()[:3] for line in lines if ", patched " in line] == [["✔", "works,", "patched"]]
    at = [line.rstrip() for line in lines].index("patched: these releases cannot be installed as published")
    words = "  gymnasium 0.29.1, `Requires-Dist: shimmy (>=1.)` to `shimmy (>=1)`: an extra requires what is no version"
    assert lines[at + 1].startswith(words)
