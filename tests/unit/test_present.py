"""What people read: the Markdown page whole, and the terminal as it fits."""

import io
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from rich.cells import cell_len
from rich.console import Console
from specimens import agrees, quick_document

import harness
from harness import document, present, tables
from harness.model import Verdict
from harness.reporttypes import SYMBOLS, Pivot, Square, word

TEMPLATE = (Path(harness.__file__).parent / "templates" / present.TEMPLATE).read_text(encoding="utf-8")


def page(report: tables.Report | None = None) -> str:
    """The Markdown page of `quick`."""
    return present.markdown(report or tables.report(quick_document()), TEMPLATE)


def screen(width: int, report: tables.Report | None = None) -> list[str]:
    """The lines on a terminal of this width."""
    output = io.StringIO()
    console = Console(file=output, width=width, highlight=False, markup=False, color_system=None)
    present.print_terminal(report or tables.report(quick_document()), console)
    return output.getvalue().splitlines()


def test_page(tmp_path: Path) -> None:
    """The whole page of a small matrix."""
    agrees("report.md", page(), tmp_path)


def test_page_of_a_stored_document() -> None:
    """A page made again from its report.json is the same to the byte."""
    stored = document.read(document.encode(quick_document()), "report.json")

    assert present.markdown(tables.report(stored), TEMPLATE) == page()


def test_tables_of_the_page_are_whole() -> None:
    """Every row of a table has as many cells as its head, whatever the lines say."""
    lines = page().splitlines()
    heads = [number for number, line in enumerate(lines) if line.startswith("| ---")]
    assert len(heads) == 3
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

    text = present.markdown(tables.report(alone), TEMPLATE)

    assert [line for line in text.splitlines() if line.startswith("#")] == [
        "# quick: what works together",
        "## Cells",
        "## Measured on",
    ]
    assert "\n\n\n" not in text


def test_page_with_expectations_out_of_date() -> None:
    """Expectations out of date have a section."""
    made = msgspec.structs.replace(quick_document(), stale=("expect[0] matches no cell",))

    assert (
        "## Expectations out of date\n\n- expect[0] matches no cell\n\n"
        in present.markdown(tables.report(made), TEMPLATE)
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
    assert "gymnasium \\ mujoco" in text
    assert "hid behind ConnectionResetError: [Errno 104] Connection reset by peer (vector.sync)" in text
    assert "not known; the matrix says: gymnasium 0.29 reads a field that mujoco 3.0 renamed" in text
    assert "as expected: gymnasium 0.29 reads a field that mujoco 3.0 renamed" in text
    assert "not verified: render (no EGL)" in text
    assert "the render mode 'depth_array' does not work (single.check_env, warning): 2 cells" in text
    assert "gymnasium 1.2 needs Python 3.10: 2 cells" in text
    assert "measured on linux-x86_64: capabilities egl, osmesa; gl vendor Mesa; os Debian 12" in text


def test_terminal_names_the_machine_where_there_are_several() -> None:
    """With results of several machines each says where it was measured, and squares say whose is which."""
    made = quick_document()
    twin = msgspec.structs.replace(made.cells[0], machine="z")
    broken = msgspec.structs.replace(made.cells[2], machine="z", verdict=Verdict.BROKEN, decisive="no GL")

    several = msgspec.structs.replace(made, cells=(*made.cells, twin, broken))
    lines = screen(120, tables.report(several, ("python", "gymnasium")))

    assert "8 cells, 10 results on 2 machines" in lines[0]
    assert "  in each square, from left to right: linux-x86_64, z" in lines
    assert any(line.split() == ["3.11", "∅", "1/2", "✘", "1/2", "◐", "1/2", "-"] for line in lines)
    told = " ".join(" ".join(lines).split())
    assert (told.count(" on every machine "), told.count(" on z ")) == (1, 2)  # the second among the causes


def test_page_says_which_machine_found_what() -> None:
    """A cell is explained once for all machines that agree, and by machine where they do not."""
    made = quick_document()
    twin = msgspec.structs.replace(made.cells[1], machine="z")
    broken = msgspec.structs.replace(made.cells[2], machine="z", verdict=Verdict.BROKEN, decisive="no GL")

    text = page(tables.report(msgspec.structs.replace(made, cells=(*made.cells, twin, broken))))

    both = "`py3.9-gymnasium0.29.1-mujoco3.3.7`, `py3.11-gymnasium0.29.1-mujoco3.3.7` on `linux-x86_64`"
    assert f"\n{both}: no known failure fits.\n" in text
    assert "\n`py3.9-gymnasium0.29.1-mujoco3.3.7`: ◐ partial in render\n" in text
    assert "\n`py3.11-gymnasium0.29.1-mujoco3.3.7` on `linux-x86_64`: ◐ partial in render\n" in text
    assert "\n`py3.11-gymnasium0.29.1-mujoco3.3.7` on `z`: no known failure fits.\n\nIt says:\n\n    no GL\n" in text
    assert "one per machine; from left to right: `linux-x86_64`, `z`." in text


def test_markup_is_text() -> None:
    """Square brackets in a decisive line are printed, not obeyed."""
    made = quick_document()
    odd = msgspec.structs.replace(made.cells[1], decisive="IndexError: [bold]x[/bold]")

    lines = screen(100, tables.report(msgspec.structs.replace(made, cells=(odd,))))

    assert any("IndexError: [bold]x[/bold]" in line for line in lines)


def test_green_rows_of_a_long_small_table_are_counted() -> None:
    """Of 70 rows a terminal shows the one in which something does not work; 60 are all shown."""
    told = tables.report(quick_document())
    works = Square(machine="m", verdict=Verdict.WORKS, count=1, total=1)
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


def test_what_was_repaired_is_told_on_a_terminal() -> None:
    """Beside the verdict, and what was changed below."""
    lines = screen(200)

    assert [line.split()[1:3] for line in lines if line.startswith("  repaired ")] == [["python", "3.9.18,"]]
    at = [line.rstrip() for line in lines].index("repaired: no resolver accepts them as the index has them")
    told = "  gymnasium 0.29.1, `Requires-Dist: shimmy (>=1.)` to `shimmy (>=1)`: an extra requires what is no version"
    assert lines[at + 1].startswith(told)
