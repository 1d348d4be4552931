"""Digests of source: what it does, not how it is written."""

from __future__ import annotations

import ast

import pytest

from harness.probes import syntax


def digest(source: str, *but: str) -> str:
    """Digest a source."""
    return syntax.digest(ast.parse(source), but)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("a = 1", "a=1 # one"),
        ("def f():\n    return 1", "def f():\n\n    '''Give one.'''\n    return 1"),
        ("class A:\n    'Be.'\n    b = 1\n    'Have.'", "class A:\n    b = 1"),
        ("a = 'x' 'y'", "a = 'xy'"),
        ("f(a,\n  b)", "f(a, b)"),
    ],
)
def test_changes_of_layout_keep_the_digest(one: str, other: str) -> None:
    """Comments, docstrings, layout and quotes do nothing."""
    assert digest(one) == digest(other)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("a = 1", "a = 2"),
        ("a = 1", "a = 1.0"),
        ("a = 1", "a = True"),
        ("a = '1'", "a = b'1'"),
        ("a = ['', 'b']", "a = ['b']"),
        ("a = None", "a = ()"),
        ("return_ = 'text'", "return_ = 'texts'"),
        ("f(a, b)", "f(b, a)"),
        ("f(a)\ng(b)", "g(b)\nf(a)"),
        ("f'{a}'", "f'{a!r}'"),
        ("f'{a} '", "f'{a}'"),
        ("{**a}", "{'': a}"),
        ("def f(): return", "def f(): return None"),
        ("a = 'é'", "a = 'e'"),
    ],
)
def test_changes_of_behaviour_change_the_digest(one: str, other: str) -> None:
    """Any change of behaviour changes the digest."""
    assert digest(one) != digest(other)


def test_names_can_be_left_out() -> None:
    """An assignment to such a name at the top changes nothing; one below it does."""
    assert digest("A = 1\nB = 2", "A") == digest("A = 3\nB = 2", "A") != digest("A = 1\nB = 3", "A")
    assert digest("def f():\n    A = 1", "A") != digest("def f():\n    A = 2", "A")


def test_neighbours() -> None:
    """The files of one's own package, by either way of importing them."""
    source = "import json\nfrom os import path\nfrom . import b, c\nfrom .d import e, f\nfrom .d import g"
    assert syntax.neighbours(ast.parse(source)) == ("b.py", "c.py", "d.py")
