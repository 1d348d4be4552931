"""Families of cells that agree, and boundaries between neighbouring releases."""

from __future__ import annotations

from harness.physics.families import Compare, boundaries, families, letter
from harness.physics.relation import Class, Comparison


def by_value(values: dict[str, float], kinds: dict[frozenset[str], Class] | None = None) -> Compare:
    """Return a comparison in which cells agree whose values differ by at most 1."""

    def compare(one: str, other: str) -> Comparison:
        kind = Class.ROUND_OFF if abs(values[one] - values[other]) <= 1 else Class.CHANGED
        kind = (kinds or {}).get(frozenset({one, other}), kind)
        return Comparison(kind=kind, dynamics=kind, start=Class.IDENTICAL)

    return compare


def test_a_cell_joins_a_family_only_if_it_agrees_with_all_of_it() -> None:
    """Small steps do not add up to one family."""
    found = families(["a", "b", "c"], by_value({"a": 0, "b": 1, "c": 2}))
    assert found == {"a": "A", "b": "A", "c": "B"}


def test_a_cell_that_agrees_with_two_families_has_both_letters() -> None:
    """It is between them."""
    found = families(["a", "c", "b"], by_value({"a": 0, "b": 1, "c": 2}))
    assert found == {"a": "A", "c": "B", "b": "AB"}


def test_a_later_release_may_return_to_an_earlier_family() -> None:
    """A fix that was taken back."""
    assert families(["a", "b", "c"], by_value({"a": 0, "b": 9, "c": 0})) == {"a": "A", "b": "B", "c": "A"}


def test_a_difference_of_the_solver_alone_keeps_the_letter_with_a_prime() -> None:
    """It does not decide who else belongs to the family."""
    compare = by_value({"a": 0, "b": 0, "c": 0}, {frozenset("ab"): Class.SOLVER_PRECISION})
    assert families(["a", "b", "c"], compare) == {"a": "A", "b": "A'", "c": "A"}


def test_an_undecided_cell_has_a_question_mark_and_is_no_member() -> None:
    """A later cell that agrees with it, and not with the family, is no member either."""
    undecided = {frozenset("ab"): Class.UNDECIDED, frozenset("ac"): Class.UNDECIDED}
    compare = by_value({"a": 0, "b": 0, "c": 0, "d": 9}, undecided)
    assert families(["a", "b", "c", "d"], compare) == {"a": "A", "b": "A?", "c": "A?", "d": "B"}


def test_letters_go_on_after_z() -> None:
    """There may be more families than letters."""
    assert [letter(number) for number in (0, 25, 26, 53)] == ["A", "Z", "A1", "B2"]


INSTALLED = {"a": {"mujoco": "3.3", "numpy": "1"}, "b": {"mujoco": "3.4", "numpy": "1"},
             "d": {"mujoco": "3.6", "numpy": "2", "core": "1"}}  # fmt: skip


def test_a_boundary_names_the_release_only_where_nothing_else_moved() -> None:
    """Other packages that differ are listed, and so are releases that were not measured."""
    cells = {"3.3": "a", "3.4": "b", "3.6": "d"}
    found = boundaries("mujoco", ["3.3", "3.4", "3.5", "3.6"], cells, INSTALLED, by_value({"a": 0, "b": 5, "d": 9}))
    assert [(one.before, one.after, not one.others, one.between) for one in found] == [
        ("3.3", "3.4", True, ()),
        ("3.4", "3.6", False, ("3.5",)),
    ]
    assert found[1].moved == {"core": (None, "1"), "mujoco": ("3.4", "3.6"), "numpy": ("1", "2")}


def test_neighbours_that_only_start_otherwise_have_a_boundary() -> None:
    """They are one family, and the report says that they start from other states."""
    alike = Comparison(kind=Class.ROUND_OFF, dynamics=Class.ROUND_OFF, start=Class.OTHER_START)
    found = boundaries("mujoco", ["3.3", "3.4"], {"3.3": "a", "3.4": "b"}, INSTALLED, lambda *_: alike)
    assert [one.comparison.start for one in found] == [Class.OTHER_START]
    assert families(["a", "b"], lambda *_: alike) == {"a": "A", "b": "A"}


def test_neighbours_that_agree_have_no_boundary() -> None:
    """Rounding is none."""
    assert boundaries("mujoco", ["3.3", "3.4"], {"3.3": "a", "3.4": "b"}, INSTALLED, by_value({"a": 0, "b": 0})) == []
