"""Say what is read of a package: which of its releases, which file of each, and which Python imports it."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.version import Version

from harness.machine import interpreters
from harness.model import Artifact, Interpreter, decoding
from harness.packages import index

FIRST_PYTHON = Version("3.7")
"""The first Python of a harness's environments."""


BUILD_SCRIPT = "setup.py"
"""The file of an sdist that says for which macros its sources in C are compiled."""

PARTS = {"major": 1, "minor": 2}


class PackagePlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The releases of a package that are read, and what is read of them.

    `each` is "release" for every release, "minor" or "major" for the first and the last of each such version, "newest"
    for the newest one; those before `since` are not read. `imports` are the top-level modules, empty where the files
    tell; `run` those to import. With `big` only the names of files and
    the metadata are read; by default this depends on the size of the newest wheel. `sdists` is False where a source
    does not have the names that its wheel has. `c_sources` are the files of an sdist with the names of modules in C, by
    module, and `source_root` is its folder of modules in Python; such an sdist is read until these have passed.
    `without` are modules that are not read, and parameters are left out where `signatures` is False.
    """

    each: str = "release"
    since: str = "0"
    imports: tuple[str, ...] = ()
    run: tuple[str, ...] = ()
    big: bool | None = None
    sdists: bool = True
    c_sources: dict[str, str] = {}
    source_root: str = ""
    without: tuple[str, ...] = ()
    signatures: bool = True

    def places(self) -> tuple[str, ...]:
        """Return the files and the folder of an sdist that are read, if its names are in sources in C."""
        root = (f"{self.source_root}/",) if self.source_root else ()
        return ("PKG-INFO", BUILD_SCRIPT, *self.c_sources.values(), *root)


LISTED = PackagePlan(each="newest", big=True)


class Plan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All packages to read. `helpers` are installed beside what is imported.

    `searched` are the packages whose names are looked for where a line names no package. Of the `listed` packages all
    releases are listed, and the files of the newest one tell the import names.
    """

    helpers: tuple[str, ...]
    searched: tuple[str, ...] = ()
    listed: tuple[str, ...] = ()
    packages: dict[str, PackagePlan]

    def all_packages(self) -> dict[str, PackagePlan]:
        """Return all packages, in the order in which they have names that several bring."""
        return {**self.packages, **dict.fromkeys(self.listed, LISTED)}


@dataclass(frozen=True, kw_only=True, slots=True)
class ChosenFile:
    """The file to read of a release, and a Python of this machine that may import it."""

    artifact: Artifact
    python: Interpreter | None


def load(file: Path) -> Plan:
    """Return the plan in a file."""
    plain: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8"))
    return decoding.convert(plain, Plan)


def choose(
    package: PackagePlan, releases: Sequence[index.Release], files: Mapping[str, Sequence[Artifact]]
) -> dict[str, ChosenFile]:
    """Return the file to read of each release that is read, by version."""
    chosen = {}
    for release in releases:
        version = Version(release.version)
        is_read = not version.is_prerelease and version >= Version(package.since)
        file = _file(package, release, files) if is_read else None
        if file is not None:
            chosen[release.version] = file
    if package.each == "release":
        return chosen
    versions = [release.version for release in releases if release.version in chosen and not release.yanked]
    wanted = versions[-1:] if package.each == "newest" else first_and_last(versions, parts=PARTS[package.each])
    return {version: chosen[version] for version in wanted}


def first_and_last(versions: Iterable[str], parts: int) -> list[str]:
    """Return of ordered versions the first and the last of those that have their first parts in common."""
    groups: dict[tuple[int, ...], list[str]] = {}
    for version in versions:
        release = (*Version(version).release, 0, 0)
        groups.setdefault((Version(version).epoch, *release[:parts]), []).append(version)
    return [version for some in groups.values() for version in dict.fromkeys((some[0], some[-1]))]


def _file(package: PackagePlan, release: index.Release, files: Mapping[str, Sequence[Artifact]]) -> ChosenFile | None:
    """Return the file to read: a wheel rather than an sdist.

    Of wheels for one Python each, the one for the oldest: those for newer ones lack what their Python lost.
    """
    some = files.get(release.version, ())
    pythons = [item for item in interpreters.available() if _admits(release.requires_python, item.version)]
    pythons.sort(key=lambda item: Version(item.version))
    wheels = [item for item in some if re.search(r"-(any|[^-]*linux[^-]*_x86_64)\.whl$", item.filename)]
    importable = next(_importable(wheels, pythons), None)
    if importable or (wheels and not package.run):
        return importable or ChosenFile(artifact=wheels[0], python=None)
    sources = [item for item in some if item.filename.endswith((".tar.gz", ".zip"))]
    if sources and package.sdists:
        return ChosenFile(artifact=sources[0], python=_near(pythons, release.uploaded))
    return None


def _importable(wheels: Sequence[Artifact], pythons: Sequence[Interpreter]) -> Iterator[ChosenFile]:
    """Yield the wheels that a Python of this machine can import, the best first; Pythons are ordered."""
    fits = {_fits_any: [*reversed(pythons)], _fits_one: pythons}
    for is_for, ordered in fits.items():
        for python in ordered:
            for artifact in wheels:
                if is_for(artifact.filename, Version(python.version)):
                    yield ChosenFile(artifact=artifact, python=python)


def _fits_any(wheel: str, python: Version) -> bool:
    """Return whether a wheel is for several Pythons, this one among them."""
    stable = re.search(r"-cp3(\d+)-abi3-", wheel)
    return int(stable[1]) <= python.minor if stable else re.search(r"-(py3|py2\.py3|py3\d)-", wheel) is not None


def _fits_one(wheel: str, python: Version) -> bool:
    return f"-cp{python.major}{python.minor}-" in wheel


def _near(pythons: Sequence[Interpreter], uploaded: str | None) -> Interpreter | None:
    """Return the Python that most of its time used, of ordered ones, for a source: the oldest before 2022."""
    if not pythons:
        return None
    return pythons[0] if (uploaded or "") < "2022" else pythons[len(pythons) // 2]


def _admits(requires: str | None, version: str) -> bool:
    try:
        return Version(version) >= FIRST_PYTHON and SpecifierSet(requires or "").contains(version)
    except InvalidSpecifier:
        return True
