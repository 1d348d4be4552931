"""What the ranges of a matrix come to: expanded from the index once, then committed as `NAME.expanded.json`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import msgspec
from packaging.specifiers import SpecifierSet
from packaging.version import InvalidVersion, Version

from harness.matrix import Expansion, Matrix, RangeTable
from harness.schema import load_json, located
from harness.vocabulary import Instant, Rule


def read(text: str, path: str) -> Expansion:
    """Read `NAME.expanded.json`."""
    return load_json(text, Expansion, path)


def text_of(expansion: Expansion) -> str:
    """The committed form of an expansion, the same bytes for the same content."""
    return msgspec.json.format(msgspec.json.encode(expansion, enc_hook=str), indent=2).decode() + "\n"


def expand(matrix: Matrix, releases: Mapping[str, Iterable[tuple[str, bool]]], instant: str) -> Expansion:
    """Expand every range of a matrix; `releases` are (version, yanked) by package, `instant` when they were read."""
    wanted = matrix.ranges
    axes = {name: expand_range(table, releases[name]) for name, table in wanted.items()}
    for name, versions in axes.items():
        with located(matrix.path, "axes", name):
            if not versions:
                message = f'the index has no release that "{wanted[name].range}" allows'
                raise ValueError(message)
    return Expansion(matrix=matrix.name, instant=Instant(Instant.canonical(instant)), ranges=wanted, axes=axes)


def expand_range(wanted: RangeTable, releases: Iterable[tuple[str, bool]]) -> tuple[str, ...]:
    """Versions of a range by its rule, oldest first, from (version, yanked) pairs."""
    allowed = SpecifierSet(wanted.range)
    found = sorted(
        version
        for version in _versions(releases, yanked=wanted.yanked)
        if allowed.contains(version, prereleases=wanted.prereleases)
    )
    match wanted.rule:
        case Rule.ALL:
            kept = found
        case Rule.LATEST_PATCH:
            kept = list({(version.major, version.minor): version for version in found}.values())
        case Rule.LATEST_MINOR:
            kept = list({version.major: version for version in found}.values())
        case Rule.NEWEST:
            kept = found[-1:]
        case Rule.OLDEST_AND_NEWEST:
            kept = found[:1] + found[1:][-1:]
    return tuple(str(version) for version in kept)


def _versions(releases: Iterable[tuple[str, bool]], *, yanked: bool) -> Iterator[Version]:
    for text, is_yanked in releases:
        if yanked or not is_yanked:
            try:
                yield Version(text)
            except InvalidVersion:  # a release from before PEP 440, which nothing can install by version
                continue
