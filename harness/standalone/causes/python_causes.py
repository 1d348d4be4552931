"""Tell which Python a line of source needs: what the language itself took in, or refuses since a version."""

from __future__ import annotations

import re

from ..explain.import_names import package_with
from .scene import Cause, Causes, Pattern, Scene

UNION = Pattern(r"unsupported operand type\(s\) for \|: '([\w.]+)' and '([\w.]+)'", "unsupported operand type(s) for |")
TYPES = frozenset(
    {"type", "ABCMeta", "EnumMeta", "GenericAlias", "_GenericAlias", "_SpecialForm", "_UnionGenericAlias"}
)
"""Types of types, without their module."""

SUBSCRIPT = Pattern(r"'type' object is not subscriptable", "is not subscriptable")
BUILTIN = re.compile(r"(?<![\w.])(?:list|dict|tuple|set|frozenset|type)\[")
MUTABLE = Pattern(r"mutable default <class '([\w.]+)'> for field (\w+) is not allowed", "mutable default ")
MATCH = re.compile(r"^ *match [^\n=]+:\n[ ^~]*\nSyntaxError: invalid syntax", re.MULTILINE)
BUILTIN_MUTABLES = frozenset({"list", "dict", "set"})
"""Types that every Python refuses as a default of a field."""


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where the code is for a newer or an older Python."""
    union, mutable = UNION.search(line), MUTABLE.search(line)
    if union:
        kinds = [name.rpartition(".")[2] for name in union.groups()]
        if TYPES.intersection(kinds):
            yield _newer("types can be joined by `|` since Python 3.10", "3.10")
        elif kinds == ["dict", "dict"]:
            yield _newer("dictionaries can be joined by `|` since Python 3.9", "3.9")
    elif SUBSCRIPT.search(line) and BUILTIN.search(scene.failure.text):
        yield _newer("`list[int]` and its like are there since Python 3.9", "3.9")
    elif "SyntaxError" in line and MATCH.search(scene.failure.text):
        yield _newer("`match` is there since Python 3.10", "3.10")
    elif mutable and mutable.group(1) not in BUILTIN_MUTABLES:
        name = mutable.group(1)
        package = package_with(name.partition(".")[0])
        text = "Python 3.11 and newer refuse an instance of `{}` as the default of a field".format(name)
        way = "Or take a newer release of {}.".format(package or "the package that has this class")
        yield Cause("python", text, {"python": "<3.11", "text": way})


def _newer(text: str, version: str) -> Cause:
    return Cause("python", text + ", and this one is older", {"python": ">=" + version})
