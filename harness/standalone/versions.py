"""Compare versions of packages, and tell which versions a specifier admits (PEP 440). Prereleases are admitted."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING, Iterable, Iterator, Optional, Tuple

if TYPE_CHECKING:
    from .vendored.packaging.specifiers import Specifier
    from .vendored.packaging.version import Version

# The library is imported where a version is first read: many answers need none, and it takes long to load.

FAR = 10**18
"""A number that no release has reached."""


@lru_cache(maxsize=4096)
def canonical(name: str) -> str:
    """Return a package's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


@lru_cache(maxsize=None)
def version(text: str) -> Version:
    """Return the version, parsed once. Raises ValueError."""
    from .vendored.packaging.version import Version  # noqa: PLC0415 - start-up

    return Version(text)


def is_version(text: str) -> bool:
    """Return whether a text is a version."""
    try:
        version(text)
    except ValueError:
        return False
    return True


def _spelt_out(clause: Specifier) -> Specifier:
    """Return a clause of `~=` with its version in the canonical form: 24.0 reads `~=1.0.pre3` as `==1.0.*`."""
    return type(clause)("~={}".format(version(clause.version))) if clause.operator == "~=" else clause


class Specifiers:
    """Several clauses, all of which hold: `>=1.2,<2,!=1.5`. Raises ValueError."""

    __slots__ = ("clauses", "text")

    def __init__(self, text: str) -> None:
        from .vendored.packaging.specifiers import SpecifierSet  # noqa: PLC0415 - start-up

        self.text = text
        self.clauses: Tuple[Specifier, ...] = tuple(map(_spelt_out, SpecifierSet(text)))

    def __bool__(self) -> bool:
        return bool(self.clauses)

    def __str__(self) -> str:
        return self.text

    def admits(self, text: str) -> bool:
        """Return whether a version fits, be it a prerelease; a text that is no version fits only `===`."""
        return _admits_all(self, text)

    def newest(self, texts: Iterable[str]) -> Optional[str]:
        """Return the greatest of several versions that fits; None if none does."""
        fitting = [text for text in texts if is_version(text) and self.admits(text)]
        return max(fitting, key=version) if fitting else None


@lru_cache(maxsize=None)  # a report asks the same of a package in each of its cells
def _admits_all(specifiers: Specifiers, text: str) -> bool:
    return all(_admits(clause, text) for clause in specifiers.clauses)


def _admits(clause: Specifier, text: str) -> bool:
    if clause.operator == "===":
        return text.strip().lower() == clause.version.lower()
    return is_version(text) and bool(clause.contains(version(text), prereleases=True))


@lru_cache(maxsize=None)
def specifiers(text: str) -> Specifiers:
    """Return the specifiers, parsed once. Raises ValueError."""
    return Specifiers(text)


# --- whether anything can fit ----------------------------------------------------------------------------------


def unsatisfiable(together: Iterable[Specifiers]) -> bool:
    """Return whether no version, be it a prerelease, fits all: none at their bounds, or next to one of them."""
    every = [clause for each in together for clause in each.clauses]
    if [clause.operator for clause in every] == ["=="]:
        return False
    named = [clause.version for clause in every if clause.operator == "==="]
    # `===` admits only its own text, so nothing else needs a try. The 1 is for specifiers without any clause.
    near = named or ["1", *(text for clause in every for text in _near(clause))]
    return not any(all(_admits(clause, text) for clause in every) for text in near)


def _near(clause: Specifier) -> Iterator[str]:
    """Yield versions at a bound, right before it and right after it, of every kind of release."""
    starred = clause.version.endswith(".*")
    bound = version(clause.version[:-2] if starred else clause.version)
    prefix = bound.release if starred else bound.release[:-1] if clause.operator == "~=" else ()
    if prefix:
        yield from _around(bound.epoch, prefix)
        yield from _around(bound.epoch, (*prefix[:-1], prefix[-1] + 1))
    if not starred:
        yield str(bound)
        yield from _close(bound)
        yield from _around(bound.epoch, bound.release)


def _around(epoch: int, release: Tuple[int, ...]) -> Iterator[str]:
    """Yield the first and last versions of a release, the first one after it and the last one before it."""
    start = "{}!".format(epoch) if epoch else ""
    whole = start + ".".join(map(str, release))
    yield from (whole, whole + ".dev0", whole + ".post{}".format(FAR), whole + ".0.0.0.0.1", whole + ".0.0.0.0.1.dev0")
    yield "{}.{}".format(whole, FAR)
    yield "{}rc{}".format(whole, FAR)
    short = _trimmed(release)
    if short[-1]:
        yield start + ".".join(map(str, (*short[:-1], short[-1] - 1, FAR)))
    elif epoch:
        yield "{}!{}".format(epoch - 1, FAR) if epoch > 1 else str(FAR)


def _trimmed(release: Tuple[int, ...]) -> Tuple[int, ...]:
    """Return a release without the zeros at its end."""
    while len(release) > 1 and release[-1] == 0:
        release = release[:-1]
    return release


def _close(bound: Version) -> Iterator[str]:
    """Yield the neighbours of one version, before and after it."""
    public = bound.public
    yield public + "+0"
    yield "{}+{}".format(public, FAR)
    if bound.local:
        yield "{}.0".format(bound)
    stem = public.partition(".dev")[0]
    if bound.dev is not None:
        yield "{}.dev{}".format(stem, bound.dev + 1)
        yield from ["{}.dev{}".format(stem, bound.dev - 1)] if bound.dev else ()
    else:
        yield "{}.dev{}".format(stem, FAR)
    if bound.post is None:
        yield stem + ".post0.dev0"
    else:
        until = stem.partition(".post")[0]
        yield "{}.post{}.dev0".format(until, bound.post + 1)
        yield from ["{}.post{}".format(until, bound.post - 1)] if bound.post else [until, until + "+0"]
    if bound.pre:
        until = stem.partition(".post")[0][: -len(str(bound.pre[1]))]
        yield "{}{}.dev0".format(until, bound.pre[1] + 1)
        yield from ["{}{}.post{}".format(until, bound.pre[1] - 1, FAR)] if bound.pre[1] else ()
