"""Choose the folder of a first matrix: one that setuptools does not take for a package of the project."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from harness.model import schema

FOLDER, HIDDEN = "matrices", ".simmatrix"
_NAMED = re.compile(r"\b(?:packages|py_modules)\s*=")


def matrix_folder(pyproject: str, setup: str, config: str, *, src: bool) -> str:
    """Return `matrices`; where setuptools looks for packages itself, `.simmatrix`, which it passes by.

    Beside the project's package, a folder `matrices` is a second one to it, and the build ends with "Multiple
    top-level packages discovered". The texts are those of pyproject.toml, setup.py and setup.cfg; `src` is whether
    the packages lie in such a folder.
    """
    document = schema.load_toml(pyproject, dict[str, Any], "pyproject.toml")
    # A project that names no build backend is built with setuptools.
    backend = _table(document, "build-system").get("build-backend", "setuptools")
    if src or not str(backend).startswith("setuptools") or _NAMED.search(setup) or _NAMED.search(config):
        return FOLDER
    settings = _table(_table(document, "tool"), "setuptools")
    packages = settings.get("packages")
    if isinstance(packages, Mapping):
        find = _table(packages, "find")
        return FOLDER if "include" in find or "where" in find else HIDDEN
    return FOLDER if packages is not None or "py-modules" in settings else HIDDEN


def _table(document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = document.get(name)
    return table if isinstance(table, Mapping) else {}
