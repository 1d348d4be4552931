"""Expand the ranges of a matrix: once from the index, then committed as `NAME.expanded.json`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import cast

import msgspec
from msgspec import Struct
from packaging.specifiers import SpecifierSet
from packaging.version import InvalidVersion, Version

from harness.matrix.matrix_types import Expansion, Matrix, RangeTable
from harness.model.schema import load_json, load_toml, locate_errors
from harness.model.vocabulary import Instant, PackageName, Rule, version_text

Breaks = Mapping[str, tuple[Version, ...]]
NO_BREAKS: Breaks = {}


class BreakTable(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A release with an API break that user code, or another package, had to follow."""

    package: PackageName
    version: str
    what: str
    source: str


class BreaksTable(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The known API breaks, `breaks.toml`."""

    breaks: tuple[BreakTable, ...]


def read(text: str, path: str) -> Expansion:
    """Read `NAME.expanded.json`."""
    return load_json(text, Expansion, path)


def text_of(expansion: Expansion) -> str:
    """Return the committed form of an expansion: the same bytes for the same content."""
    return msgspec.json.format(msgspec.json.encode(expansion), indent=2).decode() + "\n"


def expand(
    matrix: Matrix, releases: Mapping[str, Iterable[tuple[str, bool]]], instant: str, breaks: Breaks = NO_BREAKS
) -> Expansion:
    """Expand every range of a matrix; `releases` are (version, yanked) by package, `instant` when they were read."""
    wanted = matrix.ranges
    axes = {name: expand_range(table, releases[name], breaks.get(name, ())) for name, table in wanted.items()}
    for name, versions in axes.items():
        with locate_errors(matrix.path, "axes", name):
            if not versions:
                message = f'the index has no release that "{wanted[name].range}" allows'
                raise ValueError(message)
    # What was checked is a plain string: msgspec encodes no instance of `Instant`.
    checked = cast("Instant", Instant.canonical(instant))
    return Expansion(matrix=matrix.name, instant=checked, ranges=wanted, axes=axes)


def expand_range(
    wanted: RangeTable, releases: Iterable[tuple[str, bool]], breaks: Iterable[Version] = ()
) -> tuple[str, ...]:
    """Return a range's versions by its rule, oldest first, from (version, yanked) pairs; `breaks` are API breaks."""
    allowed = SpecifierSet(wanted.range)
    versions = sorted(
        version
        for version in _versions(releases, yanked=wanted.yanked)
        if allowed.contains(version, prereleases=wanted.prereleases)
    )
    match wanted.rule:
        case Rule.ALL:
            selection = versions
        case Rule.LATEST_PATCH:
            selection = _latest_patches(versions)
        case Rule.LATEST_MINOR:
            selection = list({version.major: version for version in versions}.values())
        case Rule.NEWEST:
            selection = versions[-1:]
        case Rule.OLDEST_AND_NEWEST:
            selection = versions[:1] + versions[1:][-1:]
        case Rule.BOUNDARIES:
            selection = boundaries(versions, breaks)
    return tuple(str(version) for version in selection)


def boundaries(versions: Iterable[Version], breaks: Iterable[Version]) -> list[Version]:
    """Return each minor's newest patch, and for each break the last version before it and the first with it."""
    ascending = sorted(versions)
    selection = set(_latest_patches(ascending))
    for broke in breaks:
        before, since = [one for one in ascending if one < broke], [one for one in ascending if one >= broke]
        if before and since:
            selection |= {before[-1], since[0]}
    return sorted(selection)


def _latest_patches(ascending: Iterable[Version]) -> list[Version]:
    return list({(version.major, version.minor): version for version in ascending}.values())


def read_breaks(text: str, path: str) -> dict[str, tuple[Version, ...]]:
    """Return the versions of each package that are known to have broken its API, oldest first."""
    by_package: dict[str, list[Version]] = {}
    for index, entry in enumerate(load_toml(text, BreaksTable, path).breaks):
        with locate_errors(path, "breaks", index, "version"):
            by_package.setdefault(entry.package, []).append(Version(version_text(entry.version)))
    return {package: tuple(sorted(versions)) for package, versions in by_package.items()}


def _versions(releases: Iterable[tuple[str, bool]], *, yanked: bool) -> Iterator[Version]:
    for text, is_yanked in releases:
        if yanked or not is_yanked:
            try:
                yield Version(text)
            except InvalidVersion:  # a release from before PEP 440, which nothing can install by version
                continue
