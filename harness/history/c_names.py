"""Read the names of modules in C from the tables in their source. Nothing is compiled.

Conditions of the preprocessor are followed: a macro is defined if the build script defines it.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import msgspec

from harness.history import release_reader
from harness.history.package_plan import BUILD_SCRIPT, PackagePlan
from harness.history.release_reader import ReleaseFacts

STRING = r'"(?:\\.|[^"\\\n])*"'
STRING_OR_COMMENT = re.compile(rf"{STRING}|'(?:\\.|[^'\\\n])*'|//[^\n]*|/\*.*?\*/", re.DOTALL)
DIRECTIVE = re.compile(r"\s*#\s*(if|ifdef|ifndef|elif|else|endif)\b(.*)")
DEFINED = re.compile(r"\(*\s*(!?)\s*defined\s*\(?\s*(\w+)[\s)]*")

BODY = rf"((?:{STRING}|[^\"])*?)"
TABLE = re.compile(rf"\bPyMethodDef\s+(\w+)\s*\[\s*\w*\s*\]\s*=\s*\{{{BODY}\}}\s*;")
ENTRY = re.compile(r'\{\s*"(\w+)"\s*,')
MODULE = re.compile(rf"\bPyModuleDef\s+\w+\s*=\s*\{{{BODY}\}}\s*;|\bPy_InitModule\w*\s*\({BODY}\)\s*;")
"""The place where a module names its table; other tables of a file are those of its classes."""

ADDED = re.compile(r'\bPyModule_Add\w*\s*\(\s*\w+\s*,\s*(?:"(\w+)"|(\w+)\s*\))')
EXCEPTION = re.compile(r'\bPyErr_NewException\w*\s*\(\s*(?:\([^)]*\)\s*)?"([\w.]+)"')
EXCEPTION_MEMBERS = ("args", "with_traceback")
"""The public members of an exception that a C module makes; later Pythons add some to all exceptions."""

MACRO = re.compile(r"-D(\w+)")


def read_release(folder: Path, package: PackagePlan) -> tuple[ReleaseFacts, dict[str, Any]]:
    """Return the facts of an unpacked sdist, and the names of its modules in C as importing them would show them.

    Modules in Python count where setuptools installs them: in folders that are packages.
    """
    answers: dict[str, Any] = {"names": {}, "members": {}}
    defined = macros(_text(folder / BUILD_SCRIPT))
    for module, file in package.c_sources.items():
        for field, more in read(module, _text(folder / file), defined).items():
            answers[field].update(more)
    root = folder / package.source_root
    root = root if root.is_dir() else folder
    facts = release_reader.read(root, package.imports, _installed(root))
    modules, natives = ({*field, *package.c_sources} for field in (facts.modules, facts.natives))
    return msgspec.structs.replace(facts, modules=tuple(sorted(modules)), natives=tuple(sorted(natives))), answers


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8", errors="replace")


def _installed(root: Path) -> Iterator[str]:
    """Yield the modules below a folder that every folder between makes a part of a package."""
    for file in root.rglob("*.py"):
        path = file.relative_to(root)
        if all((root / parent / "__init__.py").exists() for parent in [*path.parents][:-1]):
            yield path.as_posix()


def macros(build_script: str) -> frozenset[str]:
    """Return the macros that a build script defines on some platform, by options of the compiler."""
    lines = (line.partition("#")[0] for line in build_script.splitlines())
    return frozenset(name for line in lines for name in MACRO.findall(line))


def read(module: str, source: str, defined: Collection[str] = ()) -> dict[str, Any]:
    """Return the public `names` of a module and the `members` of its exceptions, as importing it shows them.

    Raises ValueError if the source has no table of a module.
    """
    text = "\n".join(_compiled(STRING_OR_COMMENT.sub(_without_comment, source.replace("\\\n", " ")), defined))
    heads = " ".join(match[1] or match[2] for match in MODULE.finditer(text))
    tables = [match[2] for match in TABLE.finditer(text) if re.search(rf"\b{match[1]}\b", heads)]
    if not tables:
        message = f"its source in C has no table of the functions of {module}"
        raise ValueError(message)
    names = {name for table in tables for name in ENTRY.findall(table)}
    names |= {match[1] or match[2] for match in ADDED.finditer(text)}
    return {
        "names": {module: sorted(name for name in names if not name.startswith("_"))},
        "members": {path: list(EXCEPTION_MEMBERS) for path in EXCEPTION.findall(text)},
    }


def _without_comment(match: re.Match[str]) -> str:
    return match[0] if match[0][0] in "\"'" else " "


def _compiled(text: str, defined: Collection[str]) -> Iterator[str]:
    """Yield the lines outside of branches that the preprocessor leaves out."""
    branches: list[tuple[bool, bool]] = []  # of each open condition: is this branch in, was one of it
    for line in text.splitlines():
        match = DIRECTIVE.match(line)
        if match is None:
            if all(is_in for is_in, _ in branches):
                yield line
            continue
        word, condition = match.groups()
        if word.startswith("if"):
            is_in = _holds(word, condition.strip(), defined)
            branches.append((is_in, is_in))
        elif branches:
            _, had_one = branches.pop()
            if word != "endif":
                is_in = not had_one and (word == "else" or _holds("if", condition.strip(), defined))
                branches.append((is_in, had_one or is_in))


def _holds(word: str, condition: str, defined: Collection[str]) -> bool:
    """Return whether a condition is met; a comparison counts as met, as it is one of versions."""
    if word != "if":
        return (condition in defined) == (word == "ifdef")
    for part in condition.split("&&"):
        match = DEFINED.fullmatch(part.strip())
        if part.strip() == "0" or (match and (match[2] in defined) == bool(match[1])):
            return False
    return True
