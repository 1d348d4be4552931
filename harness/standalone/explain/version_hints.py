"""Collect hints on an environment that a text gives in passing: Python, and versions of packages. Hints, no more."""

from __future__ import annotations

import re
from typing import Dict, Iterator, List, NamedTuple, Optional, Tuple

from ..versions import canonical, is_version

IN_PATH = re.compile(r"[/\\](?:lib[/\\])?[Pp]ython-?(3)\.?(\d{1,2})(?:[/\\]|\.exe)")
IN_WORDS = re.compile(r"\b(?:C?Python|python=+)\s*(?:version:? )?v?(3)\.(\d{1,2})(?:\.\d+)?\b")
IN_TAG = re.compile(r"\b(?:cp|cpython-)(3)(\d{1,2})\b")
NAME = r"([A-Za-z0-9][A-Za-z0-9._-]*)"
VERSION = r"(\d[A-Za-z0-9.!+]*)"
INSTALLED = re.compile(r"^\s*Successfully installed (.+)$", re.MULTILINE)
ADDED = re.compile(r"^\s*[+~] {}==({}?)\s*$".format(NAME, r"\d\S*"), re.MULTILINE)
THERE = re.compile(r"Requirement already satisfied: {}[^\n]* \({}\)".format(NAME, VERSION))
FROZEN = re.compile(r"^\s*{}==({})\s*(?:[#;].*)?$".format(NAME, r"\d\S*?"), re.MULTILINE)
LISTED = re.compile(r"^{}\s{{2,}}{}(?:\s{{2,}}\S+)*\s*$".format(NAME, VERSION), re.MULTILINE)
NAMED = re.compile(
    r"(?<![\w./-]){}==({})(?=[\s,;:)`'\"]|\.?$|\.\s)".format(NAME, r"\d[A-Za-z0-9.!+]*[A-Za-z0-9]|\d"), re.MULTILINE
)
HAVE = re.compile(r"but you(?:'ll)? have {} {} which".format(NAME, VERSION))
IN_FILE = re.compile(
    r"\b([A-Za-z0-9_.]+)-(\d[A-Za-z0-9.!+]*)(?:-(?:cp|py)\d\S*\.whl|\.tar\.gz|\.dist-info|-py3\.\d+\.egg)"
)
KEYS = "gym|gymnasium|numpy|mujoco|torch|jax|jaxlib|scipy|pybullet|robosuite|dm[_-]control"
KEY_VERSION = re.compile(r"\b({})(?:'s)? version ?:? ?`?v?{}".format(KEYS, VERSION), re.IGNORECASE)


class Hints(NamedTuple):
    """Python as "3.N", and exact versions of packages; contradictory hints are left out."""

    python: Optional[str]
    packages: Dict[str, str]


def hints(text: str) -> Hints:
    """Return all hints that a text gives."""
    return Hints(_python(text), _packages(text))


def _python(text: str) -> Optional[str]:
    """Return the Python of the paths in a text, else of its words, else of file names; None if several are found."""
    for pattern in (IN_PATH, IN_WORDS, IN_TAG):
        versions = {"{}.{}".format(*match) for match in pattern.findall(text)}
        if versions:
            return versions.pop() if len(versions) == 1 else None
    return None


def _packages(text: str) -> Dict[str, str]:
    """Return versions by package: those that the text installs, else those already there, else those only named."""
    packages: Dict[str, str] = {}
    for source in (_installed, _there, _mentioned):
        candidates: Dict[str, List[str]] = {}
        for name, version in source(text):
            if is_version(version):
                candidates.setdefault(canonical(name), []).append(version)
        for name, versions in candidates.items():
            # Of several installations of one package the last one counts: it replaced those before.
            if name not in packages and (len(set(versions)) == 1 or source is _installed):
                packages[name] = versions[-1]
            # The empty version keeps weaker sources from deciding where this one contradicts itself.
            packages.setdefault(name, "")
    return {name: version for name, version in packages.items() if version and name != "python"}


def _installed(text: str) -> Iterator[Tuple[str, str]]:
    for line in INSTALLED.findall(text):
        for item in line.split():
            name, _, version = item.rpartition("-")
            yield name, version
    yield from ADDED.findall(text)


def _there(text: str) -> Iterator[Tuple[str, str]]:
    for pattern, literal in ((THERE, "already satisfied"), (HAVE, "have "), (FROZEN, "=="), (LISTED, "  ")):
        yield from pattern.findall(text) if literal in text else ()


def _mentioned(text: str) -> Iterator[Tuple[str, str]]:
    for pattern, literals in ((NAMED, ("==",)), (IN_FILE, (".whl", ".tar.gz", ".dist-info", ".egg"))):
        yield from pattern.findall(text) if any(literal in text for literal in literals) else ()
    yield from KEY_VERSION.findall(text) if "version" in text.lower() else ()
