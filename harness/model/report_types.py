"""Define the types of the report document (`report.json`).

The document's keys are a contract: some may be added, none renamed. Paths are relative to the document.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import msgspec

from harness.model import Brought, Control, Dropped, Expectation, Level, Outcome, Phase, Role, Verdict
from harness.model.cellid import CellId
from harness.standalone.failures import silent

SEVERITY = (
    Verdict.UNRESOLVABLE,
    Verdict.UNINSTALLABLE,
    Verdict.IMPORT_FAILS,
    Verdict.BROKEN,
    Verdict.MISLEADS,
    Verdict.PARTIAL,
    Verdict.INCONCLUSIVE,
    Verdict.UNAVAILABLE,
    Verdict.NOT_RUN,
    Verdict.WORKS,
)
"""Worst first: what says something against the packages (the earlier it stops, the worse), then what says nothing."""

REPAIR = "repair"
"""The name of the change that `repair` and `run --repair` found."""

UNTOLD = frozenset({Verdict.INCONCLUSIVE, Verdict.UNAVAILABLE, Verdict.NOT_RUN})
"""Verdicts that say nothing about the packages; nothing can be expected or unexpected about them."""

SYMBOLS: Mapping[Verdict, str] = {
    Verdict.WORKS: "✔",
    Verdict.PARTIAL: "◐",
    Verdict.MISLEADS: "≠",
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
    """Return a verdict or an outcome in readable words: `import fails`."""
    return name.replace("_", " ")


def format_count(count: int, noun: str) -> str:
    """Return a count with its noun: `1 cell`, `2 cells`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def format_duration(seconds: float) -> str:
    """Return a duration in the unit that says enough: `40 s`, `12 min`, `3 h 05 min`."""
    minutes = round(seconds / 60)
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


def first_few(names: Sequence[str], most: int) -> str:
    """Return the names, `most` of them at most, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


class FindingEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A finding, which does not stop a user's loop; `cases` are those in which it was seen."""

    check: str
    level: Level
    text: str
    cases: tuple[str, ...] = ()


class BehaviourEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The behaviour of a case: its family among the cells of the report, and how it compares with a neighbour.

    `bank` is the SHA-256 of the states that it was stepped from, `reference` the cell before it on an axis. `classes`
    are those of `sum`, `dynamics`, `observation`, `reward`, `termination` and `start`; see `physics/comparison.py`.
    `boundary` says what differs from the reference. `coverage` is the share of the states in which the simulator's
    solver had a row of a contact, a joint limit, an equality: what no state exercises was not compared.
    """

    bank: str
    family: str
    method: Literal["states", "seeded"] = "states"
    reference: str | None = None
    classes: dict[str, str] = {}
    boundary: str | None = None
    coverage: dict[Literal["contact", "limit", "equality"], float] | msgspec.UnsetType = msgspec.UNSET


class BoundaryEntry(msgspec.Struct, frozen=True, kw_only=True):
    """Two neighbouring releases between which a case behaves otherwise.

    `moved` are other packages whose versions differ between the two cells: where there are any, the change is not
    separated from them. `between` are releases between the two that were not measured. `largest` and `median` are the
    relative differences of `output`, `share` is the share of the states that differ. `changelog` is what the
    changelog of the package says of it.
    """

    matrix: str
    case: str
    env: str | None
    axis: str
    before: str
    after: str
    cells: tuple[str, str]
    kind: str
    start: str
    stage: str | None
    output: str | None
    largest: float
    median: float
    share: float
    moved: dict[str, tuple[str | None, str | None]]
    between: tuple[str, ...]
    text: str
    changelog: str = ""


class PictureDifferenceEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The difference of the pictures of one environment between two releases; see `physics/pixels.py`.

    `share` is the share of a picture that looks different, at the state where that is most, `median` at the middle one,
    `moved` are the parts of its making that differ, `compared` those that are known of both.
    """

    case: str
    env: str | None
    kind: str
    share: float
    median: float
    distance: float
    moved: tuple[str, ...]
    compared: tuple[str, ...]


class PictureBoundaryEntry(msgspec.Struct, frozen=True, kw_only=True):
    """Two neighbouring releases whose pictures differ, with each environment that differs, of so many `tasks`.

    `moved` are other packages whose versions differ between the two cells: where there are any, the change is not
    separated from them.
    """

    before: str
    after: str
    cells: tuple[str, str]
    tasks: int
    moved: dict[str, tuple[str | None, str | None]]
    differences: tuple[PictureDifferenceEntry, ...]


class PicturesEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The pictures of a matrix along one axis, all other axes as they stand in `where`.

    `method` is `states` where states of a bank were drawn, `start` for the picture after a seeded reset. `letters` has,
    for each environment, one for each of `releases`: see `physics/pixels.py`; `-` where nothing was drawn.
    """

    matrix: str
    axis: str
    where: dict[str, str]
    method: Literal["states", "start"]
    releases: tuple[str, ...]
    letters: dict[str, tuple[str, ...]]
    boundaries: tuple[PictureBoundaryEntry, ...]


class ConsequenceEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The effect of the change from one release to the next on a policy that played the same seeds with both.

    `effect` is `worse`, `better`, `equal within 5 points` or `cannot tell`. `values` are the share of `episodes` that
    succeed, or the mean return, before and after. `difference`, its `interval` of 95 % and `least`, the smallest
    difference that would be seen with a power of 80 %, are in points: of success, or hundredths of what the policy
    gained over random actions when it was made. `moved_starts` counts episodes that start elsewhere under their seed,
    `identical` is whether all are the same to the bit, `repeats` whether the first was the same when played again.
    `moved` are the packages whose versions differ between the two cells.
    """

    matrix: str
    case: str
    axis: str
    before: str
    after: str
    cells: tuple[str, str]
    effect: str
    measure: Literal["success", "return"]
    episodes: int
    values: tuple[float, float]
    difference: float
    interval: tuple[float, float]
    least: float
    moved_starts: int
    identical: bool
    repeats: bool
    moved: dict[str, tuple[str | None, str | None]]
    text: str


class CaseEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One environment tried. `reasons` and `masked` say per check why it ended so, and what hid that.

    `drawn` is the OpenGL context that drew its frames: api (egl, osmesa, glx), vendor, renderer, version, device.
    `told` is what a check measured that its page shows.

    `misleads` are the checks (`vocabulary.MISLEADING`) which showed that it contradicts its own specification without
    an error; such a case is not passed. `unverified` are the silent known issues, as `silent:ID`, that fit it and that
    no check has shown or refuted. `exercised` are the packages whose code it really ran, where its checks noted them.
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
    misleads: tuple[str, ...] = ()
    unverified: tuple[str, ...] = ()
    exercised: tuple[str, ...] | msgspec.UnsetType = msgspec.UNSET
    behaviour: BehaviourEntry | msgspec.UnsetType = msgspec.UNSET


class SubjectEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The package under test: the state of its source, and the wheel that was measured, if one was made.

    `changed` is whether the files differed from the commit.
    """

    name: str | None
    version: str | None
    commit: str | None
    changed: bool
    wheel_sha256: str | None
    extras: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()


class EditEntry(msgspec.Struct, frozen=True, kw_only=True, rename={"old": "from", "new": "to"}):
    """One line of a wheel's metadata that was changed."""

    field: str
    old: str
    new: str


class RepairEntry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The changes of a repaired release, enough for anybody to make the same wheel, from its wheel or its sdist."""

    package: str
    version: str
    edits: tuple[EditEntry, ...]
    reason: str
    link: str | None
    wheel_from_sha256: str | msgspec.UnsetType = msgspec.UNSET
    sdist_sha256: str | msgspec.UnsetType = msgspec.UNSET
    wheel_sha256: str
    build: tuple[str, ...]


class SuiteEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The subject's own tests in this cell. `tests` counts them by how they ended.

    `failed` names those that failed or raised, at most a thousand. A suite whose environment cannot be made is
    `not_reached`: `decisive` and `diagnoses` say why, and the cell keeps the verdict of its cases.
    """

    outcome: Outcome
    tests: dict[str, int]
    decisive: str | None
    evidence: str | None
    failed: tuple[str, ...] | msgspec.UnsetType = msgspec.UNSET
    diagnoses: tuple[DiagnosisEntry, ...] | msgspec.UnsetType = msgspec.UNSET

    @property
    def total(self) -> int:
        """Return the number of tests that were collected."""
        return sum(self.tests.values())

    @property
    def not_run(self) -> bool:
        """Return whether the tests were asked for and could not be run."""
        return self.outcome is Outcome.NOT_REACHED and self.decisive is not None


class DiagnosisEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A known cause that fits the evidence: `seen` is the line that shows it.

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

    @property
    def name(self) -> str:
        """Return the id of the known failure."""
        return self.signature


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

    `id` is such as `quickstart/py3.11_gymnasium-1.2.3_mujoco-3.3.7`: equal for equal questions only.

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
    repairs: tuple[RepairEntry, ...]
    findings: tuple[FindingEntry, ...]
    phases: dict[Phase, Outcome]
    cases: tuple[CaseEntry, ...]
    decisive: str | None
    diagnoses: tuple[DiagnosisEntry, ...]
    evidence: str | None
    phase: Phase | None = None
    expectation: Expectation | None = None
    requirements: tuple[str, ...] = ()
    asked: str = ""
    subject: SubjectEntry | None = None
    brought: tuple[Brought, ...] | msgspec.UnsetType = msgspec.UNSET
    empty: tuple[str, ...] | msgspec.UnsetType = msgspec.UNSET
    suite: SuiteEntry | None = None
    controls: dict[str, Control] | msgspec.UnsetType = msgspec.UNSET
    base: str | None = None
    change: ChangeEntry | None = None
    role: Role = Role.MAIN

    @property
    def label(self) -> str:
        """Return the part of the id after the matrix name."""
        return CellId.parse(self.id).label

    @property
    def good(self) -> bool:
        """Return whether the cell works, and no silent known issue is left open in it."""
        return silent.plainly_good(self.verdict, self.unverified)

    @property
    def doubts(self) -> list[str]:
        """Return the ids of the silent known issues that fit the cell and were neither shown nor refuted."""
        return silent.silent_ids(self.unverified)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return the lines that say why the cell and its checks ended as they did."""
        return (self.decisive or "", *(line for case in self.cases for line in case.reasons.values()))

    @property
    def observed(self) -> None:
        """Return the observation behind the line that says why: a document has the line alone."""


class MatrixEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The details of a matrix that tables need: its axes in order, and the packages whose versions are shown.

    `snapshot` is its cutoff, if it names one, `pivot` the axes of the small table, `title` the heading of its report.
    """

    axes: tuple[str, ...]
    shown: tuple[str, ...] = ()
    snapshot: str | None = None
    pivot: tuple[str, str] | None = None
    title: str | None = None


class Document(msgspec.Struct, frozen=True, kw_only=True):
    """A whole report. `probes` are hashes of the in-cell files that it was measured with."""

    schema: Literal[1] = 1
    generated: str
    machines: dict[str, dict[str, Any]]
    cells: tuple[CellEntry, ...]
    dropped: tuple[Dropped, ...]
    matrices: dict[str, MatrixEntry] = {}
    stale: tuple[str, ...] = ()
    probes: dict[str, str] = {}
    boundaries: tuple[BoundaryEntry, ...] | msgspec.UnsetType = msgspec.UNSET
    pictures: tuple[PicturesEntry, ...] | msgspec.UnsetType = msgspec.UNSET
    consequences: tuple[ConsequenceEntry, ...] | msgspec.UnsetType = msgspec.UNSET
