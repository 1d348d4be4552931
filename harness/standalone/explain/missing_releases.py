"""Tell why a release cannot be had: it was never there, it wants another Python, or no wheel of it fits."""

from __future__ import annotations

import re
from typing import Any, List, Mapping, NamedTuple, Optional

from ..versions import canonical, is_version, specifiers
from ..versions import version as parsed
from .api_history import History, Load

NAME = r"([A-Za-z0-9][A-Za-z0-9._-]*)"
WANTED = re.compile(
    r"No matching distribution found for {0}(?:\[[\w,.-]*\])?(?:==(\d[\w.]*))?\s*(?:\(|$)".format(NAME), re.MULTILINE
)
BUILT = re.compile(
    r"(?:Failed building wheel for|Could not build wheels for|Failed to build(?: installable wheels for)?(?: some"
    r" pyproject\.toml based projects \()?|Failed to download and build) `?{0}(?:==(\d[\w.]*))?".format(NAME)
)


class MissingRelease(NamedTuple):
    """A release that cannot be had: `cause`, and `remedy` as documents hold it."""

    package: str
    cause: str
    remedy: Mapping[str, Any]


def find(line: str, versions: Mapping[str, str], python: Optional[str], load: Load) -> Optional[MissingRelease]:
    """Return why a release that a line of an installer names cannot be had; `python` is `3.N`, if it is known."""
    wanted, built = WANTED.search(line), BUILT.search(line)
    match = wanted or built
    if match is None:
        return None
    package = canonical(match.group(1))
    history = load(package)
    if history is None:
        return None
    version = match.group(2) or (versions.get(package) if built else None)
    if version is not None and is_version(version):
        return _of_version(history, version, python, built=wanted is None)
    return _of_any(history, python) if python else None


def _of_version(history: History, version: str, python: Optional[str], *, built: bool) -> Optional[MissingRelease]:
    package = history.package
    entry = next((one for one in history.plain["releases"] if parsed(one["version"]) == parsed(version)), None)
    if entry is None:
        below = [one for one in history.versions if parsed(one) < parsed(version)]
        above = [one for one in history.versions if parsed(one) > parsed(version)]
        if not above or not below:  # it may be newer than what we know
            return None
        cause = "{} has no release {}: {} is followed by {}".format(package, version, below[-1], above[0])
        return MissingRelease(package, cause, {"requirements": ["{}=={}".format(package, above[0])]})
    wants = str(entry.get("python") or "")
    if python and wants and not _admits(wants, python):
        cause = "{} {} wants Python {}, and this is Python {}".format(package, version, wants, python)
        other = _newest_for(history, python)
        text = "Or take {}=={}, the newest for Python {}.".format(package, other, python) if other else ""
        return MissingRelease(package, cause, {"python": wants, "text": text} if text else {"python": wants})
    if python and not has_wheel(entry, python) and (built or not entry.get("sdist")):
        return _of_any(history, python, version)
    return None


def _of_any(history: History, python: str, version: Optional[str] = None) -> Optional[MissingRelease]:
    """Return which release has a wheel for a Python, where the one asked for has none."""
    package, newest = history.package, _newest_for(history, python)
    name = "{} {}".format(package, version) if version else package
    cause = "{} has no wheel for Python {} on Linux".format(name, python)
    if newest is not None and newest != version:
        return MissingRelease(package, cause, {"requirements": ["{}=={}".format(package, newest)]})
    pythons = _pythons(history, version)
    if newest is None and pythons:
        return MissingRelease(
            package, cause, {"python": pythons[-1], "text": "Its wheels are for {}.".format(", ".join(pythons))}
        )
    return None


def _newest_for(history: History, python: str) -> Optional[str]:
    """Return the newest release with a wheel for a Python; None if there is none."""
    fitting = [
        one["version"]
        for one in history.plain["releases"]
        if not one.get("yanked") and has_wheel(one, python) and _admits(str(one.get("python") or ""), python)
    ]
    stable = [one for one in fitting if not parsed(one).is_prerelease]
    return str(stable[-1]) if stable else None


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


def _admits(wants: str, python: str) -> bool:
    try:
        return not wants or specifiers(wants).admits(python + ".99" if python.count(".") == 1 else python)
    except ValueError:
        return True


def _pythons(history: History, version: Optional[str]) -> List[str]:
    """Return the Pythons for which a release, or the newest one, has wheels."""
    releases = [one for one in history.plain["releases"] if version in {None, one["version"]} and one.get("wheels")]
    tags = releases[-1]["wheels"] if releases else ()
    minors = sorted({int(match.group(1)) for tag in tags for match in [re.match(r"cp3(\d+)-", tag)] if match})
    return ["3.{}".format(minor) for minor in minors]
