"""Cells that are not green by cause, and which they are in words."""

from __future__ import annotations

from collections.abc import Iterable
from time import process_time

import msgspec
import pytest
from builders import diagnosis
from specimens import moved

from harness.model import Expectation, Verdict
from harness.model.report_types import CellEntry, DiagnosisEntry
from harness.reports.tables import cause_groups
from harness.reports.tables.table_types import Trouble
from harness.reports.text import cause_markdown

AXES = ("python", "mujoco")
PYTHONS, MUJOCOS = ("3.9", "3.10", "3.11"), ("2.3.7", "3.1.6", "3.3.7", "4.0.0")


def cell(python: str, mujoco: str, line: str | None = None, **more: object) -> CellEntry:
    """Return a cell of a matrix of Pythons and MuJoCos; with a line it is red."""
    verdict = Verdict.PARTIAL if line else Verdict.WORKS
    usual = {"as_expected": True, "expectation": None, "verdict": verdict, "decisive": line}
    return moved(2, {"python": python, "mujoco": mujoco}, **{**usual, **more})


def matrix(red: dict[tuple[str, str], CellEntry]) -> list[CellEntry]:
    """Return the whole product, green except for these cells."""
    return [red.get((python, mujoco)) or cell(python, mujoco) for python in PYTHONS for mujoco in MUJOCOS]


def broken(found: Iterable[tuple[str, str]], line: str = "no such field", **more: object) -> list[CellEntry]:
    """Return the product with the same failure in some cells."""
    return matrix({place: cell(*place, line, **more) for place in found})


def mujoco_diagnosis(signature: str, **more: object) -> DiagnosisEntry:
    """Return a known failure."""
    return diagnosis(signature, **{"remedy": {"requirements": ["mujoco<4"]}, "references": ("https://e.org",), **more})


def single_cause(cells: list[CellEntry]) -> Trouble:
    """Return the one cause of these cells."""
    (one,) = cause_groups.troubles(cells, AXES)
    return one


# --- which cells -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ([(python, "4.0.0") for python in PYTHONS], "all 3 combinations with mujoco 4.0.0"),
        ([("3.9", mujoco) for mujoco in MUJOCOS], "all 4 combinations with python 3.9"),
        (
            [(python, mujoco) for python in PYTHONS for mujoco in MUJOCOS[1:]],
            "all 9 combinations with mujoco 3.1.6 to 4.0.0",
        ),
        (
            [(python, mujoco) for python in PYTHONS for mujoco in ("2.3.7", "4.0.0")],
            "all 6 combinations with mujoco 2.3.7 or 4.0.0",
        ),
        ([(python, mujoco) for python in PYTHONS for mujoco in MUJOCOS], "all 12 combinations"),
        (
            [("3.9", "4.0.0"), ("3.10", "4.0.0"), ("3.10", "3.3.7")],
            "3 of 4 combinations with python 3.9 or 3.10, mujoco 3.3.7 or 4.0.0",
        ),
        ([("3.9", "4.0.0"), ("3.10", "4.0.0")], "`py3.9_mujoco-4.0.0`, `py3.10_mujoco-4.0.0`"),
    ],
)
def test_cells_in_words(found: list[tuple[str, str]], words: str) -> None:
    """Cells are described by the axes that set them apart, all of them or a count; a few are named."""
    assert single_cause(broken(found)).where == words


def test_an_axis_that_says_nothing_more_is_left_out() -> None:
    """If one release was tried on only one Python, the release alone describes its cells."""
    cells = [one for one in broken([(python, "4.0.0") for python in PYTHONS]) if one.axes["mujoco"] != "3.3.7"]
    cells = [one for one in cells if one.axes["mujoco"] == "4.0.0" or one.axes["python"] == "3.11"]

    assert single_cause(cells).where == "all 3 combinations with mujoco 4.0.0"


# --- one cause -------------------------------------------------------------------------------------------------


def test_one_broken_release_is_one_line() -> None:
    """Cells of one known failure are one, whatever their lines and verdicts; its proof is that of any of them."""
    places = [(python, "4.0.0") for python in PYTHONS]
    red = {place: cell(*place, f"line {place[0]}", diagnoses=(mujoco_diagnosis("gone"),)) for place in places}
    proof = mujoco_diagnosis("gone", proof="quick/py3.9_mujoco-4.0.0_with-cure", proven=True)
    red[places[0]] = cell(*places[0], "line", verdict=Verdict.BROKEN, diagnoses=(proof,))

    one = single_cause(matrix(red))

    assert (one.known, one.cells, one.where) == ("gone", 3, "all 3 combinations with mujoco 4.0.0")
    assert one.verdicts == ((Verdict.BROKEN, 1), (Verdict.PARTIAL, 2))
    assert (one.cause, one.remedy, one.applicable) == ("cause of gone", "install `mujoco<4`", True)
    assert [name for name, _ in one.proofs] == ["py3.9_mujoco-4.0.0_with-cure"]
    assert (one.proven, one.references) == (1, ("https://e.org",))
    assert len(one.explanations) == 3


def test_the_deepest_cause_counts() -> None:
    """A further cause that fits some cells stands beside the deepest cause, once."""
    first = cell("3.9", "4.0.0", "a", diagnoses=(mujoco_diagnosis("deep"), mujoco_diagnosis("other")))
    second = cell(
        "3.10",
        "4.0.0",
        "b",
        diagnoses=(mujoco_diagnosis("deep"), mujoco_diagnosis("other", proof="quick/x", proven=True)),
    )

    one = single_cause([first, second])

    assert (one.known, [(also.signature, bool(also.proofs)) for also in one.also]) == ("deep", [("other", True)])


def test_a_mask_is_a_cause_only_where_it_is_what_the_cell_says() -> None:
    """A mask that a log has beside the true reason is no cause of the cell."""
    mask = mujoco_diagnosis("mask", masks=True, seen="EOFError")

    said = single_cause([cell("3.9", "4.0.0", "EOFError: ", diagnoses=(mask,))])
    reason = single_cause([cell("3.9", "4.0.0", "KeyError: the true reason", diagnoses=(mask,))])
    deeper = single_cause(
        [cell("3.9", "4.0.0", "KeyError: the true reason", diagnoses=(mujoco_diagnosis("deep"), mask))]
    )

    assert (said.known, reason.known, deeper.known) == ("mask", "", "deep")
    assert deeper.also == ()


def test_a_known_line_gets_no_general_signature() -> None:
    """Unless it is of another line, or nothing specific is known."""
    special, broad = (
        mujoco_diagnosis("special", seen="no field"),
        mujoco_diagnosis("broad", seen="no field", generic=True),
    )
    elsewhere = mujoco_diagnosis("broad", seen="no file", generic=True)

    assert single_cause([cell("3.9", "4.0.0", "no field", diagnoses=(special, broad))]).also == ()
    assert [
        one.signature for one in single_cause([cell("3.9", "4.0.0", "x", diagnoses=(special, elsewhere))]).also
    ] == ["broad"]
    assert single_cause([cell("3.9", "4.0.0", "no field", diagnoses=(broad,))]).known == "broad"


def test_unknown_ones_by_their_line() -> None:
    """Versions and lines of files may differ; another phase is another failure."""
    one, two, three = (
        cell("3.9", mujoco, f"TypeError: in mujoco {mujoco}, line {mujoco[0]}") for mujoco in MUJOCOS[:3]
    )

    found = cause_groups.troubles([one, two, msgspec.structs.replace(three, phase="vector")], AXES)

    assert [(each.known, each.cells, each.phases) for each in found] == [("", 2, ("render",)), ("", 1, ("vector",))]


def test_unknown_ones_by_what_the_matrix_says() -> None:
    """One reason is one cause, with what has the same line and was not expected, if one reason alone has it."""
    said = [Expectation(verdict=Verdict.PARTIAL, reason=reason, link=f"https://e.org/{reason}") for reason in "ab"]
    cells = [
        cell("3.9", "2.3.7", "AssertionError", expectation=said[0]),
        cell("3.9", "3.1.6", "KeyError: 1", expectation=said[0]),
        cell("3.9", "3.3.7", "KeyError: 1", as_expected=False),
        cell("3.9", "4.0.0", "AssertionError", expectation=said[1]),
        cell("3.10", "4.0.0", "AssertionError", as_expected=False),
    ]

    found = cause_groups.troubles(cells, AXES)

    assert [(one.cause, one.cells, one.references) for one in found] == [
        ("a", 3, ("https://e.org/a",)), ("b", 1, ("https://e.org/b",)), ("", 1, ()),
    ]  # fmt: skip


def test_those_of_most_cells_first() -> None:
    """The release that broke most stands at the top."""
    red = {("3.9", "2.3.7"): cell("3.9", "2.3.7", "rare")}
    red |= {(python, "4.0.0"): cell(python, "4.0.0", "often") for python in PYTHONS}

    assert [one.line for one in cause_groups.troubles(matrix(red), AXES)] == ["often", "rare"]


def test_a_fix_that_a_neighbour_proves() -> None:
    """A cell that works and differs only in what the fix asks for shows that it helps; no other cell does."""
    cells = broken([("3.9", "4.0.0")], diagnoses=(mujoco_diagnosis("enums"),))
    cells = [msgspec.structs.replace(one, installed={"mujoco": one.axes["mujoco"]}) for one in cells]

    one = single_cause(cells)
    assert (one.proofs, one.neighbour) == ((), "py3.9_mujoco-3.3.7")  # the newest that the fix allows
    assert cause_markdown.proven(one) == "proven by a neighbour: `py3.9_mujoco-3.3.7` works and differs only in this"
    others = [cell for cell in cells if cell.axes["python"] != "3.9" or cell.axes["mujoco"] == "4.0.0"]
    assert cause_markdown.proven(single_cause(others)) == "not tried"


def test_a_fix_that_works_together_with_more() -> None:
    """A cell with the fix and other bounds besides is no proof of the fix alone."""
    red, green = broken([("3.9", "4.0.0")], diagnoses=(mujoco_diagnosis("enums"),))[3], cell("3.9", "3.3.7")
    red = msgspec.structs.replace(red, axes={**red.axes, "bounds": "declared"}, installed={"mujoco": "4.0.0"})
    green = msgspec.structs.replace(green, axes={**green.axes, "bounds": "known"}, installed={"mujoco": "3.3.7"})

    assert (
        cause_markdown.proven(single_cause([red, green]))
        == "not tried alone; `py3.9_mujoco-3.3.7` works with this and more"
    )


def test_many_cells_with_a_fix() -> None:
    """Three thousand red cells, each with its neighbour among as many that work, are grouped within seconds."""
    replace = msgspec.structs.replace
    red = replace(cell("3.9", "4.0.0", "no", diagnoses=(mujoco_diagnosis("enums"),)), installed={"mujoco": "4.0.0"})
    green = replace(cell("3.9", "3.3.7"), installed={"mujoco": "3.3.7"})
    cells = [
        replace(one, id=f"quick/py3.{number}_mujoco-{one.axes['mujoco']}", axes={**one.axes, "python": f"3.{number}"})
        for number in range(3000)
        for one in (red, green)
    ]

    start = process_time()
    assert single_cause(cells).neighbour == "py3.9_mujoco-3.3.7"
    assert process_time() - start < 15  # a search among all pairs took minutes
