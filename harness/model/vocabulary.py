"""Define the vocabulary of a matrix: its known names, and strings with rules of their own.

A string with rules is a class that reads itself (`schema.SelfReading`), so that a bad one is refused at its place in
the file and its rule is part of the JSON Schema. `matcher` gives a `when` its meaning.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from datetime import UTC, date, datetime
from enum import StrEnum
from functools import cache, partial
from pathlib import Path, PurePosixPath
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args

from packaging.requirements import InvalidRequirement
from packaging.requirements import Requirement as ParsedRequirement
from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion

from harness.model import requirement_texts
from harness.standalone.adapters import adapters


class Capability(StrEnum):
    """A capability that a cell may need of the machine."""

    EGL = "egl"
    OSMESA = "osmesa"
    DISPLAY = "display"
    GLU = "glu"
    VULKAN = "vulkan"
    GPU = "gpu"


class Kind(StrEnum):
    """The kind of values on an axis."""

    PYTHON = "python"
    PACKAGE = "package"
    BUNDLE = "bundle"
    VARIABLE = "variable"
    EXTRA = "extra"
    GROUP = "group"


class Rule(StrEnum):
    """The rule that picks releases of a range as values of the axis."""

    ALL = "all"
    LATEST_PATCH = "latest-patch"
    LATEST_MINOR = "latest-minor"
    NEWEST = "newest"
    OLDEST_AND_NEWEST = "oldest-and-newest"
    BOUNDARIES = "boundaries"


CheckName = Literal[
    "import", "single", "vector", "render", "behave", "interop", "vector.*",
    "import.modules", "single.loop", "vector.sync", "vector.async.fork", "vector.async.spawn",
    "vector.async.forkserver", "vector.async.unshared", "vector.async.many", "vector.autoreset", "render.rgb_array",
    "render.device",
    "behave.steps", "behave.pixels", "behave.policy",
    "interop.sb3.check_env", "interop.sb3.learn",
    "interop.gymnasium.make_vec", "interop.minari.dataset", "interop.mo_gymnasium.vector",
    "interop.supersuit.vec_env", "interop.supersuit.sb3_learn",
    "interop.torchrl.gym", "interop.torchrl.gym_tensor", "interop.torchrl.isaaclab",
    "interop.torchrl.isaaclab_native", "interop.torchrl.backend",
    "interop.sb3_contrib.learn", "interop.cleanrl.learn", "interop.tianshou.learn", "interop.rllib.learn",
    "interop.skrl.learn", "interop.torchrl.learn", "interop.brax.learn",
]  # fmt: skip
"""A check that a case runs, or a phase for those of its checks that a case runs without being asked, `.*` for all."""

FindingName = Literal[
    "single.repeat.fresh", "single.repeat.same", "single.repeat.first", "single.repeat.process",
    "single.space", "single.type", "single.state", "single.check_env", "single.teardown",
    "vector.repeat", "vector.autoreset",
    "render.constant", "render.stale", "render.upside_down", "render.picture", "render.teardown",
    "interop.torchrl.alias", "interop.torchrl.keys", "interop.torchrl.last", "interop.torchrl.reset",
    "interop.gymnasium.make_vec",

    "interop.cleanrl.log",
]  # fmt: skip
"""A finding of level warning, which a case can require not to be there."""

CHECKS: tuple[str, ...] = tuple(name for name in get_args(CheckName) if "." in name and not name.endswith(".*"))
STANDARD = frozenset({"import.modules", "single.loop", "vector.sync", "vector.async.fork", "render.rgb_array"})
"""What a case runs that asks for nothing; the other ways of a vector environment, and interop, cost time."""

MISLEADING = frozenset({"single.start_pose", "single.contact", "single.solver", "single.arrays", "render.camera"})
"""Checks that compare a case with its own specification. One that fails stops nobody: the case `misleads`."""

IMPORT_CHECK = CHECKS[0]
PHASES = tuple(dict.fromkeys(name.partition(".")[0] for name in STANDARD))

MAKE_BANK, STEP, DRAW, PLAY = "behave.bank", "behave.steps", "behave.pixels", "behave.policy"
"""The checks that make a bank of states, step from one, draw states of one, and play by a policy."""

INCELL = Path(__file__).parent.parent / "incell"
# Listed, not imported: nothing of the host imports the programs that run in cells.
APIS = tuple(sorted(m.name.removeprefix("api_") for m in iter_modules([str(INCELL)]) if m.name.startswith("api_")))
"""The adapters, each a file `api_NAME.py`."""

# mypy reads no Literal that is made at run time; msgspec does, and so a message can name the nearest adapter.
if TYPE_CHECKING:
    Api = str
else:
    Api = Literal[APIS]

GYM, GYMNASIUM = FAMILY = ("gym", "gymnasium")
"""The two that register environments by name: a package that asks for one of them speaks it."""
HOST = "host"
ABSENT = "absent"
UNSET = "unset"
NONE = "none"
SELF = "."
"""The package under test, whose name only its metadata tell."""

OF_SUBJECT = frozenset({Kind.EXTRA, Kind.GROUP})
NAMED = frozenset({Kind.BUNDLE, Kind.VARIABLE, *OF_SUBJECT})
"""Axes whose values are names; those of the others are versions."""

ALL_PACKAGES = ":all:"

LONGEST_QUOTE = 200
"""Characters of a requirement that a message quotes."""


# --- strings with rules of their own ---------------------------------------------------------------------------


class Checked(type):
    """A type whose values were checked when they were read, and are plain ones from then on.

    So msgspec writes them without a hook, and reads our own documents without checking them again.
    """

    def __instancecheck__(cls, value: object) -> bool:
        """Return whether a value is of the plain type below."""
        return isinstance(value, cls.__mro__[-2])  # the last is `object`


class Word(str, metaclass=Checked):
    """A string with a rule of its own: a `form`, and the end of the message on one that does not have it."""

    __slots__ = ()
    reads: ClassVar[tuple[Any, ...]] = (str,)
    form: ClassVar[str] = ""
    refusal: ClassVar[str] = ""

    @classmethod
    def parse(cls, plain: Any, convert: Callable[[Any, type[str]], str]) -> str:
        """Return the string as it is kept, or raise a ValueError saying what is wrong with it."""
        return cls.canonical(convert(plain, str))

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the text as it is kept. Raises ValueError."""
        if not re.fullmatch(cls.form, text):
            message = f'"{text}" {cls.refusal}'
            raise ValueError(message)
        return text


class Requirement(Word):
    """A requirement as PEP 508 writes it, such as `gymnasium[mujoco]>=1.0`."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the text itself, once it parses."""
        parsed_requirement(text)
        return text


class PackageName(Word):
    """The name of a package."""

    form = r"[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?"
    refusal = "is not the name of a package"

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the normalised name."""
        return canonicalize_name(super().canonical(text))


class PackageSelector(PackageName):
    """The name of a package, or `:all:` for every one."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the normalised name, or `:all:`."""
        return text if text == ALL_PACKAGES else super().canonical(text)


class ModuleName(Word):
    """The name of a Python module, such as `dm_control.suite`."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the text itself."""
        if not all(part.isidentifier() for part in text.split(".")):
            message = f'"{text}" is not the name of a Python module'
            raise ValueError(message)
        return text


class Label(Word):
    """A name that can be a folder: letters, digits and `._+-`."""

    form = r"(?!\.*$)[A-Za-z0-9._+-]+"
    refusal = 'cannot be a label: use letters, digits and "._+-" only'


class Pattern(Word):
    """A regular expression (Python's), searched in the decisive line."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the text itself, once it compiles."""
        cls.compiled(text)
        return text

    @staticmethod
    def compiled(text: str, flags: int = 0) -> re.Pattern[str]:
        """Compile the text. Raises ValueError."""
        try:
            return re.compile(text, flags)
        except (re.error, RecursionError, OverflowError) as error:
            message = f'"{text}" is not a regular expression: {error}'
            raise ValueError(message) from None


class SystemPackage(Word):
    """The name of a package of Debian, such as `libosmesa6-dev`."""

    form = r"[a-z0-9][a-z0-9+.-]+"
    refusal = 'is not the name of a package of Debian, such as "libosmesa6-dev"'


class Colour(Word):
    """A colour as `#rrggbb`."""

    form = r"#[0-9A-Fa-f]{6}"
    refusal = 'is not a colour such as "#c83c14"'

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the colour in small letters."""
        return super().canonical(text).lower()


class PythonVersion(Word):
    """A Python, such as `3.10` or `3.10.4`; `host` is the one that the harness runs in."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the normalised version, or `host`."""
        return text if text == HOST else version_text(text)


class SubjectNames(Word):
    """Extras or dependency groups of the subject, such as `mujoco` or `mujoco+render`; the empty string is none."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the normalised names."""
        return "+".join(PackageName.canonical(part) for part in text.split("+")) if text else text


class TorchBackend(Word):
    """uv's name for a build of torch: `cpu`, `auto`, `cu126`, `rocm6.3`, `xpu`; `any` is what the index itself has."""

    form = r"cpu|auto|any|xpu|cu\d{2,3}|rocm\d+(\.\d+)*"
    refusal = 'is not a torch backend such as "cpu", "cu126", "rocm6.3", "xpu" or "auto"'


class Instant(Word):
    """A moment in UTC, such as `2026-11-20T12:00:00Z`; a bare date stands for the end of that day, UTC."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the moment as `2026-11-20T23:59:59Z`."""
        try:
            if len(text) == len("2026-11-20"):
                return f"{date.fromisoformat(text).isoformat()}T23:59:59Z"
            moment = datetime.fromisoformat(text)
        except ValueError:
            message = f'"{text}" is not a date such as 2026-11-20 nor a moment such as 2026-11-20T12:00:00Z'
            raise ValueError(message) from None
        # Instants are compared as texts, so all of them have one length and one zone.
        moment = moment.replace(tzinfo=moment.tzinfo or UTC).astimezone(UTC)
        return moment.replace(microsecond=0, tzinfo=None).isoformat() + "Z"


class InnerPath(Word):
    """A relative path that stays inside its folder, with `/` between its parts."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the path without redundant parts."""
        path = PurePosixPath(text)
        if not path.name or path.is_absolute() or ".." in path.parts or "\\" in text or "\0" in text:
            message = f'"{text}" is not a relative path inside the folder'
            raise ValueError(message)
        return str(path)


class InnerFolder(Word):
    """A relative path to a folder that stays inside another; `.` is that folder itself."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the path without redundant parts."""
        return text if text == "." else InnerPath.canonical(text)


class VariableName(Word):
    """The name of an environment variable that a cell may have."""

    @classmethod
    def canonical(cls, text: str) -> str:
        """Return the name itself."""
        check_variable(text)
        return text


class Variables(dict[str, str], metaclass=Checked):
    """Environment variables; one set to the empty string stays unset in the cell."""

    reads: ClassVar[tuple[Any, ...]] = (dict[str, str],)
    reserved: ClassVar[frozenset[str]] = frozenset({"HOME", "TMPDIR"})

    @classmethod
    def parse(cls, plain: Any, convert: Callable[[Any, type[dict[str, str]]], dict[str, str]]) -> dict[str, str]:
        """Return the variables, or raise a ValueError about the first name that cannot be one."""
        read = convert(plain, dict[str, str])
        for name, value in read.items():
            check_variable(name)
            if "\0" in value:
                message = f'the value of "{name}" holds a null character'
                raise ValueError(message)
        return read


def check_variable(name: str) -> None:
    """Raise a ValueError unless a cell may have an environment variable of this name."""
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        message = f'"{name}" is not the name of an environment variable'
        raise ValueError(message)
    if name in Variables.reserved:
        message = f'"{name}" cannot be set: every cell gets its own'
        raise ValueError(message)


@cache
def parsed_requirement(text: str) -> ParsedRequirement:
    """Return the requirement, parsed once; a ValueError says why it is none."""
    try:
        return requirement_texts.requirement(text)
    except InvalidRequirement as error:
        short = text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE]}..."
        message = f'"{short}" is not a requirement: {str(error).splitlines()[0]}'
        raise ValueError(message) from None


@cache
def required_name(text: str) -> str:
    """Return the normalised name of the package that a requirement asks for."""
    return canonicalize_name(parsed_requirement(text).name)


def check_specifier(text: str, example: str) -> None:
    """Raise a ValueError unless the text is a specifier, such as the example."""
    try:
        requirement_texts.specifiers(text)
    except InvalidSpecifier:
        message = f'"{text}" is not a specifier such as "{example}"'
        raise ValueError(message) from None


def version_text(text: str) -> str:
    """Return a version in its normalised form; a ValueError says what to write where it is none."""
    try:
        return str(requirement_texts.version(text))
    except InvalidVersion:
        message = f'"{text}" is not a version; ids name resolved versions only'
        raise ValueError(message) from None


def api_of(env: str | None, api: str | None) -> str | None:
    """Return the API of a case: the one asked for, else the one whose prefix the environment id has."""
    prefix = (env or "").partition(":")[0] if ":" in (env or "") else None
    named = prefix if prefix in APIS else None
    if named and api and named != api:
        message = f'"{env}" names the API "{named}", but "{api}" is asked for'
        raise ValueError(message)
    return named or api


def case_id(env: str | None, imports: Sequence[str]) -> str:
    """Return the id of a case that was given none: `ALE-Pong-v5` of `ALE/Pong-v5`, `import-mujoco` without an id."""
    if env is None:
        return f"import-{imports[0]}"
    slug = re.sub(r"[^A-Za-z0-9._+-]+", "-", env).strip("-.")
    if not slug:
        message = f'"{env}" is not the id of an environment'
        raise ValueError(message)
    return slug


def checks_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the checks that checks and phases name, in their order, the usual ones for none; all need the import."""
    return tuple(
        check for check in CHECKS if check == IMPORT_CHECK or check in names or _stands_for(check, names or PHASES)
    )


def _stands_for(check: str, names: Sequence[str]) -> bool:
    """Return whether one of these phases names a check: a usual one, or any, of interop and by `.*`."""
    phase = check.partition(".")[0]
    return f"{phase}.*" in names or (phase in names and (check in {*STANDARD, STEP, PLAY} or phase == "interop"))


# --- when ------------------------------------------------------------------------------------------------------


When = dict[str, str | tuple[str, ...]]
"""Axis name to a pattern, or to alternatives of which one must hold; all axes named must agree.

For python and packages a pattern is a version, a specifier such as `>=1.0,<2`, or `absent`; for bundles and variables
it is a value, in which `*` and `?` stand for any text (`unset` for a variable that stays unset).
"""


def alternatives(patterns: str | tuple[str, ...]) -> tuple[str, ...]:
    """Return the patterns of one axis of a `when`."""
    return (patterns,) if isinstance(patterns, str) else patterns


@cache
def matcher(kind: Kind, pattern: str) -> Callable[[str], bool]:
    """Return the test of an axis value that a pattern of a `when` stands for; ValueError where it stands for none."""
    if kind in NAMED:
        glob = (pattern or (NONE if kind in OF_SUBJECT else UNSET)).split("*")
        return cache(partial(_fits, tuple(glob)))
    if pattern == ABSENT and kind is Kind.PACKAGE:
        return lambda value: value == ABSENT
    specifiers = _specifiers(kind, pattern)
    # A pre-release is a value only where a file asks for it, so a `when` does not pass over it.
    return cache(lambda value: value != ABSENT and specifiers.contains(value, prereleases=True))


def _fits(pieces: Sequence[str], value: str) -> bool:
    """Tell whether a value is these pieces with any text between them, `?` standing for any character.

    Each piece is taken where it fits first: no way back, as a regular expression would look for.
    """
    first, *rest = pieces
    if not _at(first, value, 0) or not rest:
        return _at(first, value, 0) and len(first) == len(value)
    *inner, last = rest
    place, end = len(first), len(value) - len(last)
    for piece in inner:
        position = next((start for start in range(place, end - len(piece) + 1) if _at(piece, value, start)), None)
        if position is None:
            return False
        place = position + len(piece)
    return place <= end and _at(last, value, end)


def _at(piece: str, value: str, start: int) -> bool:
    part = value[start : start + len(piece)]
    return len(part) == len(piece) and all(one in ("?", other) for one, other in zip(piece, part, strict=True))


def _specifiers(kind: Kind, pattern: str) -> SpecifierSet:
    exact = re.fullmatch(r"\d[^,\s]*", pattern)
    # `3.10` means each 3.10.x of Python, while `1.2` of a package is that release alone.
    minor = kind is Kind.PYTHON and re.fullmatch(r"\d+\.\d+", pattern)
    try:
        specifiers = requirement_texts.specifiers(f"=={pattern}{'.*' if minor else ''}" if exact else pattern)
    except InvalidSpecifier:
        specifiers = SpecifierSet()
    # An empty set would hold for every version.
    if not specifiers:
        short = pattern if len(pattern) <= LONGEST_QUOTE else f"{pattern[:LONGEST_QUOTE]}..."
        message = f'"{short}" is neither a version nor a specifier such as ">=1.0,<2"'
        raise ValueError(message)
    return specifiers


CHANGING = re.compile(r"\bline \d+|\d+(?:\.\d+)+")
"""Parts that differ between two lines about the same failure: line numbers, and versions."""

READERS = {"DISPLAY": None, "PYOPENGL_PLATFORM": {"pyopengl"}, "SDL_VIDEODRIVER": {"pygame", "pygame-ce"}}
"""Variables of drawing, and the packages of which one has to be there for it to matter; None for any."""


def readers(variable: str) -> Collection[str] | None:
    """Return the packages of which one has to be there for a variable of drawing to matter; None for any."""
    if variable != "MUJOCO_GL":
        return READERS.get(variable)
    return {name for adapter in adapters().values() for name in adapter.reads_mujoco_gl}


def settings(supplied: Mapping[str, str], installed: Iterable[str]) -> tuple[str, ...]:
    """Return what of the supplied variables matters to the packages that are there: `NAME=value` of each."""
    there = {*installed}
    return tuple(
        f"{name}={value}"
        for name, value in supplied.items()
        if (packages := readers(name)) is None or there & {*packages}
    )
