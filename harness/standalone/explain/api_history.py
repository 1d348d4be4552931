"""Read the history of a package: which names, modules and environments each of its releases offers.

The files are made by `harness/history`, one a package: two lines of JSON, gzipped one by one. The first has the
releases and what they require, the second the names. Spans are [first, last] places in `releases`.
"""

from __future__ import annotations

import gzip
import json
import re
import zlib
from functools import lru_cache
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from ..adapters import carried_file
from ..versions import version as parsed

FORM = 2

Spans = Sequence[Sequence[int]]

OLD = "2021"
"""A name that was there before this year is hardly missing for want of a newer release, unless a version is known."""

FEW = 5
"""Releases that a package had before it was published regularly."""

LATE = "2020"
"""A name that came since this year may be missing for want of a newer release, even if later ones lost it again."""

PYTHON = "python-library"
"""The name of the history of Python's own library."""

OLDEST = {PYTHON: "2018"}
"""Another year than `OLD`, for what people keep longer."""

BRIEF = 6
"""Months that a name lasted of which nobody can tell whether the release at hand is older or newer."""

ANCIENT = "2017"
"""Nobody runs a release from before this year: code that wants a name from then has another fault."""


class Availability(NamedTuple):
    """The releases that have a name: from `first` to `last`; `bound` is a requirement that leads there.

    `first` is None where the oldest release that was read has the name, `last` where the newest has it. `after` is the
    first release without it again. `too_new` says which side the environment at hand is on.
    """

    package: str
    first: Optional[str]
    last: Optional[str]
    after: Optional[str]
    too_new: bool
    bound: str


class Contents(Mapping[str, Any]):
    """The contents of a file: the first line, and the others as soon as one of their keys is asked for."""

    def __init__(self, first: Mapping[str, Any], rest: Callable[[], bytes]) -> None:
        self._plain = dict(first)
        self._rest: Optional[Callable[[], bytes]] = rest

    def __getitem__(self, key: str) -> Any:
        if key not in self._plain:
            self._read_all()
        return self._plain[key]

    def __iter__(self) -> Iterator[str]:
        self._read_all()
        return iter(self._plain)

    def __len__(self) -> int:
        self._read_all()
        return len(self._plain)

    def _read_all(self) -> None:
        rest, self._rest = self._rest, None
        text = rest() if rest else b""
        if text.strip():
            self._plain.update(json.loads(text.decode("utf-8")))


class History:
    """The history of one package."""

    def __init__(self, plain: Mapping[str, Any]) -> None:
        self.plain = plain
        self.package = str(plain["package"])
        self.versions = [str(item["version"]) for item in plain["releases"]]
        self.read = [place for place, item in enumerate(plain["releases"]) if item.get("read")]
        self.ran = _places(plain.get("ran", ()))

    def spans(self, *path: str) -> Optional[Spans]:
        """Return the spans at a path of keys, such as `names`, `gym.spaces`, `Box`; None if no release has it."""
        place: Any = self.plain
        for key in path:
            place = place.get(key) if isinstance(place, Mapping) else None
        spans: Optional[Spans] = place
        return spans

    def where(
        self, spans: Optional[Spans], version: Optional[str], among: Optional[List[int]] = None
    ) -> Optional[Availability]:
        """Return where a name with these spans is to be had, for an environment that lacks it.

        None if no release has the name, if all have it, or if the release at hand (`version`) has it.
        """
        considered = self.read if among is None else among
        having = set(_places(spans or ())) & set(considered)
        if not having or len(having) == len(considered):
            return None
        here = self._place(version, considered) if version else None
        if here is not None and here in having:
            return None
        later = [place for place in considered if place in having and (here is None or place > here)]
        too_new = max(considered) not in having if here is None else not later
        if (
            here is None
            and not too_new
            and (self._uploaded(later[0]) < OLDEST.get(self.package, OLD) or self._begins_late(considered[0]))
        ):
            return None
        run = _last_run(having, considered) if here is None or too_new else _first_run(later, having, considered)
        first, last = run
        if here is None and too_new and "" < self._uploaded(last) < ANCIENT:
            return None
        after = next((place for place in considered if place > last), None)
        # An unknown release may as well be older than the first with a name that came lately.
        is_open = here is None and first != considered[0] and self._uploaded(first) >= LATE
        bounds = [] if too_new and after is not None and not is_open else [">={}".format(self.versions[first])]
        if after is not None:
            bounds.append(self._upper_bound(last, after))
        return Availability(
            package=self.package,
            first=self.versions[first] if first != considered[0] else None,
            last=self.versions[last] if after is not None else None,
            after=self.versions[after] if after is not None else None,
            too_new=too_new,
            bound=self.package + ",".join(bounds),
        )

    def _upper_bound(self, last: int, after: int) -> str:
        """Return the bound below which a name is surely there: nobody knows of releases between that were not read."""
        between = [version for version in self.versions[last + 1 : after] if not parsed(version).is_prerelease]
        return "<={}".format(self.versions[last]) if between else "<{}".format(self.versions[after])

    def _begins_late(self, place: int) -> bool:
        """Return whether a few releases of this time are older than the first one that was read: they may have a name.

        People took such a package from its repository before. A release 0.0.N holds the name of one that is to come.
        """
        earlier = self.plain["releases"][:place]
        versions = [parsed(str(each["version"])) for each in earlier if str(each.get("uploaded") or "") >= OLD]
        unread = [version for version in versions if not version.is_prerelease and version.release[:2] != (0, 0)]
        return 0 < len(unread) <= FEW

    def is_brief(self, there: Availability) -> bool:
        """Return whether a name came and went within half a year: an unknown release may be on either side of it."""
        if there.first is None or there.after is None:
            return False
        first, after = (self._uploaded(self.versions.index(version)) for version in (there.first, there.after))
        return 0 <= _months(after) - _months(first) < BRIEF

    def _uploaded(self, place: int) -> str:
        return str(self.plain["releases"][place].get("uploaded") or "")

    def _place(self, version: str, considered: Sequence[int]) -> Optional[int]:
        """Return the place of a release, or of the newest one that is older and was read."""
        older = [place for place in considered if parsed(self.versions[place]) <= parsed(version)]
        return older[-1] if older else None


Load = Callable[[str], Optional[History]]
"""Return the history of a package by its name, None where there is none."""


def no_history(_package: str) -> Optional[History]:
    """Return None: nothing is known of any package."""
    return None


IMPORTS = "imports.json.gz"
"""The table of import names, made with the histories."""

GZIP = 16 + zlib.MAX_WBITS
"""The setting of `zlib` that reads one part of a gzip file and leaves the next ones."""

PLACES = ("history", "../matrices/history", "../../matrices/history")
"""Folders of the histories: in the file that runs alone, in an installed harness, in its checkout."""


@lru_cache(maxsize=None)
def load_shipped(package: str) -> Optional[History]:
    """Return the history of a package that came with us; None where there is none."""
    contents = (carried_file("{}/{}.json.gz".format(place, package)) for place in PLACES)
    return next((decode(content) for content in contents if content is not None), None)


def decode(content: bytes) -> Optional[History]:
    """Return the history in a file; None if it has another form."""
    unpacker = zlib.decompressobj(GZIP)
    line, _, begun = unpacker.decompress(content).partition(b"\n")
    first = json.loads(line.decode("utf-8"))
    if first.get("form") != FORM:
        return None
    others = unpacker.unused_data
    return History(Contents(first, lambda: begun + (gzip.decompress(others) if others else b"")))


def has_wheel(entry: Mapping[str, Any], python: str) -> bool:
    """Return whether a release has a wheel for a Python (`3.N`) on Linux."""
    major, minor = python.split(".")[:2]
    own = re.compile(r"(?:cp{0}{1}|py3|py2\.py3)-".format(major, minor))
    return any(
        (own.match(tag) or ("abi3" in tag and _abi3(tag, int(minor)))) and ("any" in tag or "linux" in tag)
        for tag in entry.get("wheels", ())
    )


def _abi3(tag: str, minor: int) -> bool:
    least = re.match(r"cp3(\d+)", tag)
    return least is not None and int(least.group(1)) <= minor


@lru_cache(maxsize=None)
def _import_names() -> Mapping[str, Any]:
    """Return the table of import names that came with us: `imports`, those `gone`, packages `searched`."""
    contents = (carried_file("{}/{}".format(place, IMPORTS)) for place in PLACES)
    content = next((item for item in contents if item is not None), None)
    table: Mapping[str, Any] = json.loads(gzip.decompress(content).decode("utf-8")) if content else {}
    return table


def package_of(module: str) -> Optional[str]:
    """Return the package that has a module, by its dotted name."""
    name = _import_name(module)
    return str(_import_names()["imports"][name]) if name else None


def is_gone(module: str) -> bool:
    """Return whether the package of a module has it no more, as far as the start of its dotted name tells."""
    return _import_name(module) in _import_names().get("gone", ())


def _import_name(module: str) -> Optional[str]:
    """Return the longest import name that a dotted name begins with."""
    imports = _import_names().get("imports", {})
    parts = module.split(".")
    names = (".".join(parts[:length]) for length in range(len(parts), 0, -1))
    return next((name for name in names if name in imports), None)


class _SearchedImports(Mapping[str, str]):
    """The import names of the packages that are searched, as the plan of the histories says."""

    def _table(self) -> Dict[str, str]:
        searched = _import_names().get("searched", ())
        return {name: item for name, item in _import_names().get("imports", {}).items() if item in searched}

    def __getitem__(self, name: str) -> str:
        return self._table()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._table())

    def __len__(self) -> int:
        return len(self._table())


OF_IMPORT: Mapping[str, str] = _SearchedImports()
"""The package by its import name, of those that are searched where a line names no package."""


def _months(uploaded: str) -> int:
    """Return the number of months since the year 0 of a date such as `2018-02-09`; 0 without a date."""
    return int(uploaded[:4]) * 12 + int(uploaded[5:7]) if uploaded else 0


def _places(spans: Iterable[Sequence[int]]) -> List[int]:
    return [place for first, last in spans for place in range(first, last + 1)]


def _last_run(having: "set[int]", considered: Sequence[int]) -> Tuple[int, int]:
    """Return the first and last of the newest consecutive releases that have a name."""
    last = max(having)
    first = last
    for place in reversed([item for item in considered if item < last]):
        if place not in having:
            break
        first = place
    return first, last


def _first_run(later: Sequence[int], having: "set[int]", considered: Sequence[int]) -> Tuple[int, int]:
    """Return the first and last of the next consecutive releases that have a name."""
    first = last = later[0]
    for place in [item for item in considered if item > first]:
        if place not in having:
            break
        last = place
    return first, last
