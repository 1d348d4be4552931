"""Evaluate GitHub's expressions, `${{ ... }}`, as far as the values of a matrix decide them; the rest is `UNKNOWN`."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

EMBEDDED = re.compile(r"\$\{\{(.*?)\}\}", re.DOTALL)

_TOKEN = re.compile(
    r"""\s*(?:(?P<string>'(?:[^']|'')*')|(?P<number>-?\d+(?:\.\d+)?\b(?![.\w]))
    |(?P<name>[A-Za-z_][\w-]*)|(?P<sign>==|!=|<=|>=|&&|\|\||[!<>()\[\],.*]))""",
    re.VERBOSE,
)
_ORDER: Mapping[str, Callable[[Any, Any], bool]] = {
    "<": lambda a, b: a < b,
    ">": lambda a, b: a > b,
    "<=": lambda a, b: a <= b,
    ">=": lambda a, b: a >= b,
}
_CONSTANTS = {"true": True, "false": False, "null": None}


class _Unknown:
    """A value that only GitHub knows: an event, a secret, an output of a step."""

    def __repr__(self) -> str:
        return "UNKNOWN"


UNKNOWN: Final = _Unknown()

Contexts = Mapping[str, Any]
"""Name to value, such as `{"matrix": {...}, "env": {...}}`; a context that is not given is unknown."""


def evaluate(expression: str, contexts: Contexts) -> Any:
    """Return the value of an expression without its braces; UNKNOWN also if it cannot be read."""
    try:
        reader = _Reader(list(_tokens(expression)), contexts)
        value = reader.either()
        return value if reader.at == len(reader.tokens) else UNKNOWN
    except (_Unreadable, IndexError):
        return UNKNOWN


def holds(condition: object, contexts: Contexts) -> bool | None:
    """Return whether a step with this `if` is run while nothing has failed; None where only GitHub knows."""
    if not isinstance(condition, str):
        return None if condition is UNKNOWN else bool(condition)
    whole = EMBEDDED.fullmatch(condition.strip())
    if whole is None and EMBEDDED.search(condition):
        return None
    value = evaluate(whole[1] if whole else condition, contexts)
    return None if value is UNKNOWN else truth(value)


def substitute(text: str, write: Callable[[str, Any], str], contexts: Contexts) -> str:
    """Return the text with each expression replaced by the result of `write`, called with it and its value."""
    return EMBEDDED.sub(lambda hit: write(hit[1], evaluate(hit[1], contexts)), text)


def text_of(value: Any) -> str:
    """Return a value as GitHub writes it into a text."""
    match value:
        case None:
            return ""
        case bool():
            return str(value).lower()
        case int() | float():
            return f"{value:.15g}"
        case str():
            return value
    return json.dumps(value)


def truth(value: Any) -> bool:
    """Return whether a value counts as true."""
    return value is not None and value is not False and value not in (0, "")


def names(text: str, context: str) -> frozenset[str]:
    """Return the keys of a context that a text's expressions use; `*` if an expression takes the whole context."""
    keys: set[str] = set()
    for expression in EMBEDDED.findall(text):
        keys |= names_in(expression, context)
    return frozenset(keys)


def names_in(expression: str, context: str) -> frozenset[str]:
    """Return the keys of a context that one expression, without its braces, uses."""
    # A text in quotes refers to nothing, but in `matrix['name']` it is the key.
    without = re.sub(r"'(?:[^']|'')*'", lambda quoted: quoted[0] if _is_key(quoted, expression) else "''", expression)
    references = re.findall(rf"(?<![\w.-]){context}\b(?:\.([\w-]+)|\[\s*'((?:[^']|'')*)'\s*\])?", without)
    return frozenset(dotted or quoted or "*" for dotted, quoted in references)


def _is_key(quoted: re.Match[str], expression: str) -> bool:
    return expression[: quoted.start()].rstrip().endswith("[")


# --- reading ---------------------------------------------------------------------------------------------------


class _Unreadable(Exception):
    """Error for a text that is not one of GitHub's expressions."""


def _tokens(expression: str) -> Iterator[tuple[str, str]]:
    at = 0
    while expression[at:].strip():
        token = _TOKEN.match(expression, at)
        if token is None or token.lastgroup is None:
            raise _Unreadable
        yield token.lastgroup, token[token.lastgroup]
        at = token.end()


@dataclass
class _Reader:
    """An evaluator by recursive descent; its methods go from the loosest binding to the tightest."""

    tokens: Sequence[tuple[str, str]]
    contexts: Contexts
    at: int = field(default=0)

    def either(self) -> Any:
        """Evaluate `a || b`."""
        value = self.both()
        while self._take("||"):
            other = self.both()
            if value is UNKNOWN:
                value = True if other is not UNKNOWN and truth(other) else UNKNOWN
            elif not truth(value):
                value = other
        return value

    def both(self) -> Any:
        """Evaluate `a && b`."""
        value = self.equal()
        while self._take("&&"):
            other = self.equal()
            if value is UNKNOWN:
                value = False if other is not UNKNOWN and not truth(other) else UNKNOWN
            elif truth(value):
                value = other
        return value

    def equal(self) -> Any:
        """Evaluate `a == b` and `a != b`."""
        value = self.ordered()
        while sign := self._take("==", "!="):
            other = self.ordered()
            computable = UNKNOWN not in (value, other)
            value = (_same(value, other) == (sign == "==")) if computable else UNKNOWN
        return value

    def ordered(self) -> Any:
        """Evaluate `a < b` and the like."""
        value = self.opposite()
        while sign := self._take("<", ">", "<=", ">="):
            other = self.opposite()
            computable = UNKNOWN not in (value, other)
            value = _ORDER[sign](*_comparable(value, other)) if computable else UNKNOWN
        return value

    def opposite(self) -> Any:
        """Evaluate `!a`."""
        if self._take("!"):
            value = self.opposite()
            return UNKNOWN if value is UNKNOWN else not truth(value)
        return self.single()

    def single(self) -> Any:
        """Evaluate a literal, a call, a value of a context, or an expression in parentheses."""
        kind, text = self.tokens[self.at]
        self.at += 1
        if kind == "string":
            return text[1:-1].replace("''", "'")
        if kind == "number":
            return float(text)
        if text == "(":
            value = self.either()
            self._need(")")
            return self._inside(value)
        if kind != "name":
            raise _Unreadable
        if self._take("("):
            return self._inside(_called(text, self._arguments()))
        if text in _CONSTANTS:
            return _CONSTANTS[text]
        return self._inside(self.contexts.get(text, UNKNOWN))

    def _inside(self, value: Any) -> Any:
        """Follow `.name` and `[...]` after a value, and return the inner value."""
        while sign := self._take(".", "["):
            if sign == ".":
                key: Any = self.tokens[self.at][1]
                self.at += 1
            else:
                key = self.either()
                self._need("]")
            value = _item(value, key)
        return value

    def _arguments(self) -> list[Any]:
        arguments: list[Any] = []
        while not self._take(")"):
            arguments.append(self.either())
            self._take(",")
        return arguments

    def _take(self, *signs: str) -> str | None:
        if self.at < len(self.tokens) and self.tokens[self.at] in [("sign", sign) for sign in signs]:
            self.at += 1
            return self.tokens[self.at - 1][1]
        return None

    def _need(self, sign: str) -> None:
        if not self._take(sign):
            raise _Unreadable


def _item(value: Any, key: Any) -> Any:
    if value is UNKNOWN or key is UNKNOWN or key == "*":
        return UNKNOWN
    if isinstance(value, Mapping):
        # GitHub does not distinguish the case of keys: `matrix.V` is `matrix.v`.
        lowered = {str(name).lower(): inner for name, inner in value.items()}
        return lowered.get(str(key).lower())
    if isinstance(value, list) and isinstance(key, int | float) and 0 <= key < len(value):
        return value[int(key)]
    return None


def _called(name: str, arguments: Sequence[Any]) -> Any:
    """Return the result of a function in a job in which nothing has failed so far, UNKNOWN if it has none."""
    if name in _STATUS:
        return _STATUS[name]
    function = _FUNCTIONS.get(name.lower())
    if function is None or UNKNOWN in arguments:
        return UNKNOWN
    try:
        return function(*arguments)
    except (TypeError, ValueError):
        return UNKNOWN


def _contains(within: Any, item: Any) -> bool:
    if isinstance(within, list):
        return any(_same(each, item) for each in within)
    return text_of(item).lower() in text_of(within).lower()


def _format(form: str, *values: Any) -> str:
    texts = dict(enumerate(map(text_of, values)))
    return re.sub(r"\{(\d+)\}", lambda place: texts.get(int(place[1]), ""), form)


def _same(value: Any, other: Any) -> bool:
    """Return whether two values are equal as GitHub compares: texts without their case, unlike types as numbers."""
    if isinstance(value, dict | list) or isinstance(other, dict | list):
        return value is other
    value, other = _comparable(value, other)
    return bool(value == other)


def _comparable(value: Any, other: Any) -> tuple[Any, Any]:
    if isinstance(value, str) and isinstance(other, str):
        return value.lower(), other.lower()
    return _number(value), _number(other)


def _number(value: Any) -> float:
    match value:
        case None | "":
            return 0.0
        case bool() | int() | float():
            return float(value)
    try:
        return float(value)
    except (TypeError, ValueError):
        # NaN equals nothing, so a text that is no number differs from every number.
        return float("nan")


_STATUS = {"always": True, "success": True, "failure": False, "cancelled": False}
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "contains": _contains,
    "startswith": lambda text, start: text_of(text).lower().startswith(text_of(start).lower()),
    "endswith": lambda text, end: text_of(text).lower().endswith(text_of(end).lower()),
    "format": _format,
    "tojson": json.dumps,
    "fromjson": json.loads,
}
