"""Build, match, shorten and read cell ids, `MATRIX/PART_PART_PART`, also in the form of earlier versions.

`gymnasium-mujoco/py3.11_gymnasium-1.2.3_mujoco-3.3.7`: `_` stands between the parts of a label and nowhere else, `-`
between a package and its version, `absent` is `gym-absent`. A changed cell has one part more: `_with-NAME`, and
`_with-NAME-on-py3.9` where the change takes another Python. Before, labels had `-` everywhere and nothing between a
package and its version: `py3.11-gymnasium1.2.3-mujoco3.3.7-with-NAME`. An id or a glob of that form finds its cell.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import lru_cache
from hashlib import sha256
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeVar

from packaging.version import InvalidVersion, Version

if TYPE_CHECKING:
    from packaging.requirements import Requirement

LONGEST = 150
"""Characters that a label may have."""

BETWEEN = "_"
WITH = "with-"
"""The beginning of the part that names the change of a changed cell."""

MORE = "+"
"""The beginning of a part for other options of an ad-hoc question: no package has such a name."""

OLD_WITH = "-with-"
PYTHON, ABSENT, NONE, ANY, TRY = "python", "absent", "none", "any", "try"
NO_NAMES = ("no-extra", "no-group")
OPERATORS = {"<": "lt", "<=": "le", ">": "gt", ">=": "ge", "!=": "ne", "~=": "near", "==": "eq"}
STARRED = {"==": "like", "!=": "unlike"}
BOUND = rf"(?:{'|'.join((*OPERATORS.values(), *STARRED.values()))})\d[a-z0-9.]*"
SPELLED = re.compile(BOUND)
VERSION = re.compile(r"\d[a-z0-9.+]*")
SPECIFIER = re.compile(rf"{ANY}|\d[a-z0-9.+]*|{BOUND}")
ON_PYTHON = re.compile(r"-on-py[0-9.]+$")
READABLE = 40
"""Characters of a detail's value that an id shows."""


class Named(Protocol):
    """Anything with a cell id: cells, and their entries in a report."""

    @property
    def id(self) -> str:
        """Return the whole id."""

    @property
    def axes(self) -> Mapping[str, str]:
        """Return the value of each axis."""


T = TypeVar("T", bound=Named)


# --- built -----------------------------------------------------------------------------------------------------


class CellId(NamedTuple):
    """The id of a cell, `MATRIX/LABEL`: `str` writes it, `parse` reads it. A text without `/` is a label alone."""

    matrix: str
    label: str

    @classmethod
    def parse(cls, text: str) -> CellId:
        """Return the id that a text stands for."""
        name, slash, rest = text.partition("/")
        return cls(name, rest) if slash else cls("", text)

    @classmethod
    def build(cls, matrix: str, parts: Iterable[str]) -> CellId:
        """Return the id of a cell of a matrix."""
        return cls(matrix, BETWEEN.join(parts))

    def __str__(self) -> str:
        return f"{self.matrix}/{self.label}" if self.matrix else self.label

    def matches(self, glob: str) -> bool:
        """Return whether a glob matches the id or the label."""
        return fnmatchcase(str(self), glob) or fnmatchcase(self.label, glob)

    def changed(self, name: str, python: str | None = None) -> CellId:
        """Return the id of a changed cell; `python` is the version that the change takes, where it takes one."""
        slug = spell(name)
        on = f"-on-py{python}" if python and slug != f"py{python}" else ""
        ending = f"{BETWEEN}{WITH}{slug}{on}"
        return CellId(self.matrix, shorten(self.label, LONGEST - len(ending)) + ending)

    def folder(self, *words: str) -> str:
        """Return the folder, below another, of what was asked of a cell: no two questions have the same one."""
        name = BETWEEN.join(map(spell, words))
        exact = all(re.fullmatch(r"[A-Za-z0-9.+-]+", word) for word in words)
        inner = shorten(name if exact else f"{name}-{digest(repr(words))}")
        return "/".join(filter(None, (re.sub(r"[^A-Za-z0-9._+-]", "-", self.matrix), self.label, inner)))


def spell(text: str) -> str:
    """Return a name or value as a part of a label may hold it."""
    return re.sub(r"[^A-Za-z0-9.+-]+", "-", text.replace(BETWEEN, "-"))


def package(name: str, version: str) -> str:
    """Return the part of a package and its version, or `absent`."""
    return f"{spell(name)}-{spell(version)}"


def of_changed(glob: str) -> bool:
    """Return whether a glob speaks of changed cells, too, in the present form or the one before."""
    return f"{BETWEEN}{WITH}" in glob or OLD_WITH in glob


def shorten(text: str, longest: int = LONGEST) -> str:
    """Return a label of at most so many characters; two long ones that differ stay different."""
    if len(text) <= longest:
        return text
    mark = digest(text)
    return f"{text[: longest - len(mark) - 1]}-{mark}"


def digest(text: str) -> str:
    """Return the eight digits that stand for a text where it is too long or cannot be spelled."""
    return sha256(text.encode()).hexdigest()[:8]


def as_folder(text: str) -> str:
    """Return the name as a folder that cares neither for case nor for the signs that nox flattens."""
    return text.casefold().replace("/", "-").replace(".", "-")


# --- built of an ad-hoc question -------------------------------------------------------------------------------


class Detail(NamedTuple):
    """A part of a question besides its requirements: the option's word, its value, and what an id cannot show."""

    word: str
    value: str = ""
    rest: str = ""


def of_question(python: str, requirements: Iterable[Requirement], details: Iterable[Detail] = ()) -> str:
    """Return the label of a question: equal for equal ones, in whatever order they are asked.

    `gymnasium[classic-control]==1.2.3` is spelled `gymnasium.classic-control-1.2.3`, `numpy>=1.24,<2` as
    `numpy-ge1.24.lt2`. What cannot be spelled is named by its word alone, and told apart by a digest at the end.
    """
    by_name: dict[str, list[Requirement]] = {}
    for line in requirements:
        by_name.setdefault(_normal(line.name), []).append(line)
    parts, opaque = [f"py{spell(python)}"], []
    for name in sorted(by_name):
        part, whole = _requirement(name, by_name[name])
        parts.append(part)
        opaque += [] if whole else sorted(map(str, by_name[name]))
    for detail in sorted(set(details)):
        value = spell(detail.value)[:READABLE].strip("-")
        parts.append(f"{MORE}{detail.word}{f'-{value}' if value else ''}")
        # A capital letter counts as lost: ids have to differ on disks that do not care for case.
        opaque += (
            [repr(detail)]
            if detail.rest or not re.fullmatch(r"[a-z0-9.+-]*", detail.value) or value != detail.value
            else []
        )
    text = BETWEEN.join(dict.fromkeys(parts))
    if not opaque:
        return shorten(text)
    mark = f"{BETWEEN}{MORE}{digest(repr(opaque))}"
    return shorten(text, LONGEST - len(mark)) + mark


def requirement(word: str, line: Requirement) -> Detail:
    """Return a requirement as the value of an option."""
    value, whole = _requirement(_normal(line.name), [line])
    return Detail(word, value, "" if whole else str(line))


def _requirement(name: str, lines: Sequence[Requirement]) -> tuple[str, bool]:
    """Spell what is asked of a package; and whether that is all that is asked."""
    head = ".".join([name, *sorted({_normal(extra) for line in lines for extra in line.extras})])
    bounds = sorted({_bound(each.operator, each.version) for line in lines for each in line.specifier}, key=_by_version)
    plain = not any(line.url or line.marker for line in lines)
    if not bounds:
        # The end of a name such as `py-3` reads as a version, so `any` says that none is asked for.
        ambiguous = "-" in head and SPECIFIER.fullmatch(head.rpartition("-")[2])
        return (f"{head}-{ANY}" if ambiguous else head), plain
    first = bounds[0].removeprefix(OPERATORS["=="])
    if len(bounds) == 1 and VERSION.fullmatch(first):
        return f"{head}-{first}", plain
    return f"{head}-{spell('.'.join(bounds))}", plain and all(map(SPELLED.fullmatch, bounds))


def _bound(operator: str, version: str) -> str:

    bare = version.removesuffix(".*")
    try:
        sign = (OPERATORS if bare == version else STARRED)[operator]
        return f"{sign}{Version(bare)}"
    except (InvalidVersion, KeyError):  # `===`, which compares texts
        return f"{operator}{version}"


def _by_version(bound: str) -> tuple[str, str]:
    digits = re.search(r"\d.*", bound)
    return (re.sub(r"\d+", lambda number: number[0].zfill(8), digits[0]) if digits else "", bound)


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


# --- matched ---------------------------------------------------------------------------------------------------


def fits(pattern: str, cell: Named) -> bool:
    """Return whether a glob matches the id or the label of a cell, in the present form or the one before."""
    return any(name.matches(pattern) for name in _names(cell))


def has_name(text: str, cell: Named) -> bool:
    """Return whether a text is the id or the label of a cell, in the present form or the one before."""
    return any(text in {str(name), name.label} for name in _names(cell))


def select(pattern: str, cells: Sequence[T]) -> list[T]:
    """Return the cells that an id or a label names, else those that a glob matches."""
    exact = [cell for cell in cells if pattern in {cell.id, CellId.parse(cell.id).label}]
    return (
        exact or [cell for cell in cells if has_name(pattern, cell)] or [cell for cell in cells if fits(pattern, cell)]
    )


def _names(cell: Named) -> Iterator[CellId]:
    """Yield the id in the present form, then in the one before."""
    yield CellId.parse(cell.id)
    yield CellId.parse(to_old_form(cell))


# --- the form before -------------------------------------------------------------------------------------------


def to_old_form(cell: Named) -> str:
    """Return the id that earlier versions gave a cell."""
    matrix, label = CellId.parse(cell.id)
    return str(CellId(matrix, _older(label, tuple(cell.axes.items()))))


# Each glob that does not fit a cell asks for the older name of that cell again.
@lru_cache(maxsize=65536)
def _older(text: str, axes: tuple[tuple[str, str], ...]) -> str:
    values = dict(_renderings(axes))
    parts = [part for part in text.split(BETWEEN) if part in values or not part.startswith(MORE)]
    return "-".join(values.get(part) or _older_part(part) for part in parts)


def _older_part(part: str) -> str:
    """Return a part that no axis has as it was: that of a change, or of a package asked for ad hoc."""
    if part.startswith(WITH):
        return ON_PYTHON.sub("", part)
    head, _, last = part.rpartition("-")
    if not head or not SPECIFIER.fullmatch(last):
        return part.partition(".")[0]
    return head.partition(".")[0] + (last if VERSION.fullmatch(last) else "")


def _renderings(axes: Iterable[tuple[str, str]]) -> Iterator[tuple[str, str]]:
    """Yield what the value of an axis may be in a label: the part as it is now, and as it was."""
    for name, value in axes:
        if name == PYTHON:
            yield f"py{value}", f"py{value}"
            continue
        yield spell(value), value
        if value == ABSENT:
            yield package(name, value), f"{name}-{ABSENT}"
        elif value == NONE:
            yield from ((none, none) for none in NO_NAMES)
        elif VERSION.match(value):
            yield package(name, value), f"{name}{value}"


def to_current_form(cell_id: str, axes: Mapping[str, str], python: str | None = None) -> str:
    """Return the id in the present form; `python` is that of a changed cell. One that is not understood stays.

    The axes may stand in any order, as a document has them.
    """
    matrix, text = CellId.parse(cell_id)
    # An ad-hoc label holds more than the values of its axes, so they cannot take it apart.
    if matrix == TRY or _arranged(text.partition(f"{BETWEEN}{WITH}")[0], axes, BETWEEN, 0):
        return cell_id
    for body, tail in _bodies(text):
        if parts := _arranged(body, axes, "-", 1):
            new_id = CellId.build(matrix, parts)
            on = python if python and VERSION.fullmatch(python) and python != axes.get(PYTHON) else None
            return str(new_id.changed(tail, on) if tail else new_id)
    return cell_id


def _bodies(text: str) -> Iterator[tuple[str, str]]:
    """Yield the label of the cell and the name of its change, for each place where one may begin."""
    yield text, ""
    for match in re.finditer(OLD_WITH, text):
        yield text[: match.start()], text[match.end() :]


def _arranged(text: str, axes: Mapping[str, str], joint: str, form: int) -> tuple[str, ...]:
    """Return the parts, in the present form, of a label that joins a value of each axis; none where it does not.

    `form` is 0 for the present form, 1 for the one before.
    """
    if not axes:
        return ()
    for name, value in axes.items():
        rest = {other: axes[other] for other in axes if other != name}
        for rendering in _renderings([(name, value)]):
            written = rendering[form]
            if not rest and text == written:
                return (rendering[0],)
            if rest and text.startswith(written + joint) and (
                parts := _arranged(text[len(written) + len(joint) :], rest, joint, form)
            ):  # fmt: skip
                return (rendering[0], *parts)
    return ()


def newer_left_out(cell_id: str, values: Mapping[str, Iterable[str]]) -> str:
    """Return the id, in the present form, of combinations left out; `values` are those of each axis, in their order."""
    translations = {name: {old: new for value in known for new, old in _renderings([(name, value)])} | {"*": "*"}
             for name, known in values.items()}  # fmt: skip
    ranges = {name: r"py\d[\d.]*" if name == PYTHON else rf"{re.escape(name)}\d[^-]*" for name in values}
    matrix, text = CellId.parse(cell_id)
    if BETWEEN in text and re.fullmatch(BETWEEN.join("(.+)" for _ in values), text):
        return cell_id
    choices = (
        "|".join([*map(re.escape, sorted(translations[name], key=len, reverse=True)), ranges[name]]) for name in values
    )
    match = re.fullmatch("-".join(f"({each})" for each in choices), text)
    if not match:
        return cell_id
    parts = zip(values, match.groups(), strict=True)
    return str(CellId.build(matrix, [translations[name].get(part) or _unseen(name, part) for name, part in parts]))


def _unseen(name: str, part: str) -> str:
    return part if name == PYTHON else package(name, part.removeprefix(name))
