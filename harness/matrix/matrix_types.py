"""Define a matrix as its file has it: the typed shape of `matrices/NAME.toml`, checked while it is read.

The classes named `...Table` are tables of the file and, with their docstrings and descriptions, its JSON Schema.
`matrix_file.read` makes a `Matrix`, `plan.product.expand` multiplies it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal, Self

from msgspec import UNSET, Meta, Struct, UnsetType, field

from harness.matrix.strategy import FULL, Strategy
from harness.model import Expectation, IndexSettings, Suite, Verdict, cellid
from harness.model.vocabulary import (
    Api,
    Capability,
    Checked,
    CheckName,
    Colour,
    FindingName,
    InnerFolder,
    InnerPath,
    Instant,
    Kind,
    Label,
    ModuleName,
    PackageName,
    PackageSelector,
    PythonVersion,
    Requirement,
    Rule,
    SubjectNames,
    SystemPackage,
    TorchBackend,
    VariableName,
    Variables,
    When,
)


class Table(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the file; keys that it does not have are refused."""


class SourceTable(Table, frozen=True, kw_only=True):
    """A file whose text is read from beside the matrix file."""

    source: Annotated[InnerPath, Meta(description="path, relative to the folder of the matrix file")]


class Files(dict[str, str | SourceTable], metaclass=Checked):
    """Files by their path inside the cell's HOME: each is a text, or the place of a text."""

    reads: ClassVar[tuple[Any, ...]] = (dict[str, str | SourceTable],)

    @classmethod
    def parse(cls, plain: Any, convert: Callable[[Any, Any], Any]) -> dict[str, str | SourceTable]:
        """Return the files, or raise a ValueError about the first path that leaves HOME."""
        read = convert(plain, dict[str, str | SourceTable])
        return {InnerPath.canonical(path): content for path, content in read.items()}


class ConditionalTable(Table, frozen=True, kw_only=True):
    """A requirement that holds for some values of the axes only."""

    require: Requirement
    when: When = {}
    reason: str | None = None


class Constraint:
    """A requirement, or a table that adds `when`."""

    __slots__ = ("require", "when")
    reads: ClassVar[tuple[Any, ...]] = (Requirement, ConditionalTable)

    def __init__(self, require: str, when: When) -> None:
        self.require = str(require)
        self.when = when

    @classmethod
    def parse(cls, plain: Any, convert: Callable[[Any, Any], Any]) -> Self:
        """Return the constraint that either form stands for."""
        if isinstance(plain, dict):
            table = convert(plain, ConditionalTable)
            return cls(table.require, table.when)
        return cls(convert(plain, Requirement), {})


class BringTable(Table, frozen=True, kw_only=True):
    """Something that no index has: the user brings it, or the cells that need it are unavailable."""

    variable: Annotated[
        VariableName, Meta(description="the user's variable that names it: a folder, an archive, or git+ADDRESS@REF")
    ]
    say: Annotated[str, Meta(min_length=1, description="what to do if it is missing")]
    source: Annotated[str | None, Meta(description="where it is if the variable is not set")] = None
    python_path: Annotated[
        tuple[InnerFolder, ...], Meta(description="folders of it that modules are imported from; `.` is its top")
    ] = ()


CONDITIONAL = ("constraints", "overrides", "build_constraints")
"""Keys of a matrix whose requirements may have a `when`."""


class Changes(Table, frozen=True, kw_only=True):
    """The additions that the matrix makes to every cell, or one value of an axis to its cells."""

    requirements: Annotated[
        tuple[Requirement, ...], Meta(description="requirements in addition to the package axes")
    ] = ()
    constraints: Annotated[
        tuple[Constraint, ...], Meta(description="version limits for everything that is installed")
    ] = ()
    overrides: Annotated[
        tuple[Constraint, ...], Meta(description="replace requirements of the packages themselves")
    ] = ()
    build_constraints: Annotated[tuple[Constraint, ...], Meta(description="version limits for build tools")] = ()
    build_variables: Annotated[Variables, Meta(description="environment variables of builds")] = Variables()
    only_binary: Annotated[
        tuple[PackageSelector, ...], Meta(description="packages never built from source, `:all:` for every one")
    ] = ()
    overlay: Annotated[
        tuple[PackageName, ...], Meta(description="packages whose releases with invalid metadata are patched")
    ] = ()
    environment: Annotated[Variables, Meta(description="environment variables of the cell")] = Variables()
    needs: Annotated[tuple[Capability, ...], Meta(description="what the machine must have")] = ()
    system: Annotated[
        tuple[SystemPackage, ...], Meta(description="Debian's packages that must be there, such as headers")
    ] = ()
    files: Annotated[Files, Meta(description="files placed into the cell's HOME")] = Files()
    empty: Annotated[tuple[VariableName, ...], Meta(description="variables that are set, to the empty string")] = ()
    python_path: Annotated[
        tuple[InnerFolder, ...],
        Meta(description="folders of the cell's HOME that modules are imported from; `.` too"),
    ] = ()
    bring: Annotated[dict[Label, BringTable], Meta(description="software that users provide, by a name")] = {}
    extras: Annotated[tuple[PackageName, ...], Meta(description="extras of the subject")] = ()
    groups: Annotated[tuple[PackageName, ...], Meta(description="dependency groups of the subject (PEP 735)")] = ()


class PictureTable(Table, frozen=True, kw_only=True):
    """The colours above and below in a right picture; any other picture is upside down, or the wrong one."""

    above: Colour
    below: Colour
    never: Annotated[Colour | None, Meta(description="a colour that wrong pictures show, right ones never")] = None


class CaseTable(Table, frozen=True, kw_only=True):
    """One environment tried in a cell."""

    api: Api | None = None
    env: Annotated[
        str | None, Meta(description="environment id; an API's name may stand before it, as in `gym:CartPole-v1`")
    ] = None
    id: Annotated[Label | None, Meta(description="by default made from the environment id")] = None
    kwargs: Annotated[dict[str, Any], Meta(description="arguments of make")] = {}
    checks: Annotated[
        tuple[CheckName, ...],
        Meta(description="checks, or phases for the usual ones, `vector.*` for all; default: every phase but interop"),
    ] = ()
    required: Annotated[tuple[FindingName, ...], Meta(description="warnings that make the case fail")] = ()
    imports: Annotated[tuple[ModuleName, ...], Meta(description="modules imported first")] = ()
    when: When = {}
    only: Annotated[
        Literal["baseline"] | None, Meta(description="baseline: exists in the cells of that strategy alone")
    ] = None
    timeouts: Annotated[
        dict[
            Literal["import", "single", "vector", "render", "behave", "interop"], Annotated[float, Meta(gt=0, le=1e6)]
        ],
        Meta(description="phase to seconds for each of its checks"),
    ] = {}
    picture: Annotated[
        PictureTable | None, Meta(description="colours of a right picture after the first reset, as #rrggbb")
    ] = None
    bank: Annotated[
        InnerPath | None,
        Meta(description="bank of states for the phase `behave`, made by `freeze`; relative to the matrix file"),
    ] = None
    policy: Annotated[
        InnerPath | None,
        Meta(
            description="policy that plays in the phase `behave`: a file of `benchmarks/linear_policy.py`, relative to "
            "the matrix file, or `metaworld` for the scripted policy of the task in `kwargs.env_name`"
        ),
    ] = None
    episodes: Annotated[int, Meta(ge=2, le=100_000, description="episodes that the policy plays")] = 200
    steps: Annotated[int, Meta(ge=1, le=10**9)] = 100
    seed: Annotated[int, Meta(ge=0)] = 7
    memory_mb: Annotated[int, Meta(ge=64, description="of all processes of a probe together")] = 6000


class VersionTable(Changes, frozen=True, kw_only=True):
    """A version of Python or of a package that brings changes with it."""

    version: str
    reason: str | None = None


class BundleTable(Changes, frozen=True, kw_only=True):
    """A named value of a bundle axis: several changes, and cases that exist only with it."""

    cases: tuple[CaseTable, ...] = ()
    reason: str | None = None


class RangeTable(Table, frozen=True, kw_only=True):
    """Releases of a package, expanded from the index once; the expansion is committed beside the matrix."""

    range: Annotated[str, Meta(description="a specifier, such as `>=2.3,<4`")]
    rule: Annotated[
        Rule,
        Meta(
            description="latest-patch: newest of each X.Y; latest-minor: newest of each X; "
            "boundaries: latest-patch, and both sides of each known API break"
        ),
    ] = Rule.LATEST_PATCH
    prereleases: bool = False
    yanked: bool = False


class VariableTable(Table, frozen=True, kw_only=True):
    """Values of an environment variable; such an axis never changes the lock."""

    variable: Annotated[tuple[str, ...], Meta(min_length=1, description="values; the empty string stays unset")]


SUBJECT_NAMES = "such as `mujoco`, or several as `mujoco+render`; the empty string is none"


class ExtraTable(Table, frozen=True, kw_only=True):
    """Extras of the subject, one value of the axis each."""

    extra: Annotated[tuple[SubjectNames, ...], Meta(min_length=1, description=SUBJECT_NAMES)]


class GroupTable(Table, frozen=True, kw_only=True):
    """Dependency groups of the subject, one value of the axis each."""

    group: Annotated[tuple[SubjectNames, ...], Meta(min_length=1, description=SUBJECT_NAMES)]


NO_CHANGES = Changes()


class Value(Struct, frozen=True, kw_only=True):
    """One value of an axis, however it was written. `text` is a version, a label, or a variable's value."""

    text: str
    changes: Changes = NO_CHANGES
    cases: tuple[CaseTable, ...] = ()


class Axis:
    """A dimension: versions, a range, values of a variable, extras or groups of the subject, or a bundle."""

    __slots__ = ("kind", "range", "values")
    reads: ClassVar[tuple[Any, ...]] = (
        Annotated[tuple[str | VersionTable, ...], Meta(min_length=1)],
        RangeTable,
        VariableTable,
        ExtraTable,
        GroupTable,
        Annotated[dict[str, BundleTable], Meta(min_length=1)],
    )

    def __init__(self, kind: Kind, values: tuple[Value, ...], wanted: RangeTable | None = None) -> None:
        self.kind = kind
        self.values = values
        self.range = wanted

    @classmethod
    def parse(cls, plain: Any, convert: Callable[[Any, Any], Any]) -> Self:
        """Return the axis that any of the forms stands for; python is told from packages by its name, later."""
        versions, *_, bundles = cls.reads
        if not isinstance(plain, dict):
            return cls(Kind.PACKAGE, tuple(map(_version_value, convert(plain, versions))))
        # Tested before the keys below, so that a bundle may have a value called `variable`, `extra` or `group`.
        if all(isinstance(value, dict) for value in plain.values()):
            named = convert(plain, bundles).items()
            return cls(
                Kind.BUNDLE, tuple(Value(text=label, changes=table, cases=table.cases) for label, table in named)
            )
        for kind, table in ((Kind.VARIABLE, VariableTable), (Kind.EXTRA, ExtraTable), (Kind.GROUP, GroupTable)):
            if kind in plain:
                return cls(kind, tuple(Value(text=text) for text in getattr(convert(plain, table), kind)))
        return cls(Kind.PACKAGE, (), convert(plain, RangeTable))


def _version_value(written: str | VersionTable) -> Value:
    if isinstance(written, str):
        return Value(text=written)
    return Value(text=written.version, changes=written)


class SuiteTable(Suite, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The subject's own pytest suite, run in an environment of its own next to each cell."""

    when: Annotated[When, Meta(description="cells that run it; default: all")] = field(default_factory=dict)
    seconds: Annotated[float, Meta(gt=0, description="seconds for the whole suite")] = field(
        default=1800.0, name="timeout"
    )


class ExcludeTable(Table, frozen=True, kw_only=True):
    """Combinations that are not run."""

    when: Annotated[When, Meta(min_length=1)]
    reason: Annotated[str, Meta(min_length=1)]


class VariantTable(Table, frozen=True, kw_only=True):
    """Combinations under a side condition: measured and listed, but not part of a table's squares."""

    when: Annotated[When, Meta(min_length=1)]
    reason: Annotated[str, Meta(min_length=1, description="the side condition in words")]


class IncludeTable(Table, frozen=True, kw_only=True):
    """One combination more; it gives every axis a value, which the axis itself need not list."""

    axes: dict[str, str]
    reason: Annotated[str, Meta(min_length=1)]


class ExpectTable(Expectation, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An expected result of some cells; the first entry that fits a cell applies."""

    reason: Annotated[str, Meta(min_length=1)]
    cells: Annotated[
        str | None, Meta(description="glob on the cell's id or on its label; with `_with-` in it, also of changed ones")
    ] = None
    when: When = field(default_factory=dict)

    @property
    def of_changed(self) -> bool:
        """Return whether its glob may match changed cells; other expectations mean cells as the axes make them."""
        return not self.when and self.cells is not None and cellid.of_changed(self.cells)


class ChangedTable(Expectation, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The expected result of cells once they are changed."""

    verdict: Verdict = Verdict.WORKS
    reason: Annotated[str, Meta(description="by default that of the change")] = ""


class ChangeTable(Changes, frozen=True, kw_only=True):
    """One change, tried on some cells: each of these gets a changed copy, `LABEL_with-NAME`.

    Its requirements replace the cell's requirements on the same packages.
    """

    name: Label
    reason: Annotated[str, Meta(min_length=1, description="why it is tried")]
    cells: Annotated[str | None, Meta(description="glob on the cell's id or on its label")] = None
    when: When = {}
    python: PythonVersion | None = None
    as_of: Annotated[Instant | None, Meta(description="everything resolved as the index stood then")] = None
    uninstall: Annotated[tuple[PackageName, ...], Meta(description="packages that may not be there")] = ()
    remedy_of: Annotated[
        str | None, Meta(description="it is the remedy of this signature, and changes nothing besides")
    ] = None
    advice: Annotated[bool, Meta(description="whether people recommend it")] = False
    link: Annotated[str | None, Meta(description="a page that says so")] = None
    expect: Annotated[ChangedTable, Meta(description="the expected result; default: it works")] = field(
        default_factory=ChangedTable
    )


class MatrixTable(Changes, frozen=True, kw_only=True):
    """A compatibility matrix: axes, packages, cases, and what is left out, added or expected, with reasons."""

    axes: Annotated[dict[str, Axis], Meta(description="name to values; `python` must be one of them")]
    description: str = ""
    subject: Annotated[
        str | None,
        Meta(
            description="the package under test: a folder or a wheel, as seen from the project's folder, "
            "or `git+ADDRESS@REFERENCE`; locks never hold it"
        ),
    ] = None
    suite: SuiteTable | None = None
    snapshot: Annotated[Instant | None, Meta(description="nothing uploaded later is installed")] = None
    strategy: Annotated[Strategy, Meta(description="which combinations are planned; default: all of them")] = field(
        default_factory=lambda: FULL
    )
    resolution: Literal["highest", "lowest-direct"] = "highest"
    prerelease: Literal["disallow", "allow", "if-necessary", "explicit", "if-necessary-or-explicit"] = (
        "if-necessary-or-explicit"
    )
    torch_backend: Annotated[TorchBackend | None, Meta(description="uv's; a CPU build by default, if there is one")] = (
        None
    )
    index: IndexSettings = IndexSettings()
    shown: Annotated[tuple[PackageName, ...], Meta(description="packages whose version tables show")] = ()
    pivot: Annotated[
        tuple[str, str] | None, Meta(description="axes of the small table, down and across; default: two that vary")
    ] = None
    title: Annotated[
        str, Meta(description="heading of the report after the matrix's name; `{cells}` is their number")
    ] = ""
    page: Annotated[
        InnerPath | None,
        Meta(description="template of the report's README.md, relative to the folder of the matrix file"),
    ] = None
    cases: tuple[CaseTable, ...] = ()
    exclude: tuple[ExcludeTable, ...] = ()
    include: tuple[IncludeTable, ...] = ()
    variant: Annotated[tuple[VariantTable, ...], Meta(description="side conditions, kept out of the squares")] = ()
    expect: tuple[ExpectTable, ...] = ()
    change: Annotated[tuple[ChangeTable, ...], Meta(description="single changes tried on some of the cells")] = ()


class Matrix(MatrixTable, frozen=True, kw_only=True):
    """A matrix file that was read: its table, its `name` (the file's stem), and `path` as messages give it."""

    name: str
    path: str

    @property
    def expands(self) -> bool:
        """Return whether its plan needs what `NAME.expanded.json` keeps."""
        return bool(self.ranges or self.strategy.covering)

    @property
    def ranges(self) -> dict[str, RangeTable]:
        """Return the axes (packages) that are ranges; without any, the matrix needs no expansion of ranges."""
        return {name: axis.range for name, axis in self.axes.items() if axis.range is not None}


class Unresolvable(Table, frozen=True, kw_only=True):
    """Values, by axis, that no resolution has together, and the line that says why."""

    axes: dict[str, str]
    reason: str


class Chosen(Table, frozen=True, kw_only=True):
    """The combinations that a covering strategy chose, with values in the order of the axes.

    `unresolvable` are values found not to resolve together. `made_from` is a hash of all that the choice depends on.
    """

    made_from: str
    axes: tuple[str, ...]
    combinations: tuple[tuple[str, ...], ...]
    unresolvable: tuple[Unresolvable, ...] = ()


class Expansion(Table, frozen=True, kw_only=True):
    """The versions and combinations that a matrix's ranges and strategy gave at one instant: `NAME.expanded.json`."""

    schema: Literal[1] = 1
    matrix: str
    instant: Instant
    ranges: Annotated[dict[str, RangeTable], Meta(description="the ranges as they were, to tell when one changes")]
    axes: dict[str, tuple[str, ...]]
    chosen: Chosen | UnsetType = UNSET

    def fits(self, matrix: Matrix) -> bool:
        """Return whether it was made from the ranges and the snapshot that the matrix has now."""
        current = (
            self.matrix == matrix.name and self.ranges == matrix.ranges and self.axes.keys() == matrix.ranges.keys()
        )
        return current and matrix.snapshot in {None, self.instant}
