"""Define the values that every other module uses: frozen data and enums, no I/O.

Instants are ISO 8601 strings in UTC (`2026-11-20T23:59:59Z`), seconds are floats of wall-clock time, versions are
normalised (PEP 440), package names are normalised (PEP 503).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from msgspec import Meta, Struct, structs
from msgspec.structs import asdict

from harness.model.cellid import CellId

# To mypy a checked string is a string: only what is read from a file is checked.
if TYPE_CHECKING:
    Instant = str
    PackageName = str
    PackageSelector = str
    Pattern = str
    PythonVersion = str
    Requirement = str
    Variables = Mapping[str, str]
else:
    from harness.model.vocabulary import (
        Instant,
        PackageName,
        PackageSelector,
        Pattern,
        PythonVersion,
        Requirement,
        Variables,
    )


V = TypeVar("V")


def replace(value: V, **changes: Any) -> V:
    """Return a copy of a value, a struct or a dataclass, with other fields."""
    # A struct knows no `dataclasses.replace`, and a dataclass no `structs.replace`.
    copied: Any = value
    changed: V = (structs.replace if isinstance(value, Struct) else dataclasses.replace)(copied, **changes)
    return changed


class Phase(StrEnum):
    """The phases of a cell, in order; a failed phase leaves those that need it `not_reached`."""

    RESOLVE = "resolve"
    INSTALL = "install"
    IMPORT = "import"
    SINGLE = "single"
    VECTOR = "vector"
    RENDER = "render"
    BEHAVE = "behave"
    INTEROP = "interop"
    SUITE = "suite"


CELL_PHASES = (Phase.RESOLVE, Phase.INSTALL, Phase.IMPORT, Phase.SINGLE, Phase.VECTOR, Phase.RENDER)
"""Phases that every cell reports, always present in the document."""

CASE_PHASES = (Phase.IMPORT, Phase.SINGLE, Phase.VECTOR, Phase.RENDER, Phase.BEHAVE, Phase.INTEROP)
"""Phases that a probe runs, in this order; of the last one only what a case asks for by name."""


class Outcome(StrEnum):
    """The result of a check or a phase, worst first: a cell's phase has the worst outcome of its cases."""

    FAILED = "failed"
    CRASHED = "crashed"
    TIMED_OUT = "timed_out"
    FLAKY = "flaky"
    INFRA = "infra"
    UNAVAILABLE = "unavailable"
    NOT_REACHED = "not_reached"
    PASSED = "passed"
    SKIPPED = "skipped"


RANK = {outcome: place for place, outcome in enumerate(Outcome)}
"""The worst is 0."""


def worst(outcomes: Iterable[Outcome]) -> Outcome:
    """Return the first in the order of `Outcome`, which is worst first; `skipped` of nothing."""
    return min(outcomes, key=RANK.__getitem__, default=Outcome.SKIPPED)


FAILING = frozenset({Outcome.FAILED, Outcome.CRASHED, Outcome.TIMED_OUT, Outcome.FLAKY})


class Verdict(StrEnum):
    """The verdict on a cell. `judging.assess` computes it from outcomes; the first row of its table that fits wins."""

    NOT_RUN = "not_run"
    INCONCLUSIVE = "inconclusive"
    UNAVAILABLE = "unavailable"
    UNRESOLVABLE = "unresolvable"
    UNINSTALLABLE = "uninstallable"
    IMPORT_FAILS = "import_fails"
    MISLEADS = "misleads"
    WORKS = "works"
    PARTIAL = "partial"
    BROKEN = "broken"


class Role(StrEnum):
    """The purpose of a cell; squares of tables hold main cells alone."""

    MAIN = "main"
    VARIANT = "variant"
    WHAT_IF = "what-if"
    REPAIR = "repair"


class Level(StrEnum):
    """The weight of a finding; only a warning can be made to fail by `required`."""

    NOTE = "note"
    WARNING = "warning"


@dataclass(frozen=True, kw_only=True, slots=True)
class Observation:
    """An observation of a check in the cell, as a code and data; `model.words` has the sentence.

    `at` is the step at which it was seen, where that is known; `got` and `promised` are such as shapes.
    """

    check: str
    code: str
    at: int | None = None
    got: Any = field(default=None, hash=False)
    promised: Any = field(default=None, hash=False)
    data: Mapping[str, Any] = field(default_factory=dict, hash=False)


@dataclass(frozen=True, kw_only=True, slots=True)
class Finding:
    """A finding, which does not stop a user's loop: `observed` is the cell's own account of it, `text` the words.

    Findings of one text are equal, at whatever step they were made.
    """

    check: str
    level: Level
    text: str
    observed: Observation | None = field(default=None, compare=False)


# --- what is asked for -----------------------------------------------------------------------------------------


class Case(Struct, frozen=True, kw_only=True):
    """One environment tried in a cell.

    `checks` are names like `vector.sync`, the part before the dot being their phase. `required` names finding
    checks whose warnings turn the case red. `timeouts` maps a phase to seconds per check, `imports` are module
    names imported first. `packages` are distributions asked for: without an environment their modules are imported,
    else those of the ones that speak the API, where the environment is not registered without them (`providers`, which
    the host fills in after the install; `beside` are modules of other packages that speak it). `picture` has two
    colours of a right picture, `above` and `below`. `bank` is the SHA-256 of the states that it is stepped from.
    `policy` is what plays it; see `matrix/policies.py`.
    """

    id: str
    env: str | None
    api: str
    kwargs: Mapping[str, Any] = {}
    checks: tuple[str, ...] = ()
    required: tuple[str, ...] = ()
    imports: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()
    providers: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    timeouts: Mapping[Phase, float] = {}
    picture: Mapping[str, str] | None = None
    bank: str | None = None
    policy: Mapping[str, Any] | None = None
    steps: int = 100
    seed: int = 7
    memory_mb: int = 6000


class Expectation(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The expected result of a cell.

    `code` and `data` stand in the place of `match` where the decisive line is a sentence of ours; see `model.words`.
    """

    verdict: Verdict
    reason: str
    phase: Annotated[Phase | None, Meta(description="the first phase that fails")] = None
    match: Annotated[Pattern | None, Meta(description="regular expression on the decisive line")] = None
    code: Annotated[str | None, Meta(description="what a check observes, instead of a match")] = None
    data: Annotated[dict[str, Any], Meta(description="of it: expressions for whole values, or tables of them")] = {}
    signature: Annotated[str | None, Meta(description="a known failure that it is")] = None
    link: str | None = None
    until: Instant | None = None


class IndexSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The places that packages come from; without any, the user's own uv and pip settings apply."""

    default: str | None = None
    extra: tuple[str, ...] = ()
    find_links: tuple[str, ...] = ()
    no_index: bool = False


class Edit(Struct, frozen=True, kw_only=True):
    """A repair of metadata lines: those of `field` that begin with `old` begin with `new` afterwards."""

    field: str
    old: str
    new: str


class Repair(Struct, frozen=True, kw_only=True):
    """A release that no resolver accepts, made acceptable by editing lines of its wheel's metadata.

    `origin` and `wheel` are SHA-256: of the file that the index has, and of the wheel once repaired. An sdist is built
    here, with what `build` pins, by the Pythons that `python` says; of a wheel that is None. `uploaded` is the instant
    at which the index got the file.
    """

    name: str
    version: str
    uploaded: str
    origin: str
    wheel: str
    build: tuple[str, ...]
    python: str | None
    edits: tuple[Edit, ...]
    reason: str
    link: str


class Question(Struct, frozen=True, kw_only=True):
    """The inputs of a resolution, except the interpreter: equal questions on one interpreter have one lock.

    `snapshot` is the cutoff instant. `torch_backend` is uv's (`cpu`, `cu126`, ...); `cpu` is the default: a CPU build
    where one can be had. It is without meaning where no torch is in the resolution. `absent` are packages that may not
    be in the lock, `overlay` are repaired releases that it may hold.
    """

    requirements: tuple[str, ...]
    constraints: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    build_constraints: tuple[str, ...] = ()
    build_variables: Mapping[str, str] = {}
    only_binary: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    resolution: str = "highest"
    prerelease: str = "if-necessary-or-explicit"
    index: IndexSettings = IndexSettings()
    torch_backend: str = "cpu"
    snapshot: str | None = None
    overlay: tuple[Repair, ...] = ()


class Suite(Struct, frozen=True, kw_only=True):
    """The subject's own pytest suite: what its environment holds besides the cell's packages, and how it is run."""

    arguments: Annotated[tuple[str, ...], Meta(description="of pytest; default: what the project's settings say")] = ()
    requirements: Annotated[tuple[Requirement, ...], Meta(description="asked for besides; pytest always is")] = ()
    extras: Annotated[tuple[PackageName, ...], Meta(description="extras of the subject that its tests need")] = ()
    groups: Annotated[tuple[PackageName, ...], Meta(description="its dependency groups that its tests need")] = ()
    seconds: float = 1800.0
    memory_mb: Annotated[int, Meta(ge=64, description="of all its processes together")] = 6000


class Subject(Struct, frozen=True, kw_only=True):
    """The package under test as a cell takes it: put on top of the cell's packages, never in a lock.

    `source` is a folder, a wheel or a repository (`git+ADDRESS@REFERENCE`). Once it was looked at, `state` is a hash
    of all that its wheel depends on, `commit` where it stands, `changed` whether its files differ from that commit.
    """

    source: str
    extras: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()
    suite: Suite | None = None
    state: str | None = None
    commit: str | None = None
    changed: bool = False


class Bring(Struct, frozen=True, kw_only=True):
    """Something that the user has and no index does, such as a vendor's archive or a research project's checkout.

    `variable` of the user's names it (else `source` does): a folder, an archive or `git+ADDRESS@REFERENCE`; in the cell
    it names a copy. `python_path` are folders of it that modules are imported from; those that it does not have are
    passed over. `say` is what to do where there is none.
    """

    name: str
    variable: str
    say: str
    source: str | None = None
    python_path: tuple[str, ...] = ()


class Brought(Struct, frozen=True, kw_only=True):
    """Software that the user supplied, in the state in which a cell was measured: `mark` is a hash of its content."""

    name: str
    mark: str
    commit: str | None = None
    changed: bool = False


class Change(Struct, frozen=True, kw_only=True):
    """A change to a cell: the fix of a known issue, or a change that a matrix tries by a name."""

    requirements: Annotated[
        tuple[Requirement, ...], Meta(description="asked for instead of what was asked for of the same package")
    ] = ()
    constraints: Annotated[
        tuple[Requirement, ...], Meta(description="version limits for everything that is installed")
    ] = ()
    overrides: Annotated[
        tuple[Requirement, ...], Meta(description="replace requirements of the packages themselves")
    ] = ()
    build_constraints: Annotated[tuple[Requirement, ...], Meta(description="version limits for build tools")] = ()
    build_variables: Annotated[Variables, Meta(description="environment variables of builds")] = {}
    only_binary: Annotated[
        tuple[PackageSelector, ...], Meta(description="packages never built from source, `:all:` for every one")
    ] = ()
    overlay: Annotated[tuple[PackageName, ...], Meta(description="packages whose releases are repaired")] = ()
    uninstall: Annotated[tuple[PackageName, ...], Meta(description="packages that may not be there")] = ()
    environment: Annotated[Variables, Meta(description="environment variables; an empty one is unset")] = {}
    python: PythonVersion | None = None
    as_of: Annotated[Instant | None, Meta(description="everything resolved as the index stood then")] = None

    def __bool__(self) -> bool:
        """Return whether it changes anything."""
        return bool(self.plain)

    @property
    def plain(self) -> dict[str, Any]:
        """Return the change in the form of documents: only what it does."""
        values = asdict(self).items()
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values if value}


class Tried(Struct, frozen=True, kw_only=True):
    """The change that makes a cell of another one, and why it is tried; `advice` is what people say helps.

    `also` says in words what it changes besides. Where it is tried for `proving` a remedy, nothing is expected of it.
    """

    name: str
    reason: str
    change: Change
    also: tuple[str, ...] = ()
    advice: bool = False
    link: str | None = None
    proving: bool = False


class Cell(Struct, frozen=True, kw_only=True):
    """One combination, ready to run. `python` is as asked for (`3.11`, `3.11.7`, `host`).

    `system` are packages of Debian's that it needs. `empty` are variables that are set, to the empty string,
    `python_path` folders of its HOME that modules are imported from, `bring` folders that the user brings. `asked`
    are packages of which each has to be exercised before the cell works. Where a change is `tried`, `base` is the id of
    the cell without it, whose axes it has.
    """

    id: str
    matrix: str
    axes: Mapping[str, str]
    python: str
    question: Question
    environment: Mapping[str, str]
    cases: tuple[Case, ...]
    needs: tuple[str, ...] = ()
    system: tuple[str, ...] = ()
    files: Mapping[str, str] = {}
    empty: tuple[str, ...] = ()
    python_path: tuple[str, ...] = ()
    bring: tuple[Bring, ...] = ()
    expect: Expectation | None = None
    subject: Subject | None = None
    asked: tuple[str, ...] = ()
    base: str | None = None
    tried: Tried | None = None

    @property
    def label(self) -> str:
        """Return the part of the id after the matrix name."""
        return CellId.parse(self.id).label


class Dropped(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Combinations that are not run, and why: `id` is that of one, or a pattern that stands for `count` of them."""

    id: str
    reason: str
    count: int = 1


class Plan(Struct, frozen=True, kw_only=True):
    """Everything a matrix stands for: cells to run, combinations dropped, expectations that match no cell.

    `snapshot` is the cutoff that the matrix itself, or its expansion, names, `pivot` the axes of its small table,
    `title` the heading of its report, `page` the text of the template of its page. `banks` maps the SHA-256 of each
    bank of states to its file. `variants` are the ids of cells that
    the matrix names as side conditions.
    """

    matrix: str
    cells: tuple[Cell, ...]
    dropped: tuple[Dropped, ...] = ()
    stale: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()
    shown: tuple[str, ...] = ()
    snapshot: str | None = None
    pivot: tuple[str, str] | None = None
    title: str = ""
    page: str | None = None
    variants: frozenset[str] = frozenset()
    banks: Mapping[str, str] = {}


# --- what was found --------------------------------------------------------------------------------------------


class Interpreter(Struct, frozen=True, kw_only=True):
    """A Python that exists here. `identity` changes whenever another build of Python stands at `path`."""

    path: str
    version: str
    implementation: str
    identity: str

    @property
    def minor(self) -> str:
        """Return the minor version: `3.11` for `3.11.7`."""
        return ".".join(self.version.split(".")[:2])


class Artifact(Struct, frozen=True, kw_only=True):
    """One file of a release: a wheel, or an sdist to be built. `source` is an address or a path, never committed."""

    filename: str
    sha256: str
    source: str
    size: int | None = None
    uploaded: str | None = None

    @property
    def is_wheel(self) -> bool:
        """Return whether it can be installed as it is."""
        return self.filename.endswith(".whl")


class Pin(Struct, frozen=True, kw_only=True):
    """One package of a lock: the artifact that this interpreter takes, and the hashes of all that the lock allows."""

    name: str
    version: str
    artifact: Artifact
    hashes: tuple[str, ...]


class Lock(Struct, frozen=True, kw_only=True):
    """A full resolution, pinned and hashed; `requirements` is its committed form, `sha256` is of that text.

    `escaped` names packages from find-links or an index without upload times, to which the cutoff did not apply.
    """

    pins: tuple[Pin, ...]
    requirements: str
    sha256: str
    instant: str
    escaped: tuple[str, ...] = ()

    @property
    def versions(self) -> dict[str, str]:
        """Return the versions by package name."""
        return {pin.name: pin.version for pin in self.pins}


class Step(Struct, frozen=True, kw_only=True):
    """The result of a step on the host (resolve, build, install) that did not succeed, or has something to report.

    `decisive` is the one line that says why; `log` is a path below the state folder. `conditions` marks the system
    that a build failed on: with other programs and libraries it may succeed.
    """

    phase: Phase
    outcome: Outcome
    seconds: float = 0.0
    decisive: str | None = None
    log: str | None = None
    findings: tuple[Finding, ...] = ()
    conditions: str | None = None
    reused: bool = False


class CheckRecord(Struct, frozen=True, kw_only=True):
    """One check of one case. `facts` are what it measured (shapes, digests, start method).

    `observed` is what the cell said of its decisive line, where that is our own and no library's.
    """

    check: str
    outcome: Outcome
    seconds: float = 0.0
    decisive: str | None = None
    masked_by: str | None = None
    facts: Mapping[str, Any] = {}
    observed: Observation | None = None


class PhaseRecord(Struct, frozen=True, kw_only=True):
    """One phase of one case, as stored and reused. `frames` and `evidence` are paths below the state folder.

    `peak_mb` is the most memory that the processes of its probe held together. `runs` are the probe runs that a suite
    was judged by.
    """

    phase: Phase
    outcome: Outcome
    seconds: float = 0.0
    decisive: str | None = None
    checks: tuple[CheckRecord, ...] = ()
    findings: tuple[Finding, ...] = ()
    frames: tuple[str, ...] = ()
    evidence: str | None = None
    attempts: int = 1
    measured: str | None = None
    peak_mb: int | None = None
    runs: tuple[str, ...] = ()
    reused: bool = False


class CaseRecord(Struct, frozen=True, kw_only=True):
    """One case of a cell, with a record for each phase of `CASE_PHASES`; `runs` are the probe runs it was judged by."""

    case: str
    env: str | None
    api: str
    required: tuple[str, ...]
    phases: tuple[PhaseRecord, ...]
    runs: tuple[str, ...] = ()


class Tested(Struct, frozen=True, kw_only=True):
    """The wheel of the subject that a cell was measured with; equal files have equal `content`, whatever the wheel."""

    name: str
    version: str
    sha256: str
    content: str


class Control(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The result of an adapter's known-good combination on the same machine: failed checks with their lines.

    `untold` is why it could not be run: then nothing is known of the adapter, and failures stand as they were seen.
    """

    control: str
    failed: dict[str, str] = {}
    untold: str | None = None


class ControlRecord(Control, frozen=True, kw_only=True):
    """A control as it is stored, with the checks that passed."""

    passed: tuple[str, ...] = ()


class CellRecord(Struct, frozen=True, kw_only=True):
    """All that is known of one cell on one machine; the verdict is computed from it, never stored alone.

    `resolve` and `install` are None when nothing of the cell was run. `suite` is there where the cell's subject has one
    and the cell came that far. `mark` stands for all that the outcomes depend on, where they may be reused as a whole.
    `controls` are those of the adapters, by API, with which something failed after the install. `repairs` are the
    repaired releases in its lock.
    """

    cell: Cell
    machine: str
    python: str | None = None
    supplied: Mapping[str, str] = {}
    installed: Mapping[str, str] | None = None
    lock: str | None = None
    lock_sha256: str | None = None
    key: str | None = None
    resolve: Step | None = None
    install: Step | None = None
    repairs: tuple[Repair, ...] = ()
    unavailable: str | None = None
    cases: tuple[CaseRecord, ...] = ()
    subject: Tested | None = None
    brought: tuple[Brought, ...] = ()
    suite: PhaseRecord | None = None
    findings: tuple[Finding, ...] = ()
    controls: Mapping[str, ControlRecord] = {}
    measured: str | None = None
    mark: str | None = None
    reused: bool = False
    seconds: float = 0.0


# --- between the two worlds ------------------------------------------------------------------------------------


class ProbeRequest(Struct, frozen=True, kw_only=True):
    """The work of one in-cell process: some checks of one case.

    `folder` is where the reply (`reply.jsonl`), worker files and arrays go; `limits` maps a check to its seconds.
    `followers` maps a check to those that follow it in the same process where it passes.
    """

    case: Case
    checks: tuple[str, ...]
    folder: str
    limits: Mapping[str, float]
    followers: Mapping[str, tuple[str, ...]] = {}
    num_envs: int = 2
    vector_steps: int = 20


class Raised(Struct, frozen=True, kw_only=True):
    """An exception as the cell reported it: `blame` is `library`, or `harness` when our own code raised it."""

    type: str
    message: str
    traceback: str
    blame: str


class WorkerRecord(Struct, frozen=True, kw_only=True):
    """The end of one worker process of a vector environment: its own first exception, signal or exit code.

    `reached` is the last of `start`, `constructor`, `constructed`, `reset`, `step` that it came to. `exit_code` is as
    multiprocessing gives it (minus the signal), None for one that had not ended by itself.
    """

    pid: int
    raised: Raised | None = None
    exit_code: int | None = None
    stacks: str | None = None
    reached: str | None = None
    observed: Observation | None = None


class CheckReply(Struct, frozen=True, kw_only=True):
    """One check as the cell reported it; `outcome` None means it was started and never ended.

    `observed` is why it was skipped, or failed without an exception of a library; `reason` or `raised` has the words.
    """

    check: str
    outcome: Outcome | None
    seconds: float = 0.0
    raised: Raised | None = None
    reason: str | None = None
    workers: tuple[WorkerRecord, ...] = ()
    facts: Mapping[str, Any] = {}
    observed: Observation | None = None


class ProbeReply(Struct, frozen=True, kw_only=True):
    """A whole reply, read as hostile data. `complete` is whether the last line was there.

    `during` names the check that ran, or had ended last, when each of the findings was made.
    """

    checks: tuple[CheckReply, ...]
    findings: tuple[Finding, ...]
    frames: tuple[tuple[str, str], ...]
    facts: Mapping[str, Any]
    modules: tuple[str, ...]
    complete: bool
    problems: tuple[str, ...] = ()
    during: tuple[str | None, ...] = ()
