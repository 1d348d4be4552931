"""Define the document of `check`, and its exit code."""

from __future__ import annotations

from collections.abc import Collection
from enum import StrEnum

import msgspec


class Kind(StrEnum):
    """The kind of a finding, the worst first."""

    CONFLICT = "conflict"
    BAD = "bad"
    ADMITS = "admits"
    CHANGES = "changes"
    UNMEASURED = "unmeasured"
    GOOD = "good"
    EXCLUDES = "excludes"


FAULTS = frozenset({Kind.BAD, Kind.ADMITS, Kind.CHANGES, Kind.CONFLICT})
FAIL_ON = (Kind.CONFLICT, Kind.BAD, Kind.ADMITS, Kind.CHANGES, Kind.UNMEASURED)
"""Kinds that an exit code may tell, all of them unless others are asked for."""


class CheckFinding(msgspec.Struct, frozen=True, kw_only=True):
    """A finding about some packages of a project.

    `versions` are those measured, `cells` the measured combinations that show it, `causes` the known issues, `fix` what
    helps against the first of them. `bound` is a requirement that avoids it, `next` a command that tells more.
    """

    kind: Kind
    text: str
    versions: dict[str, str] = {}
    python: str | None = None
    measured: str | None = None
    line: str | None = None
    cells: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()
    fix: str | None = None
    bound: str | None = None
    next: str | None = None


class Checked(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `check --json`.

    `packages` are those that measured results concern, as requirements. `not_run` are packages that no case ran,
    `unjudged` requirements that cannot be judged, each with the reason.
    """

    schema: int = 1
    source: str
    python: str | None
    packages: tuple[str, ...]
    findings: tuple[CheckFinding, ...]
    not_run: tuple[str, ...]
    unjudged: tuple[str, ...]


class CheckedFiles(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `check --each --json`: every file by itself."""

    schema: int = 1
    files: tuple[Checked, ...]


def exit_code(document: Checked, fail_on: Collection[str] = FAIL_ON) -> int:
    """Return 1 where something fails or may change, 3 where something was never measured, else 0.

    Only the kinds in `fail_on` count.
    """
    kinds = {finding.kind for finding in document.findings}
    if kinds & FAULTS & {*fail_on}:
        return 1
    unmeasured = Kind.UNMEASURED in kinds or Kind.GOOD not in kinds
    return 3 if unmeasured and Kind.UNMEASURED in fail_on else 0
