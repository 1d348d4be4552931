"""The codes that in-cell files report: each has a template on the host, with the fields that it is given."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from harness.model import words
from harness.model.vocabulary import INCELL

PLACES = {"violate": 0, "skip": 0, "contradiction": 0, "observation": 0, "remark": 1, "finding": 1, "report": 1}
"""Functions that are given a code, and the number of the argument that it is."""

APART = {"level", "at"}
"""Keywords besides the fields of a sentence."""

HANDING_ON = {
    "cell_errors.py": {"violate", "skip"},
    "cell_specification.py": {"contradiction"},
    "cell_run.py": {"finding"},
    "cell_episode.py": {"reporter"},
    "cell_values.py": {"observation"},
    "api_dm_control.py": {"_examine"},
    "check_render_rgb_array.py": {"_report"},
}
"""Functions that hand on a code which they were given."""


class Site(NamedTuple):
    """A call with a code: where it stands, the code, and the fields that it is given."""

    file: str
    line: int
    code: str
    fields: frozenset[str]


class Open(NamedTuple):
    """A call whose code is not written there: the file and the function that it stands in."""

    file: str
    function: str


def calls(source: str, file: str) -> Iterator[Site | Open]:
    """Yield the calls of a file by which something is reported."""
    for function in [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]:
        for node in ast.walk(function):
            name = _name(node) if isinstance(node, ast.Call) else None
            if isinstance(node, ast.Call) and name in PLACES:
                yield _site(node, file, function.name, PLACES[name])


def _site(node: ast.Call, file: str, function: str, place: int) -> Site | Open:
    code = node.args[place] if len(node.args) > place else None
    if not isinstance(code, ast.Constant) or not isinstance(code.value, str):
        return Open(file, function)
    last = node.args[place + 1] if len(node.args) > place + 1 else None
    given = [key.value for key in last.keys if isinstance(key, ast.Constant)] if isinstance(last, ast.Dict) else []
    names = frozenset([*(keyword.arg or "**" for keyword in node.keywords), *map(str, given)])
    return Site(file, node.lineno, code.value, names - APART)


def _name(node: ast.Call) -> str | None:
    if isinstance(node.func, ast.Attribute):  # an examiner has methods of names like these
        return node.func.attr if node.func.attr in {"finding", "report"} else None
    return node.func.id if isinstance(node.func, ast.Name) else None


FOUND = {one for path in sorted(INCELL.glob("*.py")) for one in calls(path.read_text(), path.name)}
SITES = sorted(one for one in FOUND if isinstance(one, Site))


@pytest.mark.parametrize("site", SITES, ids=lambda site: f"{site.file}:{site.line}")
def test_the_template_has_the_fields_that_it_is_given(site: Site) -> None:
    """Neither more nor less, so that no sentence lacks anything and nothing is reported that no sentence has."""
    assert site.code in words.templates()
    assert site.fields == words.fields(site.code)


def test_every_template_is_used() -> None:
    """Nothing stands there for a code that no check reports."""
    assert set(words.templates()) - {site.code for site in SITES} == set()


def test_codes_are_written_where_they_are_reported() -> None:
    """Codes are written at the call, except in the few functions that pass them on."""
    found: dict[str, set[str]] = {}
    for one in FOUND:
        if isinstance(one, Open):
            found.setdefault(one.file, set()).add(one.function)
    assert found == HANDING_ON


def test_data_are_no_sentences() -> None:
    """Nothing is formatted at the call but short names of things: no text of more than a few words."""
    long = []
    for path in sorted(INCELL.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and _name(node) in PLACES:
                texts = [one.value for one in ast.walk(node) if isinstance(one, ast.Constant)]
                long += [(path.name, text) for text in texts if isinstance(text, str) and len(text.split()) > 5]
    assert long == []


@pytest.mark.parametrize(
    ("source", "wrong"),
    [
        ('violate("render.blank", got=1)', False),
        ('violate("render.blank")', True),
        ('violate("render.blank", got=1, more=2)', True),
        ('violate("render.blank", **data)', True),
        ('probe.finding("render.blank", "render.blank_at_first", got=1, level="note", at=3)', False),
        ('self.report("type", "value.kind", got=1)', True),
        ('observation("raised", {"raised": 1})', False),
    ],
)
def test_the_check_can_fail(source: str, wrong: bool) -> None:
    """A call with other fields than the template's is seen."""
    (site,) = calls(f"def f():\n    {source}", "f.py")
    assert isinstance(site, Site)
    assert (site.fields != words.fields(site.code)) is wrong


def test_phrases_are_those_of_fields() -> None:
    """Each stands for a field of some template, and is tried before any whose fields it has all."""
    used = {
        f"{name}:{form}" if form else name
        for template in words.templates().values()
        for _, name, form in words.split(template)
        if name
    }
    assert set(words.phrases()) <= used
    for name, texts in words.phrases().items():
        fields = [{field for _, field, _ in words.split(text) if field} for text in texts]
        assert not [(name, one) for n, one in enumerate(fields) if any(earlier <= one for earlier in fields[:n])]


def test_words_ship_with_the_package() -> None:
    """The file lies beside the module that reads it."""
    assert (Path(words.__file__).parent / "words.toml").is_file()
