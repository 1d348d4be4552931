"""Read the names, classes and signatures of a package from its source. Nothing of it is run."""

from __future__ import annotations

import ast
import logging
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

TESTS = frozenset({"tests", "test", "_pytest"})
PASSED_OVER = TESTS | {"docs", "examples", "benchmarks"}
"""Names of packages that nobody imports who uses what they are in."""

VENDORED = frozenset({"_vendor", "vendor", "vendored", "_vendored", "third_party", "thirdparty", "externals", "extern"})
"""Names of packages that hold copies of other packages: they can be imported, but their contents are not told."""

CALLED = frozenset({"__init__", "__new__", "__call__"})


DYNAMIC = re.compile(
    r"\b(?:globals|locals|vars)\(\)(?:\[[^\]]+\]\s*=[^=]|\.update\(|\.setdefault\()|=\s*(?:globals\(\)|sys\.modules\[__name__\])"
    r"|\bsetattr\(\s*sys\.modules\[|^\s*exec\(",
    re.MULTILINE,
)
"""Code by which a module gets names that its source does not show."""

LAZY = re.compile(r"\bsys\.modules\[__name__\]\s*=[^=]|^(?:def )?__getattr__\b", re.MULTILINE)
"""Code by which a module imports names as they are asked for, itself or by another object in its place."""


class PackageNames(msgspec.Struct, kw_only=True):
    """The public names of each module, those of each class, and the parameters of functions and methods.

    `imported` are names that a module has from other packages; `dynamic` are modules that have further names.
    """

    names: dict[str, tuple[str, ...]] = {}
    imported: dict[str, tuple[str, ...]] = {}
    dynamic: tuple[str, ...] = ()
    members: dict[str, tuple[str, ...]] = {}
    signatures: dict[str, str] = {}


def read(root: Path, top: str) -> PackageNames:
    """Return what a package or a module below a folder offers.

    Modules, classes and functions with a private name count only where a public module has them under another one.
    """
    import griffe  # noqa: PLC0415 - only the maker of the history needs it

    logging.getLogger("griffe").setLevel(logging.CRITICAL)
    package: Any = griffe.load(
        top, search_paths=[root], allow_inspection=False, resolve_aliases=True, find_stubs_package=False
    )
    reader = _Reader(top)
    waiting = [package]
    while waiting:
        waiting += reader.read_module(waiting.pop())
    return reader.public()


class _Reader:
    """Collects the names of one package, and which private ones public modules hand on."""

    def __init__(self, top: str) -> None:
        self.top = top
        self.found = PackageNames()
        self.handed_on: set[str] = set()

    def read_module(self, place: Any) -> Iterator[Any]:
        """Take in a module; yield those below it."""
        text, private = _source(place), _is_private(place.path)
        lazy = LAZY.search(text) is not None
        names, imported = set(_strings(text)) if lazy and not private else set(), set()
        for name, member in place.members.items():
            # An import for type checkers alone is there at run time only if the module is lazy.
            shown = not name.startswith("_") and (member.runtime or lazy)
            if member.is_alias:
                target = _target(member) if shown else ""
                if target.partition(".")[0] != self.top:
                    imported |= {name} if shown else set()
                    continue
                if not private:
                    self.handed_on.add(target)
            elif member.is_module and member.is_package and name in PASSED_OVER | VENDORED:
                continue
            elif member.is_module:
                yield member
            else:
                self._read_object(member)
            if shown:
                names.add(name)
        if not private:
            self.found.names[place.path] = tuple(sorted(names))
            self.found.imported[place.path] = tuple(sorted(imported - names))
            if not lazy and DYNAMIC.search(text):
                self.found.dynamic += (place.path,)

    def _read_object(self, member: Any) -> None:
        if member.is_function:
            self.found.signatures[member.path] = _parameters(member)
        elif member.is_class:
            self._read_class(member)

    def _read_class(self, place: Any) -> None:
        public = []
        for name, member in place.members.items():
            if not name.startswith("_"):
                public.append(name)
            if not member.is_alias and member.is_function and (not name.startswith("_") or name in CALLED):
                self.found.signatures[member.path] = _parameters(member)
            if not member.is_alias and member.is_class:
                self._read_class(member)
        self.found.members[place.path] = tuple(sorted(public))

    def public(self) -> PackageNames:
        """Return what is public or handed on by a public module."""
        return PackageNames(
            names=self.found.names,
            imported=self.found.imported,
            dynamic=self.found.dynamic,
            members={path: value for path, value in self.found.members.items() if self._is_public(path)},
            signatures={path: value for path, value in self.found.signatures.items() if self._is_public(path)},
        )

    def _is_public(self, path: str) -> bool:
        owner, _, name = path.rpartition(".")
        visible = owner if name in CALLED else path
        return not _is_private(visible) or path in self.handed_on or owner in self.handed_on


def _is_private(path: str) -> bool:
    return any(part.startswith("_") for part in path.split("."))


def _target(alias: Any) -> str:
    """Return the path that a name was imported from; empty where that is not to be found."""
    try:
        return str(alias.final_target.path)
    except Exception:  # an alias of a module that is not there raises an error of its own
        pass
    try:
        return str(alias.target_path)
    except Exception:
        return ""


def _source(place: Any) -> str:
    try:
        return Path(place.filepath).read_text(encoding="utf-8")
    except (OSError, TypeError, ValueError):  # a folder without a file has a list of paths
        return ""


def _strings(source: str) -> Iterator[str]:
    """Yield the texts in a module that could be names: its `__getattr__` may offer each of them."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and text.isidentifier() and not text.startswith("_"):
            yield text


def _parameters(function: Any) -> str:
    """Return the parameters of a function as in its definition, without annotations; a default is `=`."""
    texts, star = [], False
    for place in function.parameters:
        kind = place.kind.value
        mark = {"variadic positional": "*", "variadic keyword": "**"}.get(kind, "")
        if kind == "keyword-only" and not star:
            texts.append("*")
            star = True
        star = star or mark == "*"
        texts.append(f"{mark}{place.name}{'=' if place.default is not None and not mark else ''}")
    return ", ".join(texts)
