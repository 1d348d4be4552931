"""Read recipes that repair releases which no resolver accepts any more, by changing lines of their metadata.

A recipe (`overlays/PACKAGE.toml`) names what the index has, an sdist or a wheel, and the repaired wheel by their
hashes; `mending` changes the lines.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Literal

import msgspec
from packaging.specifiers import SpecifierSet
from packaging.version import InvalidVersion, Version

from harness.model import Edit, Question, Repair
from harness.model.schema import load_toml, locate_errors, suggestion
from harness.model.vocabulary import (
    Instant,
    PackageName,
    Requirement,
    check_specifier,
    parsed_requirement,
    required_name,
)

Sha256 = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}$")]


RENAMED = {"old": "from", "new": "to"}


class EditTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, rename=RENAMED):
    """The start of the metadata lines to repair (`from`), and the start that replaces it (`to`)."""

    old: Annotated[str, msgspec.Meta(min_length=1)]
    new: str
    field: Literal["Requires-Dist", "Requires-Python"] = "Requires-Dist"


class ReleaseTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One release: its sdist or its wheel, when that was uploaded, and the wheel that comes out."""

    version: str
    uploaded: Annotated[Instant, msgspec.Meta(description="when the index got the file")]
    sdist: Annotated[Sha256 | None, msgspec.Meta(description="SHA-256 of the index's sdist, which is built")] = None
    wheel_from: Annotated[Sha256 | None, msgspec.Meta(description="SHA-256 of the index's wheel, if one is")] = None
    wheel: Annotated[Sha256, msgspec.Meta(description="SHA-256 of the repaired wheel, the same on every machine")]


class RecipeTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The repair of one package's releases that no resolver accepts: `overlays/PACKAGE.toml`."""

    package: PackageName
    reason: Annotated[str, msgspec.Meta(min_length=1)]
    link: str
    build: Annotated[tuple[Requirement, ...], msgspec.Meta(description="all that sdists are built with, pinned")] = ()
    python: Annotated[str | None, msgspec.Meta(description="the Pythons that can build them, as a specifier")] = None
    edits: Annotated[tuple[EditTable, ...], msgspec.Meta(min_length=1)]
    releases: Annotated[tuple[ReleaseTable, ...], msgspec.Meta(min_length=1)]


def read(text: str, file: str) -> tuple[Repair, ...]:
    """Return the repairs of a recipe, oldest release first; `file` is its name in messages."""
    table = load_toml(text, RecipeTable, file)
    with locate_errors(file, "python"):
        check_specifier(table.python or "", ">=3.7,<3.12")
    # The repaired wheel has one hash on every machine, so nothing that builds it may float.
    for index, line in enumerate(table.build):
        with locate_errors(file, "build", index):
            if not re.fullmatch(r"[\w.-]+==[\w.!+-]+", line):
                message = f'"{line}" is not pinned; write it as in "setuptools==66.1.1"'
                raise ValueError(message)
    edits = tuple(Edit(field=edit.field, old=edit.old, new=edit.new) for edit in table.edits)
    repairs = {}
    for index, release in enumerate(table.releases):
        with locate_errors(file, "releases", index):
            _check_origin(release, table)
        with locate_errors(file, "releases", index, "version"):
            try:
                version = Version(release.version)
            except InvalidVersion:
                message = f'"{release.version}" is not a version'
                raise ValueError(message) from None
            if version in repairs:
                message = f'"{release.version}" is listed twice'
                raise ValueError(message)
        repairs[version] = Repair(
            name=table.package,
            version=str(version),
            uploaded=release.uploaded,
            origin=release.sdist or release.wheel_from or "",
            wheel=release.wheel,
            build=table.build if release.sdist else (),
            python=table.python if release.sdist else None,
            edits=edits,
            reason=table.reason,
            link=table.link,
        )
    return tuple(repairs[version] for version in sorted(repairs))


def _check_origin(release: ReleaseTable, table: RecipeTable) -> None:
    """Raise a ValueError unless the release says what it is made of, and its recipe how."""
    if (release.sdist is None) == (release.wheel_from is None):
        message = 'name the file of the index that is repaired: either "sdist", which is built, or "wheel_from"'
        raise ValueError(message)
    if release.sdist and table.python is None:
        message = 'the sdist is built: say with which Pythons, as in python = ">=3.7,<3.12", at the top of the file'
        raise ValueError(message)


def select(repairs: Iterable[Repair], question: Question) -> tuple[Repair, ...]:
    """Return the repairs of releases that a question may resolve to: allowed by its bounds, and uploaded in time."""
    lines = (*question.requirements, *question.constraints)
    # An override replaces every other bound on its package, and so it does here.
    bounds = _bounds(lines) | _bounds(question.overrides)
    absent = set(question.absent)
    return tuple(
        one
        for one in repairs
        if bounds.get(one.name, SpecifierSet()).contains(one.version, prereleases=True)
        and one.name not in absent
        and one.uploaded <= (question.snapshot or one.uploaded)
    )


def select_by_hash(repairs: Iterable[Repair], hashes: Iterable[str]) -> tuple[Repair, ...]:
    """Return the repairs whose wheels are among these hashes."""
    wheels = set(hashes)
    return tuple(one for one in repairs if one.wheel in wheels)


def describe_edits(repair: Repair) -> str:
    """Describe the changed lines in a few words."""
    changes = ", ".join(f"`{edit.field}: {edit.old}` to `{edit.new}`" for edit in repair.edits)
    return f"{repair.name} {repair.version}: {changes}"


def find_repairs(recipes: Mapping[str, tuple[Repair, ...]], names: Sequence[str]) -> tuple[Repair, ...]:
    """Return the repairs of these packages. Raises ValueError if there are none for one of them."""
    unknown = next((name for name in names if name not in recipes), None)
    if unknown is not None:
        message = f'no recipe repairs "{unknown}"{suggestion(unknown, recipes)}'
        raise ValueError(message)
    return tuple(repair for name in names for repair in recipes[name])


def _bounds(lines: Iterable[str]) -> dict[str, SpecifierSet]:
    """Return the bounds that unconditional requirements set on versions, by package."""
    bounds: dict[str, SpecifierSet] = {}
    for line in lines:
        requirement = parsed_requirement(line)
        # A question names no interpreter, so whether a marker holds is not known here.
        if requirement.marker is None:
            name = required_name(line)
            bounds[name] = bounds.get(name, SpecifierSet()) & requirement.specifier
    return bounds
