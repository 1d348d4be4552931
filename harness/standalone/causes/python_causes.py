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
ABSTRACT = Pattern(
    r"cannot import name '?(\w+)'? from '?collections'?(?! *\.)|module 'collections' has no attribute '(\w+)'",
    "collections",
)
ABSTRACT_CLASSES = frozenset(
    "Callable Container Generator Hashable ItemsView Iterable Iterator KeysView Mapping MappingView MutableMapping"
    " MutableSequence MutableSet Sequence Set Sized ValuesView".split()
)
BUILTIN_MUTABLES = frozenset({"list", "dict", "set"})
"""Types that every Python refuses as a default of a field."""


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where the code is for a newer or an older Python."""
    union, mutable, abstract = UNION.search(line), MUTABLE.search(line), ABSTRACT.search(line)
    if union:
        kinds = [name.rpartition(".")[2] for name in union.groups()]
        if TYPES.intersection(kinds):
            yield _newer("types can be joined by `|` since Python 3.10", "3.10")
        elif kinds == ["dict", "dict"]:
            yield _newer("dictionaries can be joined by `|` since Python 3.9", "3.9")
    elif SUBSCRIPT.search(line) and BUILTIN.search(scene.failure.text):
        yield _newer("`list[int]` and similar types exist since Python 3.9", "3.9")
    elif "SyntaxError" in line and MATCH.search(scene.failure.text):
        yield _newer("`match` exists since Python 3.10", "3.10")
    elif abstract and next(filter(None, abstract.groups())) in ABSTRACT_CLASSES:
        text = "Python 3.10 removed `{}` from collections; it is in collections.abc"
        way = "Or install a newer release of the package that imports it, or write `collections.abc` there."
        yield Cause("python", text.format(next(filter(None, abstract.groups()))), {"python": "<3.10", "text": way})
    elif mutable and mutable.group(1) not in BUILTIN_MUTABLES:
        name = mutable.group(1)
        package = package_with(name.partition(".")[0])
        text = "Python 3.11 and newer reject an instance of `{}` as the default of a field".format(name)
        way = "Or install a newer release of {}.".format(package or "the package that has this class")
        yield Cause("python", text, {"python": "<3.11", "text": way})


def _newer(text: str, version: str) -> Cause:
    return Cause("python", text + ", and this one is older", {"python": ">=" + version})
