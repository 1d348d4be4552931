"""Hold all that a plan is made of: what was read and asked for it beforehand."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from msgspec import Struct

from harness.matrix.matrix_types import Expansion, Matrix
from harness.matrix.version_ranges import Breaks
from harness.model import IndexSettings, Repair

Recipes = Mapping[str, tuple[Repair, ...]]


class Project(Struct, frozen=True, kw_only=True):
    """The package under test: its source, found from anywhere, and the names that its pyproject declares, if any."""

    source: str
    extras: Collection[str] | None = None
    groups: Collection[str] | None = None


class Sources(Struct, frozen=True, kw_only=True):
    """All that a plan is made of.

    Args:
        matrix: The matrix file, with the known failures filled in that it names.
        host_python: The version that `host` stands for.
        expansion: The releases that its ranges came to, and the combinations that were chosen.
        texts: The texts of `matrix_file.sources(matrix)`.
        breaks: The releases at which an API broke.
        recipes: How the packages that `overlay` names are patched.
        index: Where packages come from, found from anywhere; None: as the matrix says.
        project: The package under test; None: the source that the matrix names.
        banks: The SHA-256 and the file of each bank of states, by its path as the matrix names it.
        policies: The content of each file of a policy, by its path as the matrix names it.
    """

    matrix: Matrix
    host_python: str
    expansion: Expansion | None = None
    texts: Mapping[str, str] = {}
    breaks: Breaks = {}
    recipes: Recipes = {}
    index: IndexSettings | None = None
    project: Project | None = None
    banks: Mapping[str, tuple[str, str]] = {}
    policies: Mapping[str, Mapping[str, Any]] = {}
