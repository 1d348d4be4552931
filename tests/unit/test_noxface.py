"""Test which nox sessions are offered for a plan."""

from __future__ import annotations

from fnmatch import fnmatchcase

import pytest
from builders import make_plan, matrix

from harness import noxface
from harness.model import Plan

MANY = [f"m{number}" for number in range(60)]


def planned(axes: str) -> Plan:
    """Return a plan of cells that install nothing in particular."""
    text = f'cases = [{{ imports = ["x"] }}]\n[axes]\n{axes}'
    return make_plan(matrix(text, "wide.toml"), "3.11.7")


def offered(found: Plan) -> list[noxface.Offer]:
    """Return the sessions offered for a plan."""
    return list(noxface.sessions("matrices/wide.toml", found.matrix, found.cells))


def test_a_small_matrix_is_offered_cell_by_cell() -> None:
    """Each session runs its cell and no other, and can be selected by matrix and by Python."""
    found = offered(planned('python = ["3.9", "host"]\nnumpy = ["1.26.4"]'))

    assert [(each.id, each.glob, each.python, each.many, each.tags) for each in found] == [
        ("wide/py3.9_numpy-1.26.4", "wide/py3.9_numpy-1.26.4", "3.9", False, ("wide", "py3.9")),
        ("wide/py3.11.7_numpy-1.26.4", "wide/py3.11.7_numpy-1.26.4", "3.11.7", False, ("wide", "py3.11.7")),
    ]


def test_a_session_named_as_before_is_offered_when_it_is_typed(monkeypatch: pytest.MonkeyPatch) -> None:
    """`nox -s "cell(ID)"` finds the cell by the id of earlier versions, which no list shows."""
    found = planned('python = ["3.9", "host"]\nnumpy = ["1.26.4"]')
    monkeypatch.setattr("sys.argv", ["nox", "-s", "cell(wide/py3.9-numpy1.26.4)"])

    assert [(each.id, each.glob) for each in offered(found)] == [
        ("wide/py3.9_numpy-1.26.4", "wide/py3.9_numpy-1.26.4"),
        ("wide/py3.9-numpy1.26.4", "wide/py3.9_numpy-1.26.4"),
        ("wide/py3.11.7_numpy-1.26.4", "wide/py3.11.7_numpy-1.26.4"),
    ]


@pytest.mark.parametrize(
    "axes",
    [
        f'python = ["3.1", "3.10"]\nmode = {{ variable = {MANY} }}',
        f'mode = {{ variable = {MANY} }}\npython = ["3.1", "3.10"]',
        f'mode = {{ variable = {MANY} }}\npython = ["3.1", "3.10"]\nnumpy = ["1.26.4"]',
    ],
    ids=["first", "last", "between"],
)
def test_a_large_matrix_is_offered_by_python(axes: str) -> None:
    """Wherever Python stands in the ids, each session runs the cells of one, all together all of them."""
    found = planned(axes)

    sessions = offered(found)

    assert [(each.id, each.many) for each in sessions] == [("wide/py3.1", True), ("wide/py3.10", True)]
    for each in sessions:
        matched = [cell.axes["python"] for cell in found.cells if fnmatchcase(cell.id, each.glob)]
        assert matched == [each.python] * 60


def test_a_large_matrix_whose_pythons_no_glob_tells_apart_is_one_session() -> None:
    """A label of another axis may look like a Python."""
    axes = f'mode = {{ variable = {MANY} }}\npython = ["3.9", "3.10"]\n[axes.a."py3.9"]\n[axes.b.b]\n'

    assert [(each.id, each.glob, each.many, each.python) for each in offered(planned(axes))] == [
        ("wide", "*", True, None)
    ]
