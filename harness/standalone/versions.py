"""Names and versions of packages, and which versions a specifier admits (PEP 440, 503). Prereleases are admitted."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any, Iterable, Iterator, Tuple

VERSION = re.compile(
    r"""\s*v?
    (?:(?P<epoch>[0-9]+)!)?
    (?P<release>[0-9]+(?:\.[0-9]+)*)
    (?:[-_.]?(?P<pre>alpha|beta|preview|pre|rc|a|b|c)[-_.]?(?P<pre_number>[0-9]*))?
    (?:-(?P<bare_post>[0-9]+)|[-_.]?(?P<post>post|rev|r)[-_.]?(?P<post_number>[0-9]*))?
    (?:[-_.]?(?P<dev>dev)[-_.]?(?P<dev_number>[0-9]*))?
    (?:\+(?P<local>[a-z0-9]+(?:[-_.][a-z0-9]+)*))?
    \s*""",
    re.VERBOSE | re.IGNORECASE | re.ASCII,
)
SPELLED = {"alpha": "a", "beta": "b", "c": "rc", "pre": "rc", "preview": "rc"}
STAGES = {"a": 0, "b": 1, "rc": 2}
BEFORE_ALL, FINAL = (-1, 0), (3, 0)
"""In place of a stage: of a development release that is before all prereleases, and of what is none."""

OPERATOR = re.compile(r"(===|~=|==|!=|<=|>=|<|>)\s*(.*)", re.DOTALL)
RELEASE = re.compile(r"\s*v?(?:([0-9]+)!)?([0-9]+(?:\.[0-9]+)*)\s*", re.IGNORECASE | re.ASCII)
ARBITRARY = re.compile(r"[^\s;)]+")
FAR = 10**18
"""A number that no release has reached."""


def canonical(name: str) -> str:
    """Return a package's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


class Version:
    """A version. Raises ValueError for a text that is none."""

    __slots__ = ("dev", "epoch", "key", "local", "post", "pre", "release")

    def __init__(self, text: str) -> None:
        found = VERSION.fullmatch(text)
        if not found:
            message = '"{}" is not a version'.format(text)
            raise ValueError(message)
        said = found.groupdict()
        self.epoch = int(said["epoch"] or 0)
        self.release = tuple(int(part) for part in said["release"].split("."))
        stage = (said["pre"] or "").lower()
        self.pre = (SPELLED.get(stage, stage), int(said["pre_number"] or 0)) if stage else None
        posted = said["post"] or said["bare_post"]
        self.post = int(said["bare_post"] or said["post_number"] or 0) if posted else None
        self.dev = int(said["dev_number"] or 0) if said["dev"] else None
        parts = re.split(r"[-_.]", said["local"].lower()) if said["local"] else []
        self.local = tuple(int(part) if part.isdigit() else part for part in parts)
        self.key = self._key()

    def _key(self) -> Tuple[Any, ...]:
        if self.pre:
            stage = (STAGES[self.pre[0]], self.pre[1])
        else:
            stage = BEFORE_ALL if self.dev is not None and self.post is None else FINAL
        return (
            self.epoch,
            trimmed(self.release),
            stage,
            -1 if self.post is None else self.post,
            float("inf") if self.dev is None else self.dev,
            tuple((1, part, "") if isinstance(part, int) else (0, 0, part) for part in self.local),
        )

    @property
    def public(self) -> Tuple[Any, ...]:
        """Return the key to compare where a local label does not count."""
        return self.key[:5]

    @property
    def base(self) -> Tuple[Any, ...]:
        """Return epoch and release."""
        return self.key[:2]

    @property
    def is_prerelease(self) -> bool:
        """Return whether it is a development release or a prerelease."""
        return self.pre is not None or self.dev is not None

    def __str__(self) -> str:
        text = ("{}!".format(self.epoch) if self.epoch else "") + ".".join(map(str, self.release))
        text += "{}{}".format(*self.pre) if self.pre else ""
        text += ".post{}".format(self.post) if self.post is not None else ""
        text += ".dev{}".format(self.dev) if self.dev is not None else ""
        return text + ("+" + ".".join(map(str, self.local)) if self.local else "")

    def __repr__(self) -> str:
        return "Version({!r})".format(str(self))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Version) and self.key == other.key

    def __lt__(self, other: Version) -> bool:
        return bool(self.key < other.key)

    def __le__(self, other: Version) -> bool:
        return bool(self.key <= other.key)

    def __gt__(self, other: Version) -> bool:
        return bool(self.key > other.key)

    def __ge__(self, other: Version) -> bool:
        return bool(self.key >= other.key)

    def __hash__(self) -> int:
        return hash(self.key)


def trimmed(release: Tuple[int, ...]) -> Tuple[int, ...]:
    """Return a release without the zeros at its end."""
    end = len(release)
    while end > 1 and release[end - 1] == 0:
        end -= 1
    return release[:end]


@lru_cache(maxsize=None)
def version(text: str) -> Version:
    """Return the version, parsed once. Raises ValueError."""
    return Version(text)


def is_version(text: str) -> bool:
    """Return whether a text is a version."""
    return VERSION.fullmatch(text) is not None


# --- specifiers ------------------------------------------------------------------------------------------------


class Clause:
    """One operator and its version: `>=1.2`, `==1.2.*`. Raises ValueError."""

    __slots__ = ("bound", "operator", "prefix", "text")

    def __init__(self, text: str) -> None:
        found = OPERATOR.fullmatch(text.strip())
        if not found:
            message = '"{}" is not a specifier such as ">=1.2"'.format(text)
            raise ValueError(message)
        self.operator, self.text = found.group(1), found.group(2).strip()
        self.bound = None  # type: Version | None
        self.prefix = None  # type: Tuple[int, Tuple[int, ...]] | None
        if not self._read():
            message = '"{}" is not a specifier such as ">=1.2"'.format(text)
            raise ValueError(message)

    def _read(self) -> bool:
        if self.operator == "===":
            return ARBITRARY.fullmatch(self.text) is not None
        if self.operator in {"==", "!="} and self.text.endswith(".*"):
            release = RELEASE.fullmatch(self.text[:-2])
            if release is None or self.text[:-2] != self.text[:-2].strip():
                return False
            self.prefix = int(release.group(1) or 0), tuple(int(part) for part in release.group(2).split("."))
            return True
        if not is_version(self.text):
            return False
        self.bound = version(self.text)
        if self.operator == "~=":
            self.prefix = self.bound.epoch, self.bound.release[:-1]
            return len(self.bound.release) > 1 and not self.bound.local
        return self.operator in {"==", "!="} or not self.bound.local

    def admits_text(self, text: str) -> bool:
        """Return whether a version fits; what is none fits only where `===` names it."""
        if is_version(text):
            return self.admits(version(text), text)
        return self.operator == "===" and text.strip().lower() == self.text.lower()

    def admits(self, one: Version, text: str) -> bool:
        """Return whether a version fits; `text` is how it was written."""
        if self.operator == "===":
            return text.strip().lower() == self.text.lower()
        if self.operator == "~=":
            return self._ordered(one, ">=") and self._begins(one)
        if self.operator in {"==", "!="}:
            return self._equal(one) is (self.operator == "==")
        return self._ordered(one, self.operator)

    def _equal(self, one: Version) -> bool:
        if self.bound is None:
            return self._begins(one)
        return one.key == self.bound.key if self.bound.local else one.public == self.bound.public

    def _begins(self, one: Version) -> bool:
        epoch, prefix = self.prefix or (0, ())
        padded = one.release + (0,) * (len(prefix) - len(one.release))
        return one.epoch == epoch and padded[: len(prefix)] == prefix

    def _ordered(self, one: Version, operator: str) -> bool:
        bound = self.bound
        if bound is None:
            return False
        if operator == "<=":
            return bool(one.public <= bound.public)
        if operator == ">=":
            return bool(one.public >= bound.public)
        if operator == "<":
            first = (*bound.base, BEFORE_ALL if bound.post is None else FINAL, bound.key[3], 0, ())
            return one.key < (bound.key if bound.is_prerelease else first)
        late = one.post is not None and bound.post is None and bound.dev is None and one.key[:3] == bound.key[:3]
        return one > bound and not late and not (one.local and one.public == bound.public)


class Specifiers:
    """Several clauses, all of which hold: `>=1.2,<2,!=1.5`. Raises ValueError."""

    __slots__ = ("clauses", "text")

    def __init__(self, text: str) -> None:
        self.text = text
        self.clauses = tuple(Clause(part) for part in text.split(",") if part.strip())

    def __bool__(self) -> bool:
        return bool(self.clauses)

    def __str__(self) -> str:
        return self.text

    def admits(self, text: str) -> bool:
        """Return whether a version fits, be it a prerelease; a text that is no version fits only `===`."""
        return all(one.admits_text(text) for one in self.clauses)

    def newest(self, texts: Iterable[str]) -> str | None:
        """Return the greatest of several versions that fits; None if none does."""
        fitting = [text for text in texts if is_version(text) and self.admits(text)]
        return max(fitting, key=version) if fitting else None


@lru_cache(maxsize=None)
def specifiers(text: str) -> Specifiers:
    """Return the specifiers, parsed once. Raises ValueError."""
    return Specifiers(text)


# --- whether anything can fit ----------------------------------------------------------------------------------


def unsatisfiable(together: Iterable[Specifiers]) -> bool:
    """Return whether no version, be it a prerelease, fits all: none at their bounds, or next to one of them."""
    every = [clause for each in together for clause in each.clauses]
    named = [clause.text for clause in every if clause.operator == "==="]
    near = named or ["1", *(text for clause in every for text in _near(clause))]
    return not any(all(clause.admits_text(text) for clause in every) for text in near)


def _near(clause: Clause) -> Iterator[str]:
    """Yield versions at a bound, right before it and right after it, of every kind of release."""
    if clause.prefix:
        epoch, release = clause.prefix
        yield from _around(epoch, release)
        yield from _around(epoch, (*release[:-1], release[-1] + 1)) if release else ()
    if clause.bound:
        bound = clause.bound
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
    short = trimmed(release)
    if short[-1]:
        yield start + ".".join(map(str, (*short[:-1], short[-1] - 1, FAR)))
    elif epoch:
        yield "{}!{}".format(epoch - 1, FAR) if epoch > 1 else str(FAR)


def _close(bound: Version) -> Iterator[str]:
    """Yield the neighbours of one version, before and after it."""
    public = str(bound).partition("+")[0]
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
