"""Fold what each release of a package offers into one history: since when, and until when, each name is there."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import msgspec

from harness.history.release_reader import ReleaseFacts
from harness.model import decoding

FORM = 2

Span = tuple[int, int]
"""The first and the last of consecutive releases that were read, as places in `releases`."""

Spans = tuple[Span, ...]


class ReleaseEntry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A release: `wheels` are the tags of its files, `sdist` whether there is a source; `read` whether we read it."""

    version: str
    uploaded: str | None = None
    python: str | None = None
    wheels: tuple[str, ...] = ()
    sdist: bool = False
    yanked: bool = False
    read: bool = False


class ApiHistory(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The history of one package, releases oldest first; see `ReleaseFacts` for what the rest holds.

    `ran` are the places of releases that were also run, for what only running tells: the names of `natives`, the
    `environments` that are registered, and the `schema` of a simulator's files, `element attribute` each.
    """

    form: int = FORM
    package: str
    releases: tuple[ReleaseEntry, ...]
    ran: Spans = ()
    modules: dict[str, Spans] = {}
    names: dict[str, dict[str, Spans]] = {}
    members: dict[str, dict[str, Spans]] = {}
    signatures: dict[str, tuple[tuple[int, int, str], ...]] = {}
    requires: dict[str, Spans] = {}
    extras: dict[str, Spans] = {}
    entry_points: dict[str, Spans] = {}
    environments: dict[str, Spans] = {}
    schema: dict[str, Spans] = {}


@dataclass(frozen=True, kw_only=True, slots=True)
class MeasuredRelease:
    """A release with what was read of it; `ran` is what running it told, None where it was not run."""

    entry: ReleaseEntry
    facts: ReleaseFacts | None = None
    ran: ReleaseFacts | None = None
    environments: tuple[str, ...] | None = None
    schema: tuple[str, ...] | None = None


def fold(package: str, releases: Sequence[MeasuredRelease]) -> ApiHistory:
    """Return the history of a package from its releases, oldest first."""
    read = [number for number, release in enumerate(releases) if release.facts]
    ran = [number for number, release in enumerate(releases) if release.ran or release.environments is not None]

    def spans(have: Callable[[MeasuredRelease], Iterable[str]], among: Sequence[int] = read) -> dict[str, Spans]:
        places: dict[str, list[int]] = {}
        for rank, number in enumerate(among):
            for name in {*have(releases[number])}:
                places.setdefault(name, []).append(rank)
        return {name: _spans(places[name], among) for name in sorted(places)}

    def nested(named: Callable[[MeasuredRelease], dict[str, tuple[str, ...]]]) -> dict[str, dict[str, Spans]]:
        owners = sorted({owner for number in read for owner in named(releases[number])})
        return {owner: spans(lambda release, owner=owner: named(release).get(owner, ())) for owner in owners}  # type: ignore[misc]

    return ApiHistory(
        package=package,
        releases=tuple(release.entry for release in releases),
        ran=_spans([*range(len(ran))], ran),
        modules=spans(lambda release: _facts(release).modules),
        names={owner: release for owner, release in nested(_public_names(releases, read)).items() if release},
        members={
            owner: release for owner, release in nested(lambda release: _named(release, "members")).items() if release
        },
        signatures=_signatures(releases, read),
        requires=spans(lambda release: _facts(release).requires),
        extras=spans(lambda release: _facts(release).extras),
        entry_points=spans(lambda release: _facts(release).entry_points),
        environments=spans(lambda release: release.environments or (), ran),
        schema=spans(lambda release: release.schema or (), ran),
    )


HEAD = frozenset({"form", "package", "releases", "ran", "requires"})
"""The keys of the first line of a file, which is read by itself where no names are asked for."""


def encode(history: ApiHistory) -> bytes:
    """Return the file of a history: two lines, compressed one by one; the same bytes for the same history."""
    plain = {"form": FORM, "ran": (), **msgspec.to_builtins(history)}
    lines = (
        {key: value for key, value in plain.items() if key in HEAD},
        {key: value for key, value in plain.items() if key not in HEAD},
    )
    return b"".join(gzip.compress(msgspec.json.encode(line, order="sorted") + b"\n", mtime=0) for line in lines)


def decode(content: bytes) -> ApiHistory:
    """Return the history in a file. Raises ValueError if it has another form."""
    plain: dict[str, object] = {}
    for line in gzip.decompress(content).splitlines():
        plain |= msgspec.json.decode(line)
    if plain["form"] != FORM:
        message = f"form {plain['form']} instead of {FORM}: make it again"
        raise ValueError(message)
    return decoding.convert(plain, ApiHistory)


def _facts(release: MeasuredRelease) -> ReleaseFacts:
    assert release.facts is not None
    return release.facts


def _public_names(
    releases: Sequence[MeasuredRelease], read: Sequence[int]
) -> Callable[[MeasuredRelease], dict[str, tuple[str, ...]]]:
    """Return a function that gives the names of a release, by module.

    A name that a module has from another package counts where some release of this one defines it there. A module that
    makes names as it runs, in some release, has none: they would come and go with the way in which they are made.
    """
    own: dict[str, set[str]] = {}
    hidden: set[str] = set()
    for number in read:
        ran = releases[number].ran
        for owner, names in _named(releases[number], "names").items():
            own.setdefault(owner, set()).update(names)
        hidden |= {*_facts(releases[number]).dynamic} - {*(ran.names if ran else ())}

    def named(release: MeasuredRelease) -> dict[str, tuple[str, ...]]:
        imported = _facts(release).imported
        return {
            owner: (*names, *(own[owner] & {*imported.get(owner, ())}))
            for owner, names in _named(release, "names").items()
            if owner not in hidden
        }

    return named


def _named(release: MeasuredRelease, field: str) -> dict[str, tuple[str, ...]]:
    """Return names by their owner; those that running told count where there are any, as a file may hide some."""
    names: dict[str, tuple[str, ...]] = getattr(release.facts, field)
    if release.ran:
        names = {**names, **getattr(release.ran, field)}
    return names


def _spans(ranks: Sequence[int], among: Sequence[int]) -> Spans:
    """Return runs of consecutive ranks, as places of the first and last release of each."""
    runs: list[list[int]] = []
    for rank in ranks:
        if runs and rank == runs[-1][1] + 1:
            runs[-1][1] = rank
        else:
            runs.append([rank, rank])
    return tuple((among[first], among[last]) for first, last in runs)


def _signatures(
    releases: Sequence[MeasuredRelease], read: Sequence[int]
) -> dict[str, tuple[tuple[int, int, str], ...]]:
    """Return, by path, the parameters with the first and last release that has them so."""
    runs: dict[str, list[list[int | str]]] = {}
    for rank, number in enumerate(read):
        for path, text in _facts(releases[number]).signatures.items():
            runs_here = runs.setdefault(path, [])
            if runs_here and runs_here[-1][1] == rank - 1 and runs_here[-1][2] == text:
                runs_here[-1][1] = rank
            else:
                runs_here.append([rank, rank, text])
    return {
        path: tuple((read[int(first)], read[int(last)], str(text)) for first, last, text in runs[path])
        for path in sorted(runs)
    }
