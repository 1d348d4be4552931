"""What is told of a run: the types of the report document (`report.json`) and of the tables made from it.

The document's keys are a contract: some may be added, none renamed. Paths are relative to the document.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal

import msgspec

from harness.model import Level, Outcome, Phase, Verdict

SEVERITY = (
    Verdict.UNRESOLVABLE,
    Verdict.UNINSTALLABLE,
    Verdict.IMPORT_FAILS,
    Verdict.BROKEN,
    Verdict.PARTIAL,
    Verdict.INCONCLUSIVE,
    Verdict.UNAVAILABLE,
    Verdict.NOT_RUN,
    Verdict.WORKS,
)
"""Worst first: what says something against the packages (the earlier it stops, the worse), then what says nothing."""

UNTOLD = frozenset({Verdict.INCONCLUSIVE, Verdict.UNAVAILABLE, Verdict.NOT_RUN})
"""Verdicts that say nothing about the packages; nothing can be expected or unexpected about them."""

SYMBOLS: Mapping[Verdict, str] = {
    Verdict.WORKS: "✔",
    Verdict.PARTIAL: "◐",
    Verdict.BROKEN: "✘",
    Verdict.IMPORT_FAILS: "⊗",
    Verdict.UNINSTALLABLE: "⊘",
    Verdict.UNRESOLVABLE: "∅",
    Verdict.UNAVAILABLE: "◌",
    Verdict.INCONCLUSIVE: "?",
    Verdict.NOT_RUN: "-",
}
"""One column wide and distinct without colour."""


def word(name: str) -> str:
    """A verdict or outcome as people read it: `import fails`."""
    return name.replace("_", " ")


def number(count: int, noun: str) -> str:
    """How many: `1 cell`, `2 cells`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


class FindingEntry(msgspec.Struct, frozen=True, kw_only=True):
    """Something to know that does not stop a user's loop; `cases` are those it was seen in."""

    check: str
    level: Level
    text: str
    cases: tuple[str, ...] = ()


class CaseEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One environment tried. `reasons` and `masked` say per check why it ended so, and what hid that.

    `drawn` is the OpenGL context that drew its frames: api (egl, osmesa, glx), vendor, renderer, version, device.
    `told` is what a check measured that its page shows.
    """

    case: str
    env: str | None
    api: str
    phases: dict[Phase, Outcome]
    checks: dict[str, Outcome]
    frames: tuple[str, ...]
    decisive: str | None
    reasons: dict[str, str] = {}
    masked: dict[str, str] = {}
    evidence: dict[Phase, str] = {}
    drawn: dict[str, str] = {}
    told: dict[str, Any] | msgspec.UnsetType = msgspec.UNSET


class ExpectationEntry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What the matrix says the cell is expected to be."""

    verdict: Verdict
    reason: str
    phase: Phase | None = None
    match: str | None = None
    signature: str | None = None
    link: str | None = None
    until: str | None = None


class SubjectEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The package under test: where its source stood, and the wheel that was measured, where one came to be.

    `changed` is whether the files differed from the commit.
    """

    name: str | None
    version: str | None
    commit: str | None
    changed: bool
    wheel_sha256: str | None
    extras: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()


class BroughtEntry(msgspec.Struct, frozen=True, kw_only=True):
    """What the user brought: `mark` is a hash of what it held, `changed` whether that differs from the commit."""

    name: str
    mark: str
    commit: str | None
    changed: bool


class SuiteEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The subject's own tests in this cell. `tests` counts them by how they ended."""

    outcome: Outcome
    tests: dict[str, int]
    decisive: str | None
    evidence: str | None


class ControlEntry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a known-good combination of an adapter came to on the same machine: the failed checks with their lines.

    `untold` is why it could not be run: then nothing is known of the adapter, and failures stand as they were seen.
    """

    control: str
    failed: dict[str, str] = {}
    untold: str | None = None


class DiagnosisEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A known cause that fits the evidence: `seen` is the line by which it was told.

    The remedy is proven where the cell `proof`, which is this one with the remedy applied, was measured and works.
    """

    signature: str
    cause: str
    remedy: dict[str, Any]
    proven: bool
    masks: bool
    references: tuple[str, ...]
    generic: bool = False
    phase: Phase | None = None
    seen: str = ""
    proof: str | None = None


class ChangeEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A change that was tried, `does` in words and `change` as a machine applies it.

    `remedy_of` are the signatures whose remedy makes the same of the same cell, `advice` is what people say helps.
    """

    name: str
    reason: str
    does: tuple[str, ...]
    change: dict[str, Any]
    remedy_of: tuple[str, ...] = ()
    advice: bool = False
    link: str | None = None


class CellEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One cell on one machine, measured or not. `phase` is the one that decided the verdict.

    A cell that a `change` makes of another one has the axes of that, its `base`.

    `asked` marks what it asks for besides its axes: the same for the same packages and cases. `controls` has, by API,
    those of the adapters with which something failed after the install. `empty` are variables that were set, to the
    empty string; in `environment` that means unset.
    """

    id: str
    matrix: str
    axes: dict[str, str]
    requested_python: str
    python: str | None
    machine: str | None
    environment: dict[str, str]
    supplied: dict[str, str]
    installed: dict[str, str] | None
    lock: str | None
    lock_sha256: str | None
    key: str | None
    measured: str | None
    reused: bool
    inferred: bool
    attempts: int
    seconds: float
    verdict: Verdict
    unverified: tuple[str, ...]
    expected: Verdict
    as_expected: bool | None
    repairs: tuple[dict[str, Any], ...]
    findings: tuple[FindingEntry, ...]
    phases: dict[Phase, Outcome]
    cases: tuple[CaseEntry, ...]
    decisive: str | None
    diagnoses: tuple[DiagnosisEntry, ...]
    evidence: str | None
    phase: Phase | None = None
    expectation: ExpectationEntry | None = None
    requirements: tuple[str, ...] = ()
    asked: str = ""
    subject: SubjectEntry | None = None
    brought: tuple[BroughtEntry, ...] | msgspec.UnsetType = msgspec.UNSET
    empty: tuple[str, ...] | msgspec.UnsetType = msgspec.UNSET
    suite: SuiteEntry | None = None
    controls: dict[str, ControlEntry] | msgspec.UnsetType = msgspec.UNSET
    base: str | None = None
    change: ChangeEntry | None = None


class DroppedEntry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Combinations that are not run, and why: `id` is that of one, or a pattern that stands for `count` of them."""

    id: str
    reason: str
    count: int = 1


class MatrixEntry(msgspec.Struct, frozen=True, kw_only=True):
    """What the tables need of a matrix: its axes in order, and the packages whose versions it wants shown.

    `snapshot` is the cutoff that it names, if it does, `pivot` the axes that it wants in the small table.
    """

    axes: tuple[str, ...]
    shown: tuple[str, ...] = ()
    snapshot: str | None = None
    pivot: tuple[str, str] | None = None


class Document(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that a report says. `probes` are hashes of the in-cell files that it was measured with."""

    schema: Literal[1] = 1
    generated: str
    machines: dict[str, dict[str, Any]]
    cells: tuple[CellEntry, ...]
    dropped: tuple[DroppedEntry, ...]
    matrices: dict[str, MatrixEntry] = {}
    stale: tuple[str, ...] = ()
    probes: dict[str, str] = {}


# --- the tables --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, slots=True)
class Row:
    """One cell as the list shows it: on one machine, or on all those that found the same.

    `versions` stand in the order of the sheet's columns, as installed. `why` is the decisive line, or what a working
    cell could not show; `hidden_by` what hid it; `expected` a sentence on the expectation, where there is need of one;
    `repaired` the releases that nobody gets as they are here; `known` is the signature of the cause, where one is.
    """

    id: str
    label: str
    verdict: Verdict
    as_expected: bool | None
    phase: str
    why: str
    hidden_by: tuple[str, ...]
    expected: str
    versions: tuple[str, ...]
    findings: int
    seconds: float
    machine: str
    repaired: tuple[str, ...] = ()
    cause: str = ""
    remedy: str = ""
    proven: bool = False
    known: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class Square:
    """Where two axis values meet on one machine: the worst verdict, and how many of the cells there have it."""

    machine: str
    verdict: Verdict
    count: int
    total: int


@dataclass(frozen=True, kw_only=True, slots=True)
class Pivot:
    """The cells of a matrix over two of its axes.

    A square holds an entry for each machine of the sheet, in their order; none where no cell is.
    """

    down: str
    across: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    squares: tuple[tuple[tuple[Square, ...], ...], ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Cause:
    """A known failure that fits cells, and its remedy in words, which a machine can apply or not.

    `proofs` are the cells that the remedy cured, each with its lock.
    """

    signature: str
    cause: str
    remedy: str
    applicable: bool
    proofs: tuple[tuple[str, str], ...]
    references: tuple[str, ...]


class Effect(StrEnum):
    """What a change did to a cell."""

    CURES = "cures"
    PARTLY = "cures part of it"
    UNCOVERS = "another failure behind it"
    NOTHING = "no difference"
    BREAKS = "breaks"
    UNTOLD = "not known"


@dataclass(frozen=True, kw_only=True, slots=True)
class Attempt:
    """A change tried on a cell: where it stood before and stands after, each in words, and what the change did."""

    cell: str
    before: str
    change: str
    does: tuple[str, ...]
    reason: str
    advice: bool
    link: str
    after: str
    effect: Effect
    lock: str
    machine: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Explanation:
    """Why cells are not green: those with the same reason together."""

    verdict: Verdict
    phase: str
    decisive: str
    hidden_by: tuple[str, ...]
    expected: str
    link: str
    cells: tuple[str, ...]
    causes: tuple[Cause, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class Trouble:
    """One cause and all the cells that have it; `known` is its signature, empty where none fits.

    `where` says which `cells` these are, as values of axes. The `cause` of an unknown one is what the matrix says of
    it, if anything. `proofs` are changed cells that work, by which the remedy is proven for `proven` of the cells.
    `also` are known failures that fit some of the cells, too, after the deepest one.
    """

    known: str
    cause: str
    verdicts: tuple[tuple[Verdict, int], ...]
    phases: tuple[str, ...]
    cells: int
    where: str
    line: str
    remedy: str
    applicable: bool
    proofs: tuple[tuple[str, str], ...]
    references: tuple[str, ...]
    explanations: tuple[Explanation, ...]
    proven: int = 0
    also: tuple[Cause, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class Remark:
    """The same text about one or more cells: a finding, or the reason why combinations were left out."""

    about: str
    text: str
    cells: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Sheet:
    """Everything about one matrix. `counts` are of results: each cell has one for each machine that ran it."""

    matrix: str
    cells: int
    results: int
    machines: tuple[str, ...]
    counts: tuple[tuple[Verdict, int], ...]
    pivot: Pivot | None
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    troubles: tuple[Trouble, ...]
    findings: tuple[Remark, ...]
    dropped: tuple[Remark, ...]
    locks: tuple[Remark, ...]
    repairs: tuple[Remark, ...] = ()
    drawing: tuple[Remark, ...] = ()
    attempts: tuple[Attempt, ...] = ()
    left_out: int = 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Report:
    """What a presentation needs: a sheet per matrix, and what they share."""

    generated: str
    sheets: tuple[Sheet, ...]
    machines: tuple[tuple[str, tuple[tuple[str, str], ...]], ...]
    stale: tuple[str, ...]
