"""Define the tables that are made from a report document: plain data, ready to be shown in any form."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

from msgspec import Struct

from harness.model import Role, Verdict
from harness.model.report_types import PicturesEntry
from harness.reports.tables.family_tables import Change, FamilyTable


class Row(Struct, frozen=True, kw_only=True):
    """One cell in the list: on one machine, or on all machines with the same result.

    `versions` are in the order of the sheet's columns, as installed. `why` is the decisive line, or what a working cell
    could not show; `hidden_by` names what hid it; `expected` is a sentence on the expectation, if one is needed;
    `repaired` are releases that were patched for this cell; `known` is the signature of the cause, if there is one.
    `passed` of `tried` tasks passed, `suite` says the same of the package's own tests; `frames` are a picture of each
    task by its name.
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
    role: Role = Role.MAIN
    passed: int = 0
    tried: int = 0
    suite: str = ""
    lock: str = ""
    frames: tuple[tuple[str, str], ...] = ()
    cause: str = ""
    remedy: str = ""
    proven: bool = False
    known: str = ""


class Square(Struct, frozen=True, kw_only=True):
    """The main cells of one machine and one verdict where two axis values meet.

    `passed` of `tried` tasks passed in each of these cells, by the `pythons` named; `tried` is 0 where no task was
    reached. `where` has the other axis values by which they differ from those of another verdict in the same square,
    `phase` what failed although every task passed. `patched` releases are not those of the index. `fixed` says that a
    change or a side condition makes one of them work, `varies` that some side condition does not work, `uneven` that
    the cells did not try the same tasks, `doubted` that a known silent defect was not excluded.
    """

    machine: str
    verdict: Verdict
    passed: int = 0
    tried: int = 0
    pythons: tuple[str, ...] = ()
    where: tuple[str, ...] = ()
    phase: str = ""
    patched: bool = False
    fixed: bool = False
    varies: bool = False
    uneven: bool = False
    doubted: bool = False


@dataclass(frozen=True, kw_only=True)
class Pivot:
    """The main cells of a matrix over two of its axes.

    A square holds, for each machine in their order, one entry per verdict, the worst first; none where nothing was
    tried.
    """

    down: str
    across: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    squares: tuple[tuple[tuple[Square, ...], ...], ...]

    @cached_property
    def parts(self) -> tuple[Square, ...]:
        """Return the entries of all squares."""
        return tuple(one for squares in self.squares for square in squares for one in square)

    @cached_property
    def machines(self) -> list[str]:
        """Return the machines in all squares, sorted."""
        return sorted({one.machine for one in self.parts})

    @cached_property
    def pythons(self) -> tuple[str, ...]:
        """Return the Pythons in all squares, in the order in which they appear."""
        return tuple(dict.fromkeys(python for one in self.parts for python in one.pythons))


class Task(Struct, frozen=True, kw_only=True):
    """One environment that was tried: the phases asked for, and how many of the main cells that ran it passed."""

    name: str
    env: str
    api: str
    phases: tuple[str, ...]
    passed: int
    tried: int


class Cause(Struct, frozen=True, kw_only=True):
    """A known failure that fits cells, its remedy in words, and whether a machine can apply that.

    `proofs` are the cells that the remedy cured, each with its lock.
    """

    signature: str
    cause: str
    remedy: str
    applicable: bool
    proofs: tuple[tuple[str, str], ...]
    references: tuple[str, ...]


class Effect(StrEnum):
    """The effect of a change on a cell."""

    CURES = "fixes it"
    PARTLY = "fixes part of it"
    UNCOVERS = "another failure behind it"
    NOTHING = "no difference"
    BREAKS = "breaks"
    UNTOLD = "not known"


class Attempt(Struct, frozen=True, kw_only=True):
    """A change tried on a cell: the result before and after in words, and the effect."""

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


class Explanation(Struct, frozen=True, kw_only=True):
    """A reason why cells are not green, with all the cells that share it."""

    verdict: Verdict
    phase: str
    decisive: str
    hidden_by: tuple[str, ...]
    expected: str
    link: str
    cells: tuple[str, ...]
    causes: tuple[Cause, ...] = ()


class Trouble(Struct, frozen=True, kw_only=True):
    """One cause and all the cells that have it; `known` is its signature, empty where none fits.

    `where` says which `cells` these are, as values of axes. The `cause` of an unknown one is what the matrix says of
    it, if anything. `proofs` are changed cells that work, by which the remedy is proven for `proven` of the cells;
    `neighbour` is a cell that works and differs from one of these only in what the remedy changes, `together` one that
    differs in more.
    `also` are known failures that fit some of the cells, too, after the deepest one. `commands` apply the fix, if
    commands do; `example` is the id of one of the cells.
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
    neighbour: str = ""
    together: str = ""
    also: tuple[Cause, ...] = ()
    commands: tuple[str, ...] = ()
    example: str = ""


EVERY = "every combination"
"""The words for a picture that all combinations share."""


class Frame(Struct, frozen=True, kw_only=True):
    """A picture of a task, and in words the combinations that look so.

    `misleads` are the checks by which it contradicts what it should show, `issue` is the known issue behind that.
    """

    path: str
    where: str
    misleads: str = ""
    issue: str = ""


class FrameRow(Struct, frozen=True, kw_only=True):
    """The distinct first pictures of a task, those of older releases first."""

    task: str
    env: str
    frames: tuple[Frame, ...]


class Remark(Struct, frozen=True, kw_only=True):
    """The same text about one or more cells: a finding, or the reason why combinations were left out.

    `where` says in words which cells, `count` how many combinations, `kind` what sort of finding it is.
    """

    about: str
    text: str
    cells: tuple[str, ...]
    where: str = ""
    count: int = 0
    kind: str = ""


class SuiteChange(Struct, frozen=True, kw_only=True):
    """The package's own tests in one cell beside those of a neighbouring cell.

    `fails` are tests that fail here and not there, `passes` those that fail there and not here, `known` is the known
    issue for which they could not run.
    """

    cell: str
    tests: str
    decisive: str
    known: str = ""
    neighbour: str = ""
    fails: tuple[str, ...] = ()
    passes: tuple[str, ...] = ()


class Sheet(Struct, frozen=True, kw_only=True):
    """Everything about one matrix. `counts` are of results: each cell has one for each machine that ran it.

    `main` is how many of the cells are main ones, `works` how many of those are plainly good wherever they ran,
    `doubted` how many raise nothing and have a silent known issue left open, `roles` how
    many are of another role.
    """

    matrix: str
    title: str
    main: int
    works: int
    doubted: int
    roles: tuple[tuple[Role, int], ...]
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
    tasks: tuple[Task, ...] = ()
    suites: tuple[SuiteChange, ...] = ()
    repairs: tuple[Remark, ...] = ()
    drawing: tuple[Remark, ...] = ()
    attempts: tuple[Attempt, ...] = ()
    families: tuple[FamilyTable, ...] = ()
    behaviour: tuple[Change, ...] = ()
    pictures: tuple[PicturesEntry, ...] = ()
    consequences: tuple[tuple[str, str], ...] = ()
    left_out: int = 0
    frames: tuple[FrameRow, ...] = ()


class Report(Struct, frozen=True, kw_only=True):
    """A whole report, ready to be presented: a sheet per matrix, and what they share.

    `measured` are the first and the last day of measuring, `platforms` the machines in a few words each, `uncovered`
    the platforms that none of them is.
    """

    generated: str
    sheets: tuple[Sheet, ...]
    machines: tuple[tuple[str, tuple[tuple[str, str], ...]], ...]
    stale: tuple[str, ...]
    measured: tuple[str, str] | None = None
    platforms: tuple[str, ...] = ()
    uncovered: tuple[str, ...] = ()
