"""Regrouping a document into tables: the middle stage, kept whole as a golden file."""

import unicodedata
from pathlib import Path

import msgspec
import pytest
from builders import GENERATED, HERE, MACHINES, case, record
from specimens import check_golden, quick, quick_document

from harness.model import Plan, Verdict, replace
from harness.model.errors import BadInput
from harness.model.report_types import SEVERITY, SYMBOLS, Document
from harness.reports import document
from harness.reports.tables import tables
from harness.reports.tables.table_types import Square


def test_everything_regrouped(tmp_path: Path) -> None:
    """The whole of a small matrix: list, pivot, explanations, findings, what was left out, locks, machines."""
    regrouped = msgspec.json.format(msgspec.json.encode(tables.report(quick_document())), indent=1).decode() + "\n"

    check_golden("tables.json", regrouped, tmp_path)


def test_every_cell_has_a_row() -> None:
    """The list has a row for every cell: unexpected ones, red ones, those that say nothing, then green ones."""
    made = quick_document()
    (sheet,) = tables.report(made).sheets

    assert sorted(row.id for row in sheet.rows) == sorted(cell.id for cell in made.cells)
    assert [(row.as_expected, str(row.verdict)) for row in sheet.rows] == [
        (False, "partial"),
        (False, "partial"),
        (False, "unresolvable"),
        (True, "partial"),
        (None, "unavailable"),
        (None, "not_run"),
        (True, "works"),
        (True, "works"),
    ]


def test_tables_of_a_document_that_was_stored() -> None:
    """The tables of a report.json are those of the run that wrote it."""
    made = quick_document()

    assert tables.report(document.read(document.encode(made), "r")) == tables.report(made)


def test_symbols() -> None:
    """Each verdict has a symbol of its own, one column wide."""
    assert set(SYMBOLS) == set(SEVERITY) == set(Verdict)
    assert len(set(SYMBOLS.values())) == len(SYMBOLS)
    assert {len(symbol) for symbol in SYMBOLS.values()} == {1}
    assert not {unicodedata.east_asian_width(symbol) for symbol in SYMBOLS.values()} & {"W", "F"}


class TestPivot:
    def test_named_axes(self) -> None:
        """The axes asked for, versions by age, with the verdict of each square, the tasks and the Pythons tried."""
        pivot = tables.report(quick_document(), ("gymnasium", "mujoco")).sheets[0].pivot

        assert pivot is not None
        assert (pivot.down, pivot.rows) == ("gymnasium", ("0.29.1", "1.2.3"))
        assert (pivot.across, pivot.columns) == ("mujoco", ("1.50", "2.3.7", "3.3.7"))
        assert pivot.squares[0] == (
            (Square(machine=HERE, verdict=Verdict.UNRESOLVABLE, pythons=("3.11",)),),
            (Square(machine=HERE, verdict=Verdict.WORKS, passed=2, tried=2, pythons=("3.9",), patched=True),),
            (Square(machine=HERE, verdict=Verdict.PARTIAL, passed=1, tried=2, pythons=("3.9", "3.11")),),
        )
        assert pivot.squares[1][0] == ()

    def test_axes_that_the_matrix_names(self) -> None:
        """They are those of the table, unless others are asked for."""
        made = quick_document()
        matrices = {"quick": msgspec.structs.replace(made.matrices["quick"], pivot=("mujoco", "python"))}
        made = msgspec.structs.replace(made, matrices=matrices)
        pivots = [tables.report(made, asked).sheets[0].pivot for asked in (None, ("gymnasium", "mujoco"))]

        assert [(one.down, one.across) for one in pivots if one] == [("mujoco", "python"), ("gymnasium", "mujoco")]

    def test_verdicts_of_a_square(self) -> None:
        """A square has an entry for each verdict: what speaks against packages first, then what says nothing."""
        pivot = tables.report(quick_document(), ("python", "gymnasium")).sheets[0].pivot

        assert pivot is not None
        assert [(one.verdict, one.where) for one in pivot.squares[1][1]] == [
            (Verdict.PARTIAL, ("mujoco 2.3.7",)),
            (Verdict.WORKS, ("mujoco 3.3.7",)),
        ]
        assert [one.verdict for one in pivot.squares[2][1]] == [Verdict.UNAVAILABLE]

    def test_a_cell_that_was_not_run_leaves_its_square_empty(self) -> None:
        """A cell without a measurement stands in no square, and takes no verdict from its neighbours."""
        made = quick_document()
        unrun = [cell for cell in made.cells if cell.verdict is Verdict.NOT_RUN]
        pivot = tables.report(made, ("python", "mujoco")).sheets[0].pivot

        assert [(cell.axes["python"], cell.axes["mujoco"]) for cell in unrun] == [("3.13", "2.3.7")]
        assert pivot is not None
        assert pivot.squares[pivot.rows.index("3.13")][pivot.columns.index("2.3.7")] == ()

    def test_machines_side_by_side(self) -> None:
        """Two machines share a square without one hiding the other."""
        made = record(case("pppp"))
        other = replace(made, machine="z", cases=(case("pfnn"),))
        plan = Plan(matrix="quick", cells=(made.cell,), axes=("python", "gymnasium"))
        whole = document.build([made, other], [plan], {**MACHINES, "z": {}}, GENERATED)

        (sheet,) = tables.report(whole, ("python", "gymnasium")).sheets

        assert sheet.pivot is not None
        assert [square.verdict for square in sheet.pivot.squares[0][0]] == [Verdict.WORKS, Verdict.BROKEN]
        assert [row.machine for row in sheet.rows] == ["z", HERE]  # red first

    def test_not_run_on_one_machine(self) -> None:
        """A machine without a result has no entry in the square."""
        made = record(case("pppp"))
        elsewhere = replace(made, cell=replace(made.cell, id="quick/other", axes={"python": "3.12"}), machine="z")
        plan = Plan(matrix="quick", cells=(made.cell, elsewhere.cell), axes=("python", "gymnasium"))
        whole = document.build([made, elsewhere], [plan], {**MACHINES, "z": {}}, GENERATED)

        (sheet,) = tables.report(whole, ("python", "gymnasium")).sheets

        assert sheet.pivot is not None
        assert [[one.machine for square in row for one in square] for row in sheet.pivot.squares] == [[HERE], ["z"]]

    def test_unknown_axis(self) -> None:
        """An axis that no matrix has is refused with those that there are."""
        with pytest.raises(BadInput) as caught:
            tables.report(quick_document(), ("python", "numpy"))

        assert str(caught.value) == (
            "--pivot python numpy: takes two axes of one matrix; known here: gymnasium, mujoco, python"
        )

    def test_nothing_to_compare(self) -> None:
        """A matrix of one cell has no pivot unless one is asked for."""
        made = record(case("pppp"))
        plan = Plan(matrix="quick", cells=(made.cell,), axes=("python", "gymnasium"))
        whole = document.build([made], [plan], MACHINES, GENERATED)

        assert tables.report(whole).sheets[0].pivot is None
        assert tables.report(whole, ("python", "gymnasium")).sheets[0].pivot is not None

    def test_one_axis_that_varies(self) -> None:
        """With one axis that varies, another stands across."""
        plan, records = quick()
        two = replace(plan, cells=plan.cells[:2])
        pivot = tables.report(document.build(records, [two], MACHINES, GENERATED)).sheets[0].pivot

        assert pivot is not None
        assert (pivot.down, pivot.across) == ("mujoco", "python")


def changed(**values: object) -> Document:
    """Return the document of `quick` with its first cell changed."""
    made = quick_document()
    first = msgspec.structs.replace(made.cells[0], **values)
    return msgspec.structs.replace(made, cells=(first, *made.cells[1:]))


class TestDrawing:
    @pytest.mark.parametrize(
        ("installed", "settings"),
        [
            (
                {"mujoco": "3.3.7", "pyopengl": "3.1.10"},
                ["DISPLAY=virtual", "MUJOCO_GL=osmesa", "PYOPENGL_PLATFORM=osmesa"],
            ),
            ({"pygame": "2.6.1"}, ["DISPLAY=virtual", "SDL_VIDEODRIVER=dummy"]),
        ],
    )
    def test_variables_to_set_are_those_that_packages_read(
        self, installed: dict[str, str], settings: list[str]
    ) -> None:
        """Of what the harness supplied a person is told what matters to the packages that are there."""
        supplied = {
            "DISPLAY": "virtual",
            "MUJOCO_GL": "osmesa",
            "PYOPENGL_PLATFORM": "osmesa",
            "SDL_VIDEODRIVER": "dummy",
        }
        told = self.drawing(installed=installed, supplied=supplied)

        assert told == [("set", setting) for setting in settings]

    def test_the_context_that_drew_is_described(self) -> None:
        """The context that drew is told in words, once for cases that had the same."""
        drawn = {"version": "4.5 Mesa", "vendor": "Mesa", "renderer": "llvmpipe", "device": "software", "api": "egl"}

        assert self.drawing(drawn=drawn) == [("renderer", "egl, llvmpipe, Mesa, 4.5 Mesa, software")]

    def test_without_frames(self) -> None:
        """Of a cell in which nothing was drawn there is nothing to say."""
        assert self.drawing(frames=(), supplied={"DISPLAY": "virtual"}) == []

    def drawing(
        self, frames: tuple[str, ...] = ("a.png",), drawn: dict[str, str] | None = None, **values: object
    ) -> list[tuple[str, str]]:
        """Return subject and text of each remark on drawing, for the first cell of `quick` with these frames."""
        made = quick_document().cells[0]
        cases = tuple(msgspec.structs.replace(case, frames=frames, drawn=drawn or {}) for case in made.cases)
        (sheet,) = tables.report(changed(cases=cases, **values)).sheets
        return [(remark.about, remark.text) for remark in sheet.drawing if made.id.endswith(remark.cells[0])]


class TestRow:
    def test_versions_as_installed(self) -> None:
        """The table prefers the installed version to the requested one; an absent package is a dash."""
        rows = {row.label: row for row in tables.report(changed(installed={"gymnasium": "0.29.2"})).sheets[0].rows}

        assert rows["py3.9_gymnasium-0.29.1_mujoco-2.3.7"].versions == ("3.9.18", "0.29.2", "2.3.7", "-")
        assert rows["py3.13_gymnasium-1.2.3_mujoco-3.3.7"].versions == ("3.13", "1.2.3", "3.3.7", "-")

    def test_variable_axis(self) -> None:
        """A variable that no axis names is taken from the cell's environment."""
        made = changed(environment={"MUJOCO_GL": "egl"})
        matrices = {"quick": msgspec.structs.replace(made.matrices["quick"], shown=("MUJOCO_GL",))}

        (sheet,) = tables.report(msgspec.structs.replace(made, matrices=matrices)).sheets

        assert [row.versions[-1] for row in sheet.rows if row.id == made.cells[0].id] == ["egl"]

    def test_works_though_red_was_expected(self) -> None:
        """A green cell that was expected to be red is explained like a red one."""
        made = quick_document()
        better = msgspec.structs.replace(
            made.cells[0], as_expected=False, expected=Verdict.PARTIAL, expectation=made.cells[1].expectation
        )

        (sheet,) = tables.report(msgspec.structs.replace(made, cells=(better,))).sheets

        assert sheet.troubles[0].explanations[0].expected == (
            "not as expected, which was partial in render with a line like 'solver_iter':"
            " gymnasium 0.29 reads a field that mujoco 3.0 renamed"
        )


def test_matrix_that_the_document_does_not_describe() -> None:
    """Without a description of its matrix the axes are those of the cells, in the order of letters as in a file."""
    made = msgspec.structs.replace(quick_document(), matrices={})

    assert tables.report(made).sheets[0].columns == ("gymnasium", "mujoco", "python")
