"""Put observations of the cell into words: `words.toml` has a template per code, and patterns find its sentences.

The codes there are all that a cell can use. A template holds text and fields, `{got}` or `{gap:.3g}`: `got`, `promised`
and the keys of the data. Of a field whose value is a table, one of its phrases is written: the first for which all
fields are there.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from pkgutil import get_data
from string import Formatter
from types import MappingProxyType
from typing import Any

from harness.model import Observation

VIOLATION = "ContractViolation"
"""The type of the exception by which a check says that something contradicts what it promises."""

RAISED = "raised"
"""The field of an exception: a text, or an observation of ours where a check of ours raised it."""

LONGEST = 2000
"""Characters of a sentence."""

DEEPEST = 8
NOTHING: Mapping[str, Any] = MappingProxyType({})
CHECK_LINE = re.compile(rf"(?:{VIOLATION}|[a-z]+(?:\.[a-z_0-9]+)+): (.*[^…])")
"""A decisive line by which a check of ours says why, and a finding that a case requires not to be there."""

FEWEST = 8
"""Characters of a template by which its sentence can be told."""

SPECIAL = re.compile(r"[\\.^$*+?{}\[\]|()]")
ANY = ".*?"


@cache
def templates() -> Mapping[str, str]:
    """Return the template of each code."""
    return MappingProxyType(_book()["codes"])


@cache
def phrases() -> Mapping[str, tuple[str, ...]]:
    """Return the phrases of each field whose values are tables, by its name and format: `where`, `where:that`."""
    return MappingProxyType({name: tuple(texts) for name, texts in _book()["phrases"].items()})


@cache
def _book() -> Mapping[str, Any]:
    content = get_data(__name__, "words.toml")
    return tomllib.loads((content or b"").decode())


@cache
def fields(code: str) -> frozenset[str]:
    """Return the names of the fields of a code; none of a code that is not known."""
    return frozenset(name for _, name, _ in split(templates().get(code, "")) if name)


@cache
def split(template: str) -> tuple[tuple[str, str, str], ...]:
    """Return a template as (text, name of the field after it, its format), both empty after the last text."""
    return tuple((text, name or "", form or "") for text, name, form, _ in Formatter().parse(template))


# --- sentences -------------------------------------------------------------------------------------------------


def sentence(observed: Observation) -> str:
    """Return an observation in words. One of an unknown code, or that lacks data, is written as it came."""
    return truncate(_sentence(observed.code, values(observed), 0))


def in_words(plain: object) -> str | None:
    """Return the sentence of an observation as a cell writes it; None of anything else."""
    observation = parse(plain)
    return truncate(_sentence(*observation, 0)) if observation else None


def values(observed: Observation) -> dict[str, Any]:
    """Return what the fields of a template are filled with."""
    return _values(observed.data, observed.got, observed.promised)


def _values(data: Mapping[str, Any], got: Any, promised: Any) -> dict[str, Any]:
    named = {"got": got, "promised": promised}
    return {**data, **{name: value for name, value in named.items() if value is not None}}


def _sentence(code: str, data: Mapping[str, Any], depth: int) -> str:
    template = templates().get(code)
    text = _filled(template, data, depth) if template is not None else None
    return text if text is not None else f"{code}: {json.dumps(data, default=str)}"


def _filled(template: str, data: Mapping[str, Any], depth: int) -> str | None:
    """Return a template with its fields filled; None where one is missing."""
    parts = split(template)
    if depth > DEEPEST or not {name for _, name, _ in parts if name} <= data.keys():
        return None
    return "".join(text + (_shown(name, form, data[name], depth) if name else "") for text, name, form in parts)


def _shown(name: str, form: str, value: Any, depth: int) -> str:
    """Return the value of a field as it is written."""
    if isinstance(value, Mapping):
        chosen = (_filled(phrase, value, depth + 1) for phrase in phrases().get(_key(name, form), ()))
        return next((text for text in chosen if text is not None), None) or _nested(name, value, depth)
    try:
        return format(value, form) if form and isinstance(value, int | float) else str(value)
    except (ValueError, OverflowError):  # a number of more digits than Python writes
        return "…"


def _key(name: str, form: str) -> str:
    return f"{name}:{form}" if form else name


def _nested(name: str, plain: Mapping[str, Any], depth: int) -> str:
    """Return an observation within another, as an exception where the field is one."""
    inner = parse(plain)
    if inner is None:
        return json.dumps(plain, default=str)
    code, data = inner
    return (f"{VIOLATION}: " if name == RAISED else "") + _sentence(code, data, depth + 1)


def parse(plain: object) -> tuple[str, dict[str, Any]] | None:
    """Return code and values of an observation as a cell writes it; None of anything else."""
    if not isinstance(plain, Mapping) or not isinstance(plain.get("code"), str):
        return None
    data = plain.get("data")
    named = {str(key): value for key, value in data.items()} if isinstance(data, Mapping) else {}
    return plain["code"], _values(named, plain.get("got"), plain.get("promised"))


def truncate(text: str) -> str:
    """Return a text of at most `LONGEST` characters: its beginning and its end, where the news is."""
    if len(text) <= LONGEST:
        return text
    half = (LONGEST - 40) // 2
    return f"{text[:half]}\n[... {len(text) - 2 * half} characters ...]\n{text[-half:]}"


# --- looking for observations ----------------------------------------------------------------------------------


def contains(code: str, wanted: Mapping[str, Any], observed: Observation) -> bool:
    """Tell whether an observation, or one within it, has this code and data that meet these conditions."""
    return any(name == code and _fits(wanted, said) for name, said in _all(observed))


def _all(observed: Observation) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield code and values of an observation and of those within it."""
    observation: tuple[str, Mapping[str, Any]] | None = (observed.code, values(observed))
    for _ in range(DEEPEST):
        if observation is None:
            break
        yield observation
        observation = next((inner for value in observation[1].values() if (inner := parse(value))), None)


def _fits(wanted: Mapping[str, Any], data: Mapping[str, Any]) -> bool:
    return all(name in data and _meets(condition, data[name]) for name, condition in wanted.items())


def _meets(condition: Any, value: Any) -> bool:
    """Tell whether a value meets a condition: an expression for its whole text, a table of conditions, or itself."""
    if isinstance(condition, Mapping):
        return isinstance(value, Mapping) and _fits(condition, value)
    if isinstance(condition, str):
        return not isinstance(value, Mapping) and re.fullmatch(condition, str(value)) is not None
    # `True == 1` in Python, and a condition on a number does not mean a boolean.
    return bool(type(value) is type(condition) and value == condition)


@cache
def wording(code: str) -> str:
    """Return a regular expression that finds the sentences of a code in texts of which nothing else is known."""
    return sentence_pattern(code, NOTHING)


def sentence_pattern(code: str, wanted: Mapping[str, Any]) -> str:
    """Return a regular expression for the sentences of a code whose data meet conditions. Raises KeyError."""
    expression = _expression(templates()[code], wanted)
    return expression.removeprefix(ANY).removesuffix(ANY)


def _expression(template: str, wanted: Mapping[str, Any]) -> str:
    parts = split(template)
    return "".join(escape(text) + (_field(name, form, wanted.get(name)) if name else "") for text, name, form in parts)


def _field(name: str, form: str, condition: Any) -> str:
    if condition is None:
        return ANY
    if isinstance(condition, Mapping):
        texts = phrases().get(_key(name, form), ())
        fitting = [text for text in texts if condition.keys() <= {field for _, field, _ in split(text)}]
        return f"(?:{'|'.join(_expression(text, condition) for text in fitting)})"
    return f"(?:{condition})" if isinstance(condition, str) else escape(_shown(name, form, condition, 0))


def recognise(line: str) -> tuple[str, dict[str, str]] | None:
    """Return the code of the sentence that a decisive line is, and conditions for its data; None of a library's line.

    The template that has most of the text is meant; what is cut is no whole sentence.
    """
    line_match = CHECK_LINE.fullmatch(line)
    matches = (
        (code, re.fullmatch(_groups(template), line_match[1])) for code, template in templates().items() if line_match
    )
    fitting = {code: match for code, match in matches if match and _literals(code) >= FEWEST}
    code = max(fitting, key=_literals, default=None)
    return (code, {name: escape(text) for name, text in fitting[code].groupdict().items()}) if code else None


def _groups(template: str) -> str:
    """Return an expression for a whole sentence, each field that is no table a group."""
    parts = ((escape(text), name, _key(name, form)) for text, name, form in split(template))
    groups = ((text, ANY if key in phrases() else f"(?P<{name}>{ANY})" if name else "") for text, name, key in parts)
    return "".join(text + group for text, group in groups)


def _literals(code: str) -> int:
    return sum(len(text) for text, _, _ in split(templates()[code]))


def refusal(code: str | None, wanted: Mapping[str, Any]) -> str | None:
    """Return why nothing can be looked for by a code and such conditions, in words; None where it can."""
    if code is None:
        return '"data" are of a "code", which is missing' if wanted else None
    if code not in templates():
        near = get_close_matches(code, templates(), n=1)
        return f'"{code}" is no code of an observation' + (f"; did you mean {near[0]}?" if near else "")
    foreign = sorted(wanted.keys() - fields(code))
    if foreign:
        return f'"{code}" has no "{foreign[0]}"; it has {", ".join(sorted(fields(code))) or "no data"}'
    try:
        vague = re.search(sentence_pattern(code, wanted), "")
    except re.error as error:
        return f'the "data" of "{code}" are no regular expressions: {error}'
    return f'"{code}" alone fits any text of a library; write "data", or a pattern' if vague else None


def escape(text: str) -> str:
    """Return a regular expression of a text that means the same in Python and in a browser."""
    return SPECIAL.sub(r"\\\g<0>", text)
