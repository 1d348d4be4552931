"""Parse requirements of packages, with extras, URL and markers (PEP 508)."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any, Iterable, List, Mapping, NamedTuple, Optional

from .versions import OPERATOR, Clause, Specifiers, canonical, specifiers

NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9._-]*[A-Za-z0-9])?(?![A-Za-z0-9._-]*\w)", re.ASCII)
EXTRAS = re.compile(r"\[([^\]]*)\]")
URL = re.compile(r"@[ \t]*([^ \t]+)")
TOKEN = re.compile(
    r"""[ \t]*(?:(?P<open>\()|(?P<close>\))
    |(?P<operator>===|==|~=|!=|<=|>=|<|>|\bnot[ \t]+in\b|\bin\b)
    |(?P<text>'[^']*'|"[^"]*")
    |(?P<word>[a-z_.]+))""",
    re.VERBOSE,
)
OLD_NAMES = {
    "os.name": "os_name",
    "sys.platform": "sys_platform",
    "platform.version": "platform_version",
    "platform.machine": "platform_machine",
    "platform.python_implementation": "platform_python_implementation",
    "python_implementation": "platform_python_implementation",
}
VARIABLES = frozenset(
    "python_version python_full_version os_name sys_platform platform_release platform_system platform_version"
    " platform_machine platform_python_implementation implementation_name implementation_version extra extras"
    " dependency_groups".split()
)
OF_VERSIONS = frozenset({"python_version", "python_full_version", "implementation_version"})
MANY = frozenset({"extras", "dependency_groups"})


class Term(NamedTuple):
    """One side of a comparison: a variable of the environment, or a text."""

    text: str
    variable: bool


class Comparison(NamedTuple):
    """A marker of one operator."""

    left: Term
    operator: str
    right: Term

    def holds(self, environment: Mapping[str, Any]) -> bool:
        """Return whether the comparison holds in an environment. Raises KeyError for a variable that is not given."""
        variable = self.left.text if self.left.variable else self.right.text
        left, right = (environment[side.text] if side.variable else side.text for side in (self.left, self.right))
        if variable == "extra" or variable in MANY:
            left, right = _names(left), _names(right)
        if variable in OF_VERSIONS and OPERATOR.match(self.operator):
            left = left + "local" if left.endswith("+") else left  # a build of a checkout of Python
            try:
                return Clause(self.operator + right).admits_text(left)
            except ValueError:
                pass
        return _compared(left, self.operator, right)


def _names(value: Any) -> Any:
    return canonical(value) if isinstance(value, str) else {canonical(each) for each in value}


def _compared(left: Any, operator: str, right: Any) -> bool:
    """Compare two texts. They have no order: `<=` and `>=` mean that they are equal."""
    if operator in {"in", "not in"}:
        return (left in right) is (operator == "in")
    if operator == "!=":
        return bool(left != right)
    if operator in {"~=", "==="}:
        message = '{} means nothing between "{}" and "{}", which are no versions'.format(operator, left, right)
        raise ValueError(message)
    return operator in {"==", "<=", ">="} and bool(left == right)


class Group(NamedTuple):
    """Markers of which any, or all, have to hold."""

    any_of: bool
    parts: List[Any]

    def holds(self, environment: Mapping[str, Any]) -> bool:
        """Return whether the group holds in an environment. Raises KeyError for a variable that is not given."""
        found = [part.holds(environment) for part in self.parts]
        return any(found) if self.any_of else all(found)


class _Reader:
    """Parses the marker in a text, token by token."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.position = 0

    def whole(self) -> Any:
        made = self._any_of()
        if self.text[self.position :].strip(" \t"):
            raise self._wrong()
        return made

    def _wrong(self) -> ValueError:
        return ValueError('"{}" is not a marker such as \'python_version < "3.11"\''.format(self.text.strip()))

    def _next(self, *kinds: str) -> Optional[str]:
        """Return the next token if it is of one of these kinds, else None."""
        found = TOKEN.match(self.text, self.position)
        if not found or found.lastgroup not in kinds:
            return None
        self.position = found.end()
        return found.group(found.lastgroup)

    def _word(self, word: str) -> bool:
        found = re.compile(r"[ \t]*\b" + word + r"\b").match(self.text, self.position)
        if found:
            self.position = found.end()
        return bool(found)

    def _any_of(self) -> Any:
        parts = [self._all_of()]
        while self._word("or"):
            parts.append(self._all_of())
        return parts[0] if len(parts) == 1 else Group(any_of=True, parts=parts)

    def _all_of(self) -> Any:
        parts = [self._one()]
        while self._word("and"):
            parts.append(self._one())
        return parts[0] if len(parts) == 1 else Group(any_of=False, parts=parts)

    def _one(self) -> Any:
        if self._next("open"):
            made = self._any_of()
            if not self._next("close"):
                raise self._wrong()
            return made
        left, operator, right = self._term(), self._next("operator"), self._term()
        if operator is None or left.variable is right.variable:
            raise self._wrong()
        return Comparison(left, " ".join(operator.split()), right)

    def _term(self) -> Term:
        text = self._next("text")
        if text is not None:
            return Term(text[1:-1], variable=False)
        word = self._next("word")
        named = OLD_NAMES.get(word or "", word or "")
        if named not in VARIABLES:
            raise self._wrong()
        return Term(named, variable=True)


class Requirement:
    """A requirement: `name[extra]>=1; marker` or `name @ URL`. Raises ValueError."""

    __slots__ = ("extras", "marker", "name", "specifiers", "text", "url")

    def __init__(self, text: str) -> None:
        self.text = text
        name = NAME.match(text.strip(" \t"))
        if not name:
            raise self._wrong()
        rest = text.strip(" \t")[name.end() :].lstrip(" \t")
        self.name = canonical(name.group())
        self.extras, rest = self._extras(rest)
        self.url, self.specifiers, marker = self._details(rest.lstrip(" \t"))
        self.marker = _Reader(marker).whole() if marker is not None else None

    def _wrong(self) -> ValueError:
        return ValueError('"{}" is not a requirement'.format(self.text))

    def _extras(self, rest: str) -> Any:
        found = EXTRAS.match(rest)
        if not found:
            return frozenset(), rest
        names = [part.strip(" \t") for part in found.group(1).split(",")] if found.group(1).strip(" \t") else []
        if not all(NAME.fullmatch(name) for name in names):
            raise self._wrong()
        return frozenset(map(canonical, names)), rest[found.end() :]

    def _details(self, rest: str) -> Any:
        """Return URL, specifiers and marker."""
        found = URL.match(rest)
        if found:
            after = rest[found.end() :].strip(" \t")
            if after and not after.startswith(";"):
                raise self._wrong()
            return found.group(1), specifiers(""), after[1:] if after else None
        asked, semicolon, marker = rest.partition(";")
        asked = asked.strip(" \t")
        if asked.startswith("(") and asked.endswith(")"):
            asked = asked[1:-1].strip(" \t")
        return None, self._specifiers(asked), marker if semicolon else None

    def _specifiers(self, asked: str) -> Specifiers:
        parts = asked.split(",")
        if asked and not all(part.strip() for part in parts[:-1]):
            raise self._wrong()
        try:
            return specifiers(asked)
        except ValueError:
            raise self._wrong() from None

    def wanted(self, environment: Mapping[str, str], extras: Iterable[str] = ()) -> bool:
        """Return whether the requirement applies in an environment, for one of the requested extras or for none.

        Raises KeyError for a variable that the environment lacks, ValueError for a comparison that means nothing.
        """
        if self.marker is None:
            return True
        return any(
            self.marker.holds({"extras": set(), "dependency_groups": set(), **environment, "extra": extra})
            for extra in ("", *extras)
        )


@lru_cache(maxsize=None)
def requirement(text: str) -> Requirement:
    """Return the requirement, parsed once. Raises ValueError."""
    return Requirement(text)
