"""Typed reading: what is read, the sentence for each mistake, and the JSON Schema of the same types."""

from enum import StrEnum
from typing import Annotated, Any, ClassVar, Literal

import jsonschema
import msgspec
import pytest
from msgspec import Meta

from harness.matrix.matrix_types import MatrixTable
from harness.model import schema
from harness.model.errors import BadInput


class Colour(StrEnum):
    """A colour."""

    RED = "red"
    GREEN = "green"


class Inner(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An inner table."""

    checks: tuple[Literal["single", "vector"], ...] = ()
    count: Annotated[int, Meta(ge=1)] = 1
    ratio: float = 0.5


class Either:
    """A string or a table."""

    reads: ClassVar[tuple[Any, ...]] = (str, Inner)

    def __init__(self, value: object) -> None:
        self.value = value

    @classmethod
    def parse(cls, plain: Any, convert: schema.Convert) -> "Either":
        if plain == "bad":
            message = '"bad" is bad'
            raise ValueError(message)
        return cls(convert(plain, Inner if isinstance(plain, dict) else str))


class Outer(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A whole document."""

    name: Annotated[str, Meta(description="what it is called")]
    inner: tuple[Inner, ...] = ()
    named: dict[str, tuple[str, ...]] = {}
    either: dict[str, Either] = {}
    colour: Colour = Colour.RED
    limits: dict[Literal["single", "vector"], float] = {}
    on: bool = False


def test_reads_toml_into_frozen_types() -> None:
    """A right document becomes the value it describes, dates as ISO strings."""
    read = schema.load_toml('name = 2026-11-20\ncolour = "green"\n[[inner]]\ncount = 3\n', Outer, "x.toml")

    assert read == Outer(name="2026-11-20", colour=Colour.GREEN, inner=(Inner(count=3),))


def test_reads_json_into_frozen_types() -> None:
    """JSON reads as TOML does."""
    assert schema.load_json(b'{"name": "n", "inner": [{"ratio": 1}]}', Outer, "x.json") == Outer(
        name="n", inner=(Inner(ratio=1.0),)
    )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        pytest.param(
            'name = "n"\n[[inner]]\nchekcs = []',
            'x.toml: inner[0].chekcs: unknown key; did you mean "checks"?',
            id="unknown-key",
        ),
        pytest.param(
            'name = "n"\nInner = []', 'x.toml: Inner: unknown key; did you mean "inner"?', id="unknown-key-by-case"
        ),
        pytest.param(
            'name = "n"\n[[inner]]\nzzz = 1',
            'x.toml: inner[0].zzz: unknown key; valid: "checks", "count", "ratio"',
            id="unknown-key-like-no-other",
        ),
        pytest.param("on = true", 'x.toml: the key "name" is missing', id="missing-key"),
        pytest.param("name = true", "x.toml: name: expected a string, got a boolean", id="wrong-type"),
        pytest.param(
            'name = "n"\nnamed = { "a.b" = ["1"], python = ["3.9", 3.10] }',
            'x.toml: named.python[1]: expected a string, got a number (write "3.10", not 3.10)',
            id="unquoted-version",
        ),
        pytest.param(
            "name = 3", 'x.toml: name: expected a string, got an integer (write "3", not 3)', id="unquoted-integer"
        ),
        pytest.param(
            'name = "n"\nnamed = { "a.b" = "c" }',
            'x.toml: named."a.b": expected a list, got a string',
            id="quoted-key",
        ),
        pytest.param(
            'name = "n"\n[[inner]]\ncount = 0', "x.toml: inner[0].count: expected an integer >= 1", id="out-of-range"
        ),
        pytest.param(
            'name = "n"\ncolour = "gren"',
            'x.toml: colour: unknown value "gren"; did you mean "green"?',
            id="enumeration",
        ),
        pytest.param(
            'name = "n"\n[[inner]]\nchecks = ["single", "x"]',
            'x.toml: inner[0].checks[1]: unknown value "x"; valid: "single", "vector"',
            id="literal",
        ),
        pytest.param(
            'name = "n"\nlimits = { singel = 1 }',
            'x.toml: limits: unknown value "singel"; did you mean "single"?',
            id="literal-key",
        ),
        pytest.param(
            'name = "n"\neither = { good = "x", worse = "bad" }',
            'x.toml: either.worse: "bad" is bad',
            id="self-reading",
        ),
        pytest.param(
            'name = "n"\neither = { good = "x", worse = { cuont = 1 } }',
            'x.toml: either.worse.cuont: unknown key; did you mean "count"?',
            id="inside-self-reading",
        ),
        pytest.param(
            'name = "n"\ninner = [}',
            "x.toml: line 2, column 10: invalid value",
            id="syntax",
        ),
        pytest.param('name = "n', "x.toml: end of document: unterminated string", id="syntax-at-the-end"),
    ],
)
def test_toml_mistakes_are_one_sentence(text: str, sentence: str) -> None:
    """A mistake is told with file, key path, what is wrong and the nearest valid name."""
    with pytest.raises(BadInput) as error:
        schema.load_toml(text, Outer, "x.toml")

    assert str(error.value) == sentence


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        pytest.param('{"name":\n "n" "on"}', "x.json: line 2, column 6: expecting ',' delimiter", id="syntax"),
        pytest.param('{"name": NaN}', "x.json: NaN is not a JSON number", id="nan"),
        pytest.param("[]", "x.json: expected a table, got a list", id="no-object"),
        pytest.param(
            '{"name": "n", "inner": [{"ratio": "x"}]}',
            "x.json: inner[0].ratio: expected a number, got a string",
            id="type",
        ),
    ],
)
def test_json_mistakes_are_one_sentence(text: str, sentence: str) -> None:
    """JSON is refused in the same words."""
    with pytest.raises(BadInput) as error:
        schema.load_json(text, Outer, "x.json")

    assert str(error.value) == sentence


def test_text_that_is_no_utf8_is_refused() -> None:
    """Bytes that are no text are bad input, not a traceback."""
    with pytest.raises(BadInput, match=r"^x\.json: 'utf-8' codec can't decode byte 0xff in position 10"):
        schema.load_json(b'{"name": "\xff"}', Outer, "x.json")


def test_json_schema_describes_the_types() -> None:
    """The schema has draft, titles, descriptions, and the types that self-reading ones are written as."""
    made = schema.json_schema(Outer)

    assert made["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert made["$defs"]["Inner"]["description"] == "An inner table."
    properties = made["$defs"]["Outer"]["properties"]
    assert properties["name"] == {"type": "string", "description": "what it is called"}
    assert properties["either"]["additionalProperties"] == {
        "description": "A string or a table.",
        "anyOf": [{"type": "string"}, {"$ref": "#/$defs/Inner"}],
    }


@pytest.mark.parametrize("kind", [Outer, MatrixTable])
def test_json_schema_is_valid(kind: type) -> None:
    """Each published schema is valid by its JSON Schema draft."""
    jsonschema.Draft202012Validator.check_schema(schema.json_schema(kind))


@pytest.mark.parametrize(
    ("document", "right"),
    [
        ({"name": "n", "either": {"a": "x", "b": {"count": 2}}}, True),
        ({"name": "n", "either": {"a": 1}}, False),
        ({"name": "n", "inner": [{"chekcs": []}]}, False),
        ({}, False),
    ],
)
def test_json_schema_agrees_with_reading(document: dict[str, Any], right: bool) -> None:
    """A document is right by the schema where it can be read."""
    valid = jsonschema.Draft202012Validator(schema.json_schema(Outer)).is_valid(document)
    try:
        schema.load_json(msgspec.json.encode(document), Outer, "x.json")
        read = True
    except BadInput:
        read = False

    assert (valid, read) == (right, right)


@pytest.mark.parametrize(
    ("wrong", "tail"),
    [
        ("gymnasim", '; did you mean "gymnasium"?'),
        ("GYM", '; did you mean "gym"?'),
        ("q", '; valid: "gym", "gymnasium"'),
    ],
)
def test_suggestions(wrong: str, tail: str) -> None:
    """The nearest name is offered, or all of them."""
    assert schema.suggestion(wrong, ["gymnasium", "gym"]) == tail


def test_nothing_to_suggest() -> None:
    """Without valid names there is no suggestion."""
    assert schema.suggestion("x", []) == ""
