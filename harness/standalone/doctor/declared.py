"""Compare the declarations of an environment's packages with the versions and files that are there."""

from __future__ import annotations

import os
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Set

from ..keys import MODULES, weight
from ..requirements import Requirement, requirement
from ..versions import canonical, specifiers
from .differences import effective

Told = Mapping[str, Any]
NOTE, WARNING = "note", "warning"
SHOWN = 3


class Finding(NamedTuple):
    """One finding of `doctor`: the check that made it, its level (note or warning), and its text."""

    check: str
    level: str
    text: str

    def plain(self) -> Dict[str, str]:
        """Return the finding as a plain dict."""
        return dict(self._asdict())


class Unmet(NamedTuple):
    """A requirement that is not met; `there` is the installed version, None if the package is missing."""

    asker: str
    text: str
    name: str
    there: Any


def environment(facts: Told) -> Dict[str, str]:
    """Return the values of the variables that markers use (PEP 508)."""
    python = facts["python"]
    whole = python["version"]
    return {
        "python_version": ".".join(whole.split(".")[:2]),
        "python_full_version": whole,
        "os_name": python["os_name"],
        "sys_platform": "linux" if python["system"] == "Linux" else python["system"].lower(),
        "platform_release": python["release"],
        "platform_system": python["system"],
        "platform_version": python["platform_version"],
        "platform_machine": python["machine"],
        "platform_python_implementation": {"cpython": "CPython", "pypy": "PyPy"}.get(
            python["implementation"], python["implementation"]
        ),
        "implementation_name": python["implementation"],
        "implementation_version": whole,
    }


# --- requirements ----------------------------------------------------------------------------------------------


def asked(facts: Told) -> Dict[str, List[Requirement]]:
    """Return the requirements of each package that apply here, including the extras that other packages ask for."""
    about, there = environment(facts), effective(facts)
    extras: Dict[str, Set[str]] = {name: set() for name in there}
    found: Dict[str, List[Requirement]] = {}
    growing = True
    while growing:
        growing = False
        for name, one in there.items():
            found[name] = list(_wanted(one, about, extras[name]))
            for each in found[name]:
                if each.name in extras and not extras[each.name] >= each.extras:
                    extras[each.name] |= each.extras
                    growing = True
    return found


def _wanted(one: Told, about: Mapping[str, str], extras: Set[str]) -> Iterator[Requirement]:
    for text in one["requires"]:
        try:
            made = requirement(text)
            if made.wanted(about, extras):
                yield made
        except (ValueError, KeyError):
            continue


def unmet(facts: Told, versions: Mapping[str, str]) -> List[Unmet]:
    """Return the requirements that these versions do not meet, those of the packages that matter most first."""
    found = [
        Unmet(name, plain(each), each.name, versions.get(each.name))
        for name, requirements in asked(facts).items()
        for each in requirements
        if not _met(each, versions)
    ]
    return sorted(dict.fromkeys(found), key=lambda one: -max(weight(one.asker), weight(one.name)))


def _met(one: Requirement, versions: Mapping[str, str]) -> bool:
    there = versions.get(one.name)
    if there is None:
        return False
    return one.url is not None or one.specifiers.admits(there)


def plain(one: Requirement) -> str:
    """Return a requirement as text: name, extras and specifiers, without its marker."""
    extras = "[{}]".format(",".join(sorted(one.extras))) if one.extras else ""
    return "{}{}{}".format(one.name, extras, one.specifiers)


def conflicts(facts: Told) -> List[Finding]:
    """Return findings about missing packages and wrong versions, one for each required package."""
    there = {name: one["version"] or "0" for name, one in effective(facts).items()}
    found = unmet(facts, there)
    names = list(dict.fromkeys(one.name for one in found))
    return [_conflict(facts, [one for one in found if one.name == name]) for name in names]


def _conflict(facts: Told, those: List[Unmet]) -> Finding:
    one = effective(facts)
    askers = ", ".join("{} {} ({})".format(each.asker, one[each.asker]["version"], each.text) for each in those[:SHOWN])
    more = " and {} more".format(len(those) - SHOWN) if len(those) > SHOWN else ""
    name, there = those[0].name, those[0].there
    if there is not None:
        return Finding(
            "requirements.conflict", WARNING, "{} {} is not what {}{} needs".format(name, there, askers, more)
        )
    module = MODULES.get(name)
    if module in facts.get("importable", ()):
        text = "{} is not installed under this name, which {}{} needs; a module {} is there".format(
            name, askers, more, module
        )
        return Finding("requirements.missing", NOTE, text)
    return Finding("requirements.missing", WARNING, "{} is missing, which {}{} needs".format(name, askers, more))


def pythons(facts: Told) -> List[Finding]:
    """Return findings about packages that declare that they do not support this Python."""
    version = facts["python"]["version"].rstrip("+")
    found = []
    for name, one in effective(facts).items():
        text = one["requires_python"]
        try:
            fits = not text or specifiers(text).admits(version)
        except ValueError:
            continue
        if not fits:
            said = "{} {} requires Python {}, this is {}".format(name, one["version"], text, version)
            found.append(Finding("requires_python", WARNING, said))
    return found


# --- metadata --------------------------------------------------------------------------------------------------


def metadata(facts: Told) -> List[Finding]:
    """Return findings about metadata that is broken, duplicate or left over, and about lost or overwritten files."""
    return [*_broken(facts), *_twice(facts), *_gone(facts), *_claimed(facts), *_left(facts)]


def _broken(facts: Told) -> Iterator[Finding]:
    for one in facts["distributions"]:
        if one["trouble"]:
            place = os.path.join(one["location"], one["folder"])
            mend = "remove that folder and install {} again".format(one["name"])
            yield Finding("metadata.broken", WARNING, "{}: {}; {}".format(place, one["trouble"], mend))


def _twice(facts: Told) -> Iterator[Finding]:
    groups: Dict[Any, List[Any]] = {}
    for one in facts["distributions"]:
        groups.setdefault((one["location"], canonical(one["name"])), []).append(one)
    for (location, name), those in groups.items():
        if len({one["version"] for one in those if one["version"]}) > 1:
            folders = ", ".join(one["folder"] for one in those)
            text = (
                "{} is there {} times in {} ({}): its files are a mixture; uninstall it until none is left, then"
                " install it once".format(name, len(those), location, folders)
            )
            yield Finding("metadata.duplicate", WARNING, text)


def _gone(facts: Told) -> Iterator[Finding]:
    for one in facts["distributions"]:
        if one["missing"]:
            text = "{} {} lacks {} of its files, such as {}; install it again (pip install --force-reinstall)".format(
                one["name"], one["version"], one["missing"], one["missing_files"][0]
            )
            yield Finding("metadata.files", WARNING, text)


def _claimed(facts: Told) -> Iterator[Finding]:
    stems = {(one["location"], one["folder"]): canonical(one["name"]) for one in facts["distributions"]}
    for one in facts["claimed"]:
        names = list(dict.fromkeys(stems[one["location"], folder] for folder in one["folders"]))
        if len(names) > 1:
            text = (
                "{} have {} file(s) in common, such as {}: what was installed last has overwritten the other;"
                " uninstall both, then install one".format(" and ".join(names), one["count"], one["file"])
            )
            level = WARNING if any(map(weight, names)) else NOTE
            yield Finding("modules.claimed", level, text)


def _left(facts: Told) -> Iterator[Finding]:
    if facts["leftovers"]:
        text = "{} is left over from an interrupted installation; it can be removed".format(facts["leftovers"][0])
        yield Finding("metadata.leftover", NOTE, text)


# --- conda -----------------------------------------------------------------------------------------------------


def conda(facts: Told) -> List[Finding]:
    """Return findings about conda packages that pip overwrote or removed, and records that cannot be read."""
    found = []
    there = effective(facts)
    site = set(facts["python"]["site_packages"])
    folders = {one["folder"] for one in facts["distributions"] if one["location"] in site}
    for one in facts["conda"]:
        if one.get("trouble"):
            found.append(Finding("conda.broken", WARNING, "conda-meta/{}.json: {}".format(one["name"], one["trouble"])))
            continue
        gone = [folder for folder in one["metadata"] if folder not in folders]
        names = [canonical(folder.rpartition(".")[0].split("-")[0]) for folder in gone]
        for name in names:
            now = there.get(name)
            if now is None:
                said = "its Python package is gone"
            elif now["version"] != one["version"]:
                said = "{} has put {} over it".format(now["installer"] or "something", now["version"])
            else:
                continue
            text = "conda says {} {} ({}), but {}".format(one["name"], one["version"], one["build"], said)
            found.append(Finding("conda.overwritten", WARNING if weight(name) else NOTE, text))
    return found


# --- gym and gymnasium -----------------------------------------------------------------------------------------


def mixed(facts: Told) -> List[Finding]:
    """Return a finding if both gym and gymnasium are installed, with the packages that require each."""
    there = effective(facts)
    if "gym" not in there or "gymnasium" not in there:
        return []
    needs = asked(facts)
    askers = {
        api: sorted(name for name, those in needs.items() if any(one.name == api for one in those) and name != "shimmy")
        for api in ("gym", "gymnasium")
    }
    both = sorted({*askers["gym"]} & {*askers["gymnasium"]})
    split = [name for name in askers["gym"] if name not in both] and [n for n in askers["gymnasium"] if n not in both]
    listed = "; ".join(
        "{} {} is asked for by {}".format(api, there[api]["version"], ", ".join(names[:SHOWN]) or "no package")
        for api, names in askers.items()
    )
    text = "gym and gymnasium are both installed ({}); their environments are not interchangeable".format(listed)
    if split and "shimmy" not in there:
        return [Finding("gym.mixed", WARNING, text + "; shimmy, which translates, is not installed")]
    return [Finding("gym.mixed", NOTE, text)]
