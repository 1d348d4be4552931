"""Read TOML and JSON as typed values, and make JSON Schemas from the same types.

msgspec does the reading. Our part is the one sentence that a user gets instead of a traceback: file, key path, what is
wrong, and the nearest valid name.

A type that msgspec does not know may read itself (`SelfReading`): a string with rules of its own, or a value that can
be written in several ways.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import date, time
from difflib import get_close_matches
from functools import cache
from typing import Any, ClassVar, Protocol, TypeVar

import msgspec
from msgspec import inspect as types
from tomli_w import dumps

from harness.model import decoding
from harness.model.errors import BadInput

T = TypeVar("T")

DRAFT = "https://json-schema.org/draft/2020-12/schema"

SURROGATE = re.compile(r"(?i)\\ud[89a-f]")
_ANY_KEY = "[...]"  # how msgspec writes a key of a mapping
# msgspec reports an error as one text, so these patterns take it apart.
_PLACES = re.compile(r" - at (?:`key` in )?`\$([^`]*)`")
_SEGMENT = re.compile(r"\.([^.\[]+)|\[(\d+)\]|(\[\.\.\.\])")
_UNKNOWN_KEY = re.compile(r"Object contains unknown field `(.*)`", re.DOTALL)
_MISSING_KEY = re.compile(r"Object missing required field `(.*)`")
_WRONG_TYPE = re.compile(r"Expected `([^`]*)`, got `([^`]*)`")
_OUT_OF_RANGE = re.compile(r"Expected `(\w+)` (.*)")
_NOT_ONE_OF = re.compile(r"Invalid enum value '?(.*?)'?", re.DOTALL)
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_NOT_EMPTY = {"of length >= 1": "that is not empty"}
_WORDS = {
    "str": "a string",
    "int": "an integer",
    "float": "a number",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
    "null": "nothing",
}


class Convert(Protocol):
    """A function that reads a plain value as a type. It raises a ValueError that says what is wrong."""

    def __call__(self, plain: Any, kind: type[T]) -> T:
        """Return `plain` as a `kind`."""


class SelfReading(Protocol):
    """A type that reads itself; `reads` are the types it is written as, for suggestions and for the JSON Schema."""

    reads: ClassVar[tuple[Any, ...]]

    @classmethod
    def parse(cls, plain: Any, convert: Convert) -> Any:
        """Return the value that `plain` stands for, or raise a ValueError saying what is wrong with it."""


def load_toml(text: str, kind: type[T], file: str) -> T:
    """Read TOML text as `kind`; `file` is the name that messages give it. Dates are read as ISO 8601 strings."""
    with readable(file):
        plain = toml_table(text, file)
        # Read again for a message only: as a number 3.10 is 3.1, and the message quotes what stands in the file.
        return _checked(_without_dates(plain), kind, file, literals=lambda: tomllib.loads(text, parse_float=str))


def toml_table(text: str, file: str) -> dict[str, Any]:
    """Read TOML text as it is. Raises BadInput."""
    with readable(file):
        try:
            return tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            what, _, where = str(error).removesuffix(")").rpartition(" (at ")
            message = f"{file}: {where}: {_lower(what)}"
            raise BadInput(message) from None


def load_json(text: str | bytes, kind: type[T], file: str) -> T:
    """Read JSON text as `kind`; `file` is the name that messages give it. NaN and infinities are refused."""
    with readable(file):
        try:
            plain = json.loads(text, parse_constant=_refuse_constant)
        except json.JSONDecodeError as error:
            message = f"{file}: line {error.lineno}, column {error.colno}: {_lower(error.msg)}"
            raise BadInput(message) from None
        _check_characters(text, plain)
        return _checked(plain, kind, file, literals=lambda: plain)


@contextmanager
def readable(file: str) -> Iterator[None]:
    """Turn a format reader's errors into BadInput that names the file: nesting too deep, numbers too long, others."""
    try:
        yield
    except RecursionError:
        message = f"{file}: is nested too deep"
    except ValueError as error:
        # Python's own message advises a call of a function, which is no help to a user.
        what = "has an integer of too many digits" if "set_int_max_str_digits" in str(error) else str(error)
        message = f"{file}: {what}"
    else:
        return
    raise BadInput(message) from None


def json_schema(kind: type) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of documents that read as `kind`."""
    components: dict[str, Any] = {}

    def schema_of(own: Any) -> dict[str, Any]:
        if not hasattr(own, "parse"):
            raise NotImplementedError(own)
        schemas, parts = msgspec.json.schema_components(own.reads, schema_hook=schema_of)
        components.update(parts)
        body: dict[str, Any] = {"anyOf": list(schemas)} if len(schemas) > 1 else dict(schemas[0])
        return {"description": str(own.__doc__).partition("\n\n")[0]} | body

    schema = msgspec.json.schema(kind, schema_hook=schema_of)
    defined = {**components, **schema.pop("$defs", {})}
    return {"$schema": DRAFT, **schema} | ({"$defs": dict(sorted(defined.items()))} if defined else {})


def suggestion(wrong: str, valid: Iterable[str]) -> str:
    """Return the end of a message on an unknown name: `; did you mean "checks"?`, else the valid names, if any."""

    names = sorted({str(name) for name in valid})
    lowered = {name.lower(): name for name in names}
    near = get_close_matches(wrong.lower(), lowered, n=1)
    if near:
        return f'; did you mean "{lowered[near[0]]}"?'
    return "; valid: " + ", ".join(f'"{name}"' for name in names) if names else ""


def key_path(*segments: str | int) -> str:
    """Return the path of a key: `axes.python[1]` for `("axes", "python", 1)`, with quotes where TOML needs them."""
    path = ""
    for segment in segments:
        if isinstance(segment, int):
            path += f"[{segment}]"
        else:
            path += ("." if path else "") + (segment if _BARE_KEY.fullmatch(segment) else json.dumps(segment))
    return path


def toml_value(value: str | bool | int | Sequence[Any]) -> str:
    """Write a value as TOML has it in one line: a text, a number, a boolean, or a list of these."""

    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    return dumps({"x": value}).removeprefix("x = ").rstrip("\n")


@contextmanager
def locate_errors(file: str, *segments: str | int) -> Iterator[None]:
    """Turn a ValueError into BadInput that names the file and the key path."""
    try:
        yield
    except ValueError as error:
        message = f"{file}: {key_path(*segments)}: {error}" if segments else f"{file}: {error}"
        raise BadInput(message) from None


# --- reading ---------------------------------------------------------------------------------------------------


def _read_self(kind: Any, plain: Any) -> Any:
    """Read a type that msgspec does not know; this is msgspec's hook."""
    if not hasattr(kind, "parse"):
        raise NotImplementedError(kind)
    return kind.parse(plain, _convert)


def _convert(plain: Any, kind: type[T]) -> T:
    try:
        return decoding.convert(plain, kind, read_other=_read_self)
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from None  # so that the path of the value around it is added


def _checked(plain: Any, kind: type[T], file: str, *, literals: Callable[[], Any]) -> T:
    try:
        return _convert(plain, kind)
    except ValueError as error:
        message = f"{file}: {_sentence(str(error), plain, kind, literals)}"
        raise BadInput(message) from None


def _without_dates(plain: Any) -> Any:
    if isinstance(plain, dict):
        return {key: _without_dates(value) for key, value in plain.items()}
    if isinstance(plain, list):
        return [_without_dates(value) for value in plain]
    return plain.isoformat() if isinstance(plain, date | time) else plain


def _check_characters(text: str | bytes, plain: Any) -> None:
    """Refuse half of a surrogate pair, which cannot be printed or written in any text."""
    escaped = SURROGATE.search(text if isinstance(text, str) else text.decode(errors="replace"))
    try:
        if escaped:
            json.dumps(plain, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        message = "has half of a surrogate pair where a character should be"
        raise ValueError(message) from None


def _refuse_constant(name: str) -> Any:
    message = f"{name} is not a JSON number"
    raise ValueError(message)


def _lower(text: str) -> str:
    return text[:1].lower() + text[1:]


# --- the sentence ----------------------------------------------------------------------------------------------


def _sentence(error: str, plain: Any, kind: Any, literals: Callable[[], Any]) -> str:
    """Turn one error text of msgspec into a sentence: `cases[0].chekcs: unknown key; did you mean "checks"?`."""
    what = _PLACES.sub("", error)
    segments = _segments(error, plain, kind)
    if unknown := _UNKNOWN_KEY.fullmatch(what):
        keys = [[field.encode_name for field in _fields(node)] for node in _nodes(kind, segments)]
        valid = (name for names in keys if unknown[1] not in names for name in names)
        return f"{key_path(*segments, unknown[1])}: unknown key{suggestion(unknown[1], valid)}"
    if missing := _MISSING_KEY.fullmatch(what):
        what = f'the key "{missing[1]}" is missing'
    elif wrong := _WRONG_TYPE.fullmatch(what):
        what = f"expected {_expected(wrong[1])}, got {_got(wrong[2])}{_quote_it(wrong, segments, literals)}"
    elif outside := _OUT_OF_RANGE.fullmatch(what):
        what = f"expected {_WORDS.get(outside[1], outside[1])} {_NOT_EMPTY.get(outside[2], outside[2])}"
    elif refused := _NOT_ONE_OF.fullmatch(what):
        values = (name for node in _nodes(kind, segments) for name in _names(node))
        what = f'unknown value "{refused[1]}"{suggestion(refused[1], values)}'
    return f"{key_path(*segments)}: {what}" if segments else what


def _segments(error: str, plain: Any, kind: Any) -> list[str | int]:
    """Return the path of an error.

    msgspec does not say which key of a mapping it met: it is the key that fails in the same way by itself.
    """
    path: list[str | int] = []
    # A value that reads itself puts its inner path first; msgspec adds the path around it behind.
    for name, index, any_key in _SEGMENT.findall("".join(reversed(_PLACES.findall(error)))):
        if any_key:
            keys = _at(plain, path)
            path.append(next((key for key in keys if _fails_alike(error, plain, kind, [*path, key])), _ANY_KEY))
        else:
            path.append(name or int(index))
    return path


def _fails_alike(error: str, plain: Any, kind: Any, segments: Sequence[str | int]) -> bool:
    try:
        _convert(_with_only(plain, segments), kind)
    except ValueError as again:
        return str(again) == error
    return False


def _with_only(plain: Any, segments: Sequence[str | int]) -> Any:
    """Return a copy in which the mapping that holds the last segment has no other key."""
    first, *rest = segments
    if not rest:
        return {first: plain[first]}
    changed = _with_only(plain[first], rest)
    if isinstance(plain, list):
        return [changed if index == first else value for index, value in enumerate(plain)]
    return {**plain, first: changed}


def _at(plain: Any, segments: Sequence[str | int]) -> Any:
    for segment in segments:
        plain = plain[segment]
    return plain


def _expected(alternatives: str) -> str:
    return " or ".join(_WORDS.get(name, name) for name in alternatives.split(" | ") if name != "null")


def _got(name: str) -> str:
    return "a boolean" if name == "bool" else _WORDS.get(name, name)


def _quote_it(wrong: re.Match[str], segments: Sequence[str | int], literals: Callable[[], Any]) -> str:
    """Say how to write a version that lacks quotes, which makes it a number (3.10 is then 3.1); else nothing."""
    if wrong[2] not in {"int", "float"} or "str" not in wrong[1].split(" | ") or _ANY_KEY in segments:
        return ""
    written = _at(literals(), segments)
    return f' (write "{written}", not {written})'


# --- types along a path ----------------------------------------------------------------------------------------


@cache
def _described(kind: Any) -> types.Type:
    return types.type_info(kind)


def _alternatives(node: types.Type) -> list[types.Type]:
    """Return the types that a value of this type may be written as."""
    if isinstance(node, types.Metadata):
        return _alternatives(node.type)
    inner: Iterable[types.Type] = ()
    if isinstance(node, types.UnionType):
        inner = node.types
    elif isinstance(node, types.CustomType) and hasattr(node.cls, "reads"):
        inner = map(_described, node.cls.reads)
    else:
        return [node]
    return [found for each in inner for found in _alternatives(each)]


def _nodes(kind: Any, segments: Sequence[str | int]) -> list[types.Type]:
    """Return every type that may stand at the end of a path."""
    nodes = _alternatives(_described(kind))
    for segment in segments:
        nodes = [found for node in nodes for inner in _inside(node, segment) for found in _alternatives(inner)]
    return nodes


def _inside(node: types.Type, segment: str | int) -> list[types.Type]:
    if isinstance(node, types.ListType | types.VarTupleType) and isinstance(segment, int):
        return [node.item_type]
    if isinstance(node, types.DictType):
        return [node.value_type]
    return [field.type for field in _fields(node) if field.encode_name == segment]


def _fields(node: types.Type) -> tuple[types.Field, ...]:
    return node.fields if isinstance(node, types.StructType | types.DataclassType) else ()


def _names(node: types.Type) -> list[str]:
    """Return the values of an enumeration, also if it is the key of a mapping."""
    if isinstance(node, types.EnumType):
        return [str(member.value) for member in node.cls]
    if isinstance(node, types.DictType):
        return [name for inner in _alternatives(node.key_type) for name in _names(inner)]
    return [str(value) for value in node.values] if isinstance(node, types.LiteralType) else []
