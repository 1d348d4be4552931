"""Read which packages lie in an environment from the metadata in its site-packages, without running it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from harness.model.hostile_data import Unreadable, raise_unreadable

if TYPE_CHECKING:
    from harness.packages.environments.installed_package import Installed

KINDS = (".dist-info", ".egg-info")
LEADS_ON = "_simmatrix_below.pth"
"""What makes Python look on in the environment below."""


class Description(Struct, frozen=True, kw_only=True):
    """The metadata of an environment, read together.

    `modules` are the top-level modules of each package, as RECORD lists its files. `asking` are the packages that
    declare, in whatever extra, that they need a package. `unmet` are (package, requirement) pairs whose required
    package is missing, extras apart.
    """

    modules: dict[str, tuple[str, ...]]
    asking: dict[str, tuple[str, ...]]
    unmet: tuple[tuple[str, str], ...]


def describe(path: Path, names: Iterable[str]) -> Description:
    """Read all that is asked of an environment, each file once; `names` are those for `asking`. Raises Unreadable."""
    with raise_unreadable():
        packages = list(installed_packages(path))
        here, needs = {canonicalize_name(one.name) for one in packages}, list(_needs(packages))
        return Description(
            modules={canonicalize_name(one.name): top_level(one.paths()) for one in packages},
            asking={name: _asking(needs, name) for name in names},
            unmet=tuple(
                (asker, str(need))
                for asker, need in needs
                if canonicalize_name(need.name) not in here and "extra" not in str(need.marker or "")
            ),
        )


def versions(path: Path) -> dict[str, str]:
    """Return which packages an environment has, name to version. Raises Unreadable."""
    with raise_unreadable():
        return dict(sorted((canonicalize_name(one.name), plain(one.version)) for one in installed_packages(path)))


def requiring(path: Path, name: str) -> tuple[str, ...]:
    """Return the packages that declare, in whatever extra, that they need this one. Raises Unreadable."""
    with raise_unreadable():
        return _asking(_needs(installed_packages(path)), name)


def bounds(path: Path, name: str) -> tuple[SpecifierSet, ...]:
    """Return the bounds that packages declare on this one, in whatever extra. Raises Unreadable."""
    with raise_unreadable():
        needs = [need for _, need in _needs(installed_packages(path)) if canonicalize_name(need.name) == name]
        return tuple(dict.fromkeys(need.specifier for need in needs if need.specifier))


def _asking(needs: Iterable[tuple[str, Requirement]], name: str) -> tuple[str, ...]:
    return tuple(sorted({asker for asker, need in needs if canonicalize_name(need.name) == name}))


def installed_packages(path: Path) -> Iterator[Installed]:
    """Yield all installed packages, in the order of their folders' names."""
    from harness.packages.environments.installed_package import Installed  # noqa: PLC0415 - start-up

    for folder in folders(path):
        yield from (Installed(found) for found in sorted(folder.iterdir()) if found.name.endswith(KINDS))


def folders(path: Path) -> Iterator[Path]:
    """Yield the site-packages folder of an environment."""
    return path.glob("lib/python*/site-packages")


def plain(version: str) -> str:
    """Return a version in its normal form, or as it is if it is no valid version."""
    try:
        return str(Version(version))
    except InvalidVersion:
        return version


def _needs(packages: Iterable[Installed]) -> Iterator[tuple[str, Requirement]]:
    """Yield (package, requirement) pairs. Invalid lines are skipped: uv reads them as something else than they say."""
    for package in packages:
        asker = canonicalize_name(package.name)
        for line in package.requires or ():
            if need := _requirement(line):
                yield asker, need


def _requirement(line: str) -> Requirement | None:
    try:
        with raise_unreadable():
            return Requirement(line)
    except Unreadable:
        return None


def top_level(paths: Iterable[str]) -> tuple[str, ...]:
    """Return the top-level modules among the files of a package, sorted."""
    tops = {path.partition("/")[0].partition(".")[0] for path in paths if path.endswith((".py", ".so"))}
    return tuple(sorted(name for name in tops if name.isidentifier() and not name.startswith("_")))
