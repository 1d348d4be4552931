"""Squares of the small table: which cells stand in them, and what they say was tried."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from builders import GENERATED, case, cell, document_of, make_plan, record

from harness.model import Cell, CellRecord, Change, Outcome, Phase, Role, Step, Tried, Verdict, replace
from harness.model.report_types import Document
from harness.reports.tables import squares, tables
from harness.reports.tables.table_types import Pivot, Square
from harness.reports.text import report_markdown

AXES = ("python", "mujoco")


def at(python: str, mujoco: str, label: str = "", cases: tuple[str, ...] = ("ant",), **more: str) -> Cell:
    """Return a cell of a matrix of Pythons and MuJoCos."""
    axes = {"python": python, "mujoco": mujoco, **more}
    return cell(label or f"py{python}-mujoco{mujoco}", cases, axes=axes, python=python)


def record_of(of: Cell, *outcomes: str, **more: Any) -> CellRecord:
    """Return a record of a cell, with the letters of each of its cases."""
    cases = [case(letters, one.id) for letters, one in zip(outcomes, of.cases, strict=True)]
    return record(*cases, of=of, **{"python": f"{of.python}.1", **more})


def report_of(*records: CellRecord, variants: frozenset[str] = frozenset(), axes: tuple[str, ...] = AXES) -> Document:
    """Return the document of a matrix."""
    return document_of(*records, axes=axes, variants=variants)


def pivot(*records: CellRecord, variants: frozenset[str] = frozenset(), axes: tuple[str, ...] = AXES) -> Pivot:
    """Return the table of these records, with MuJoCo down and Python across."""
    found = tables.report(report_of(*records, variants=variants, axes=axes), ("mujoco", "python")).sheets[0].pivot
    assert found is not None
    return found


def single_square(found: Pivot) -> tuple[Square, ...]:
    """Return the one square that is not empty."""
    (square,) = [square for row in found.squares for square in row if square]
    return square


MANY = tuple(f"task{number}" for number in range(11))


class TestTasks:
    @pytest.mark.parametrize(("failing", "shown"), [(1, "◐ 10/11"), (3, "◐ 8/11")])
    def test_a_square_counts_the_tasks_that_passed(self, failing: int, shown: str) -> None:
        """Of a partial cell the square says how many tasks passed of those tried."""
        letters = ["pppp"] * (11 - failing) + ["pfnn"] * failing
        found = pivot(record_of(at("3.11", "3.3.7", cases=MANY), *letters))

        assert report_markdown.mark(found, single_square(found)[0]) == shown

    def test_a_task_that_misleads_did_not_pass(self) -> None:
        """It raised nothing, and it is not counted among those that passed."""
        whole = report_of(record_of(at("3.11", "3.3.7"), "pppp"))
        wrong = msgspec.structs.replace(whole.cells[0].cases[0], misleads=("render.camera",))

        assert squares.tasks([whole.cells[0]]) == (1, 1)
        assert squares.tasks([msgspec.structs.replace(whole.cells[0], cases=(wrong,))]) == (0, 1)

    def test_missing_parts_of_this_machine_fail_no_task(self) -> None:
        """A task without rendering passed as far as it can be told; one that was never reached was not tried."""
        found = report_of(record_of(at("3.11", "3.3.7", cases=("a", "b")), "pppu", "nnnn"))

        assert squares.tasks(found.cells) == (1, 1)

    def test_a_task_has_to_pass_in_every_cell_of_the_square(self) -> None:
        """Cells of one verdict are counted together by their tasks, not by themselves."""
        found = report_of(
            record_of(at("3.10", "3.3.7", cases=("a", "b")), "pppp", "pfnn"),
            record_of(at("3.11", "3.3.7", cases=("a", "b")), "pfnn", "pppp"),
        )

        assert squares.tasks(found.cells) == (0, 2)


class TestRoles:
    def test_only_main_cells_stand_in_a_square(self) -> None:
        """A side condition and a change that fail leave the square of a working cell green, and it says so."""
        main, side = at("3.11", "3.3.7"), at("3.11", "3.3.7", "py3.11-beside", gym="0.21")
        tried = Tried(name="older", reason="why", change=Change(requirements=("numpy<1",)))
        changed = replace(main, id="quick/py3.11-mujoco3.3.7-with-older", base=main.id, tried=tried)
        found = pivot(
            record_of(main, "pppp"), record_of(side, "pfnn"), record_of(changed, "pfnn"), variants=frozenset({side.id})
        )

        (one,) = single_square(found)
        assert (one.verdict, one.varies, one.fixed) == (Verdict.WORKS, True, False)
        assert "`*`: fails under a side condition, listed below as variant." in report_markdown.legend(found)

    @pytest.mark.parametrize("by", ["change", "variant"])
    def test_a_red_square_says_that_a_change_makes_it_work(self, by: str) -> None:
        """Both count: a side condition that the matrix names, and a change that was tried."""
        main = at("3.11", "3.3.7")
        tried = Tried(name="cure", reason="why", change=Change(requirements=("numpy<2",)))
        other = replace(main, id="quick/other", **({"base": main.id, "tried": tried} if by == "change" else {}))
        found = pivot(
            record_of(main, "pfnn"),
            record_of(other, "pppp"),
            variants=frozenset({other.id} - {by == "change" and other.id}),
        )

        assert report_markdown.mark(found, single_square(found)[0]) == "✘→✔ 0/1"
        assert "→✔: works with a change that is listed below." in report_markdown.legend(found)

    def test_role_of_each_cell_is_in_the_document(self) -> None:
        """Main, side condition, change, and the remedy that the harness tried."""
        main, side = at("3.11", "3.3.7"), at("3.11", "2.3.7")
        what_if = Tried(name="older", reason="why", change=Change(requirements=("numpy<1",)))
        repair = replace(what_if, name="cure", proving=True)
        cells = (
            main,
            side,
            replace(main, id="quick/a", base=main.id, tried=what_if),
            replace(main, id="quick/b", base=main.id, tried=repair),
        )
        found = report_of(*(record_of(one, "pppp") for one in cells), variants=frozenset({side.id}))

        assert [one.role for one in found.cells] == [Role.MAIN, Role.VARIANT, Role.WHAT_IF, Role.REPAIR]

    def test_side_conditions_of_a_matrix(self) -> None:
        """Cells that a `variant` names are known by their ids; one that names none is out of date."""
        text = (
            'axes = { python = ["3.11"], mujoco = ["2.3.7", "3.3.7"] }\n'
            '[[cases]]\nenv = "Ant-v5"\napi = "gymnasium"\n'
            '[[variant]]\nwhen = { mujoco = "<3" }\nreason = "old"\n'
            '[[variant]]\nwhen = { mujoco = ">4" }\nreason = "newer"\n'
        )
        planned = make_plan(text)

        assert [one.id in planned.variants for one in planned.cells] == [True, False]
        assert planned.stale == ('demo.toml: variant[1] matches no cell (reason: "newer")',)


class TestWhere:
    def test_python_that_is_red_alone(self) -> None:
        """Of a square with two verdicts each has its Pythons."""
        step = Step(phase=Phase.INSTALL, outcome=Outcome.FAILED, decisive="no wheel", log="log")
        cells = [at(python, "3.17.0", f"py{python}", numpy="2.4.6") for python in ("3.11", "3.12", "3.13")]
        records = [
            record_of(cells[0], "pppp"),
            record_of(cells[1], "pppp"),
            replace(record(of=cells[2], python="3.13.1"), install=step),
        ]
        found = tables.report(report_of(*records, axes=(*AXES, "numpy")), ("mujoco", "numpy")).sheets[0].pivot

        assert found is not None
        assert [(one.verdict, one.pythons, one.where) for one in single_square(found)] == [
            (Verdict.UNINSTALLABLE, ("3.13",), ()),
            (Verdict.WORKS, ("3.11", "3.12"), ()),
        ]
        assert report_markdown.small_table(found).splitlines()[2] == (
            "| 3.17.0 | ⊘<br><sub>3.13</sub><br>✔\N{NO-BREAK SPACE}1/1<br><sub>3.11, 3.12</sub> |"
        )

    def test_other_differences_are_named(self) -> None:
        """A red cell on another Python with another numpy is not put down to the Python alone."""
        records = [
            record_of(at("3.9", "3.3.7", "a", numpy="1.26.4"), "pppp"),
            record_of(at("3.10", "3.3.7", "b", numpy="2.0.2"), "pfnn"),
        ]
        records += [record_of(at("3.9", "2.3.7", "c", numpy="1.26.4", GL="egl"), "pppp")]
        found = tables.report(report_of(*records, axes=(*AXES, "numpy", "GL")), ("mujoco", "GL")).sheets[0].pivot

        assert found is not None
        assert [one.where for one in found.squares[1][0]] == [("numpy 2.0.2",), ("numpy 1.26.4",)]

    def test_unavailable_never_makes_a_square_red(self) -> None:
        """Beside a verdict about the packages it stands last, with its Python."""
        works, lacking = at("3.11", "3.3.7", "a", gl="egl"), at("3.12", "3.3.7", "b", gl="egl")
        absent = CellRecord(cell=lacking, machine="linux-x86_64", unavailable="no torch", measured=GENERATED)
        found = (
            tables.report(report_of(record_of(works, "pppp"), absent, axes=(*AXES, "gl")), ("mujoco", "gl"))
            .sheets[0]
            .pivot
        )

        assert found is not None
        assert [(one.verdict, one.pythons) for one in single_square(found)] == [
            (Verdict.WORKS, ("3.11",)),
            (Verdict.UNAVAILABLE, ("3.12",)),
        ]

    def test_a_known_silent_defect_that_was_not_excluded(self) -> None:
        """A green cell that nothing checked for it is not plainly green."""
        whole = report_of(record_of(at("3.11", "3.3.7"), "pppp"))
        doubted = msgspec.structs.replace(whole.cells[0], unverified=("silent:some-id",))
        found = tables.report(msgspec.structs.replace(whole, cells=(doubted,)), ("mujoco", "python")).sheets[0].pivot

        assert found is not None
        assert report_markdown.mark(found, single_square(found)[0]) == "✔? 1/1"
        (sheet,) = tables.report(msgspec.structs.replace(whole, cells=(doubted,))).sheets
        assert report_markdown.result(sheet).startswith(
            "0 of 1 combination work. 1 more raises no error, but a known silent defect was not excluded."
        )


def test_the_axis_of_more_values_goes_down() -> None:
    """A table grows downwards, for a page and a terminal end at the right."""
    wide = [record_of(at("3.11", version), "pppp") for version in ("3.1.0", "3.2.0", "3.3.0")]
    found = tables.report(report_of(*wide, record_of(at("3.12", "3.3.0"), "pppp"))).sheets[0].pivot

    assert found is not None
    assert (found.down, found.across) == ("mujoco", "python")
