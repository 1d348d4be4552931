"""Explain why a release cannot be had: it was never there, it wants another Python, or no wheel of it fits."""

from __future__ import annotations

import re
from typing import Any, List, Mapping, Optional, Tuple

from ..explain.api_history import History, has_wheel
from ..versions import canonical, is_version, specifiers
from ..versions import version as parsed
from .scene import PACKAGE, Cause, Causes, Pattern, Scene

SPECIFIER = r"((?:[<>=!~]=?=?\s?[\w.*+!]+,?\s?)*)"
WANTED = Pattern(
    r"(?:No matching distribution found for|Could not find a version that satisfies the requirement)"
    r" ({0})(?:\[[\w,.-]*\])?\s?\(?{1}".format(PACKAGE, SPECIFIER),
    "No matching distribution", "Could not find a version",
)  # fmt: skip
LISTED = Pattern(r"\(from versions: ([^)]*)\)", "(from versions: ")
OTHER_PYTHON = Pattern(
    r"Package '({0})' requires a different Python: (\d\S*) not in '([^']+)'"
    r"|({0}) requires Python '([^']+)' but the running Python is (\d\S*)".format(PACKAGE),
    "requires a different Python", "but the running Python is",
)  # fmt: skip
PYTHONLESS = Pattern(
    r"(?:current|requested) Python version \((\d[\w.]*)\) does not satisfy Python([<>=!~][\w.,<>=!~*]*)"
    r"(?:[^.]*? and ({0})(?:\[[\w,-]+\])?(?:==(\S+?))? depends on Python)?".format(PACKAGE),
    "does not satisfy Python",
)
TAGS = Pattern(
    r"we only found wheels for `?({0})`? \(v?([\w.]+)\) with the following Python (?:ABI|implementation) tags?:"
    r" ([`\w, ]+)".format(PACKAGE),
    "we only found wheels for",
)
WANTS = Pattern(
    r"[Mm]ust use [Pp]ython ?(?:>=)? ?(3\.\d+)|[Rr]equires? (?:at least )?[Pp]ython ?(?:>=|version)? ?(3\.\d+)"
    r"(?:\.\d+)? ?(?:\+|or (?:newer|later|higher|above|greater))|[Pp]ython (3\.\d+)"
    r"(?:\+| or (?:newer|later|higher|above)) is required",
    "ython",
)
"""The line of a program about the Python that it needs."""

NO_VERSION = Pattern(
    r"there (?:is|are) no versions? of ({0})==(\d[\w.+!]*)".format(PACKAGE), "there is no", "there are"
)
USUAL = "3.9"
"""A Python that many still run: what excludes it is likely the reason where no Python is named."""

NIGHTLY = re.compile(r"\.dev\d+")


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where a line of an installer names a release that cannot be had."""
    for rule in (_other_python, _no_tag, _wanted, _no_version, _python_wanted):
        cause = rule(line, scene)
        if cause is not None:
            yield cause
            return


def _other_python(line: str, scene: Scene) -> Optional[Cause]:
    match, pythonless = OTHER_PYTHON.search(line), PYTHONLESS.search(line)
    if match:
        package, python, wants, other, wanted, running = match.groups()
        return _python_cause(package or other, None, wants or wanted, python or running, scene)
    if pythonless and pythonless.group(3):
        python, wants, package, version = pythonless.groups()
        return _python_cause(package, version, wants, python, scene)
    return None


def _python_cause(package: str, version: Optional[str], wants: str, python: str, scene: Scene) -> Cause:
    """Return the cause that a release wants another Python than the one that is there."""
    history = scene.load(canonical(package))
    name = "{} {}".format(package, version) if version else package
    text = "{} requires Python {}, and this is Python {}".format(name, wants, python)
    newest = newest_for(history, ".".join(python.split(".")[:2])) if history else None
    way = "Or install `{}=={}`, the newest for Python {}.".format(package, newest, python) if newest else ""
    return Cause("python", text, {"python": wants, "text": way} if way else {"python": wants})


def _python_wanted(line: str, scene: Scene) -> Optional[Cause]:
    match = WANTS.search(line)
    if match is None or not re.search(r"Error|error|Exception|must|Must", line):
        return None
    version = next(filter(None, match.groups()))
    text = "the program needs Python {} or newer, and an older one runs it".format(version)
    return Cause("python", text, {"python": ">={}".format(version)})


def _no_tag(line: str, scene: Scene) -> Optional[Cause]:
    match = TAGS.search(line)
    if match is None:
        return None
    package, version, tags = match.groups()
    pythons = ["3.{}".format(minor) for minor in re.findall(r"\bcp3(\d+)\b", tags)]
    if not pythons:
        return None
    text = "{} {} has wheels for Python {} only".format(package, version, ", ".join(pythons))
    return Cause("python", text, {"python": pythons[-1]})


def _wanted(line: str, scene: Scene) -> Optional[Cause]:
    match = WANTED.search(line)
    if match is None:
        return None
    package, bound = canonical(match.group(1)), match.group(2).replace(" ", "").rstrip(",")
    history, listed = scene.load(package), _listed(line) or _listed(scene.failure.text)
    cause = _of_history(history, bound, scene.python) if history else None
    if cause is None and listed and bound:
        return _of_list(package, bound, listed, scene.python)
    if cause is None and history and scene.python is None and "from versions: none" not in scene.failure.text:
        return _of_wheels(history, bound)
    return cause


def _of_wheels(history: History, bound: str) -> Optional[Cause]:
    """Return for which Pythons a release has wheels for every system: the running Python is none of these."""
    entry: Mapping[str, Any] = next(
        (each for each in history.plain["releases"] if bound == "=={}".format(each["version"])), {}
    )
    tags = entry.get("wheels", ())
    systems = [{"wheels": [tag for tag in tags if system in tag]} for system in ("linux", "macosx", "win_amd64")]
    pythons = sorted(set.intersection(*(set(minors(each)) for each in systems)))
    plain = all(re.match(r"cp3\d+-", tag) and "abi3" not in tag for tag in tags)
    if entry.get("yanked") or not (pythons and plain) or len(pythons) <= pythons[-1] - pythons[0]:
        return None
    first, last = pythons[0], pythons[-1]
    text = "{} {} exists, and its wheels are for Python 3.{} to 3.{}; pip finds none for the running Python".format(
        history.package, entry["version"], first, last
    )
    return Cause("python", text, {"python": ">=3.{},<3.{}".format(first, last + 1)})


def _listed(text: str) -> List[str]:
    """Return the releases that pip could see: those for this Python and platform."""
    match = LISTED.search(text)
    return [each.strip() for each in match.group(1).split(",") if is_version(each.strip())] if match else []


def _of_list(package: str, bound: str, listed: List[str], python: Optional[str]) -> Optional[Cause]:
    """Return the cause by the releases that pip lists; None where one of them fits."""
    allowed = _specifiers(bound)
    if allowed is None or any(allowed.admits(each) for each in listed):
        return None
    newest = max(listed, key=parsed)
    least = re.match(r"(?:==|>=|~=|>)(\d[\w.]*)", bound)
    side = "is newer than all of them" if least and parsed(least.group(1)) > parsed(newest) else "is not among them"
    text = "the newest {} that installs on this Python and platform is {}, and {}{} {}".format(
        package, newest, package, bound, side
    )
    way = "Or use a newer Python, if you need a newer {}.".format(package) if "newer" in side else ""
    remedy = {"requirements": ["{}=={}".format(package, newest)]}
    return Cause(package, text, dict(remedy, text=way) if way else remedy)


def _no_version(line: str, scene: Scene) -> Optional[Cause]:
    match = NO_VERSION.search(line)
    if match is None:
        return None
    package, version = canonical(match.group(1)), match.group(2).rstrip(".,")
    history = scene.load(package)
    if NIGHTLY.search(version):
        text = "{} {} is a nightly build; an index keeps such builds for a few weeks only".format(package, version)
        stable = version.partition(".dev")[0]
        newer = [each for each in history.versions if parsed(each) >= parsed(stable)] if history else []
        bound = "{}>={}".format(package, newer[0] if newer else stable)
        return Cause(package, text, {"requirements": [bound]})
    return of_version(history, version, scene.python, built=False) if history and is_version(version) else None


# --- histories -------------------------------------------------------------------------------------------------


def _of_history(history: History, bound: str, python: Optional[str]) -> Optional[Cause]:
    exact = re.match(r"==(\d[\w.]*)$", bound)
    if exact and is_version(exact.group(1)):
        return of_version(history, exact.group(1), python, built=False)
    allowed = _specifiers(bound) if bound else None
    if allowed is not None:
        fitting = [entry for entry in history.plain["releases"] if allowed.admits(str(entry["version"]))]
        return _of_range(history, bound, fitting, python) if fitting else None
    return of_any(history, python) if python and not bound else None


def _of_range(history: History, bound: str, fitting: List[Any], python: Optional[str]) -> Optional[Cause]:
    """Return why none of the releases within a bound can be had: there are some, but for other Pythons."""
    pythons = sorted({minor for entry in fitting for minor in minors(entry)})
    if any(entry.get("sdist") or "py3-none-any" in entry.get("wheels", ()) for entry in fitting) or not pythons:
        return None
    if python is not None and int(python.split(".")[1]) in pythons:
        return None
    named = ", ".join("3.{}".format(minor) for minor in pythons)
    text = "{}{} has wheels for Python {} only".format(history.package, bound, named)
    return Cause(
        "python", text, {"python": "3.{}".format(pythons[-1]), "text": "Its wheels need one of these Pythons."}
    )


def of_version(history: History, version: str, python: Optional[str], *, built: bool) -> Optional[Cause]:
    """Return why a release cannot be had; `built` is whether an installer tried to build it."""
    package = history.package
    entry = next((each for each in history.plain["releases"] if parsed(each["version"]) == parsed(version)), None)
    if entry is None:
        below = [each for each in history.versions if parsed(each) < parsed(version)]
        above = [each for each in history.versions if parsed(each) > parsed(version)]
        if not above or not below:  # it may be newer than what we know
            return None
        text = "{} has no release {}: {} is followed by {}".format(package, version, below[-1], above[0])
        return Cause(package, text, {"requirements": ["{}=={}".format(package, above[0])]})
    wants = str(entry.get("python") or "")
    if python and wants and not _admits(wants, python):
        return _of_python(history, version, wants, python)
    if python and not has_wheel(entry, python) and (built or not entry.get("sdist")):
        return of_any(history, python, version)
    if not python and not built and not _admits(wants, USUAL):
        text = "{} {} exists and requires Python {}; pip does not list what the running Python cannot use".format(
            package, version, wants
        )
        return Cause("python", text, {"python": wants})
    return None


def has_one(history: History, version: str, python: str) -> bool:
    """Return whether a release has a wheel for a Python on Linux."""
    return any(each["version"] == version and has_wheel(each, python) for each in history.plain["releases"])


def _of_python(history: History, version: str, wants: str, python: str) -> Cause:
    package, other = history.package, newest_for(history, python)
    text = "{} {} requires Python {}, and this is Python {}".format(package, version, wants, python)
    way = "Or install `{}=={}`, the newest for Python {}.".format(package, other, python) if other else ""
    return Cause(package, text, {"python": wants, "text": way} if way else {"python": wants})


def of_any(history: History, python: str, version: Optional[str] = None) -> Optional[Cause]:
    """Return which release has a wheel for a Python, where the one asked for has none."""
    package, newest = history.package, newest_for(history, python)
    name = "{} {}".format(package, version) if version else package
    text = "{} has no wheel for Python {} on Linux".format(name, python)
    if newest is not None and version is None:
        text = "{} {} is its newest release with a wheel for Python {} on Linux; this one was built, and that failed"
        text = text.format(package, newest, python)
    if newest is not None and newest != version:
        return Cause(package, text, {"requirements": ["{}=={}".format(package, newest)]})
    pythons = wheel_pythons(history, version)
    if newest is None and pythons:
        return Cause(
            package, text, {"python": pythons[-1], "text": "Its wheels are for {}.".format(", ".join(pythons))}
        )
    return None


def newest_for(history: History, python: str) -> Optional[str]:
    """Return the newest release with a wheel for a Python; None if there is none."""
    fitting = [
        each["version"]
        for each in history.plain["releases"]
        if not each.get("yanked") and has_wheel(each, python) and _admits(str(each.get("python") or ""), python)
    ]
    stable = [each for each in fitting if not parsed(each).is_prerelease]
    return str(stable[-1]) if stable else None


def last_with_wheels(history: History) -> Tuple[Optional[str], List[str]]:
    """Return the newest release that has wheels, and the Pythons that they are for."""
    having = [each for each in history.plain["releases"] if minors(each) and not each.get("yanked")]
    return (
        (str(having[-1]["version"]), ["3.{}".format(minor) for minor in minors(having[-1])]) if having else (None, [])
    )


def minors(entry: Mapping[str, Any]) -> List[int]:
    """Return the minor versions of Python 3 that the wheels of a release are built for."""
    return sorted(
        {int(match.group(1)) for tag in entry.get("wheels", ()) for match in [re.match(r"cp3(\d+)-", tag)] if match}
    )


def wheel_pythons(history: History, version: Optional[str]) -> List[str]:
    """Return the Pythons for which a release, or the newest one, has wheels."""
    releases = [each for each in history.plain["releases"] if version in {None, each["version"]} and each.get("wheels")]
    return ["3.{}".format(minor) for minor in minors(releases[-1])] if releases else []


def _admits(wants: str, python: str) -> bool:
    allowed = _specifiers(wants) if wants else None
    return allowed is None or allowed.admits(python + ".99" if python.count(".") == 1 else python)


def _specifiers(text: str) -> Any:
    try:
        return specifiers(text)
    except ValueError:
        return None
