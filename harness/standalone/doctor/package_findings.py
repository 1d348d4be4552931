"""Compare the declarations of an environment's packages with the versions and files that are there."""

from __future__ import annotations

import os
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Set

from ..keys import MODULES, weight
from ..requirements import Requirement, requirement
from ..versions import canonical, specifiers
from .differences import resolve_distributions

JsonObject = Mapping[str, Any]
NOTE, WARNING = "note", "warning"
SHOWN = 3


class Finding(NamedTuple):
    """One finding of `doctor`: the check that made it, its level (note or warning), and its text."""

    check: str
    level: str
    text: str


class Violation(NamedTuple):
    """A requirement that is not met; `there` is the installed version, None if the package is missing."""

    asker: str
    text: str
    name: str
    there: Any


# --- requirements ----------------------------------------------------------------------------------------------


def collect_requirements(facts: JsonObject) -> Dict[str, List[Requirement]]:
    """Return the requirements of each package that apply here, including the extras that other packages ask for."""
    about, there = facts["python"]["markers"], resolve_distributions(facts)
    extras: Dict[str, Set[str]] = {name: set() for name in there}
    requirements: Dict[str, List[Requirement]] = {}
    growing = True
    # An extra brings requirements, which may ask for extras in turn.
    while growing:
        growing = False
        for name, distribution in there.items():
            requirements[name] = list(_wanted(distribution, about, extras[name]))
            for each in requirements[name]:
                if each.name in extras and not extras[each.name] >= each.extras:
                    extras[each.name] |= each.extras
                    growing = True
    return requirements


def _wanted(distribution: JsonObject, about: Mapping[str, str], extras: Set[str]) -> Iterator[Requirement]:
    for text in distribution["requires"]:
        try:
            dependency = requirement(text)
            if dependency.wanted(about, extras):
                yield dependency
        except (ValueError, KeyError):
            # Anybody can write broken metadata; one bad requirement must not hide the findings of the others.
            continue


def find_violations(facts: JsonObject, versions: Mapping[str, str]) -> List[Violation]:
    """Return the requirements that these versions do not meet, those of the packages that matter most first."""
    violations = [
        Violation(name, format_requirement(each), each.name, versions.get(each.name))
        for name, requirements in collect_requirements(facts).items()
        for each in requirements
        if not _met(each, versions)
    ]
    return sorted(
        dict.fromkeys(violations), key=lambda violation: -max(weight(violation.asker), weight(violation.name))
    )


def _met(dependency: Requirement, versions: Mapping[str, str]) -> bool:
    there = versions.get(dependency.name)
    if there is None:
        return False
    return dependency.url is not None or dependency.specifiers.admits(there)


def format_requirement(dependency: Requirement) -> str:
    """Return a requirement as text: name, extras and specifiers, without its marker."""
    extras = "[{}]".format(",".join(sorted(dependency.extras))) if dependency.extras else ""
    return "{}{}{}".format(dependency.name, extras, dependency.specifiers)


def conflicts(facts: JsonObject) -> List[Finding]:
    """Return findings about missing packages and wrong versions, one for each required package."""
    there = {name: one["version"] or "0" for name, one in resolve_distributions(facts).items()}
    violations = find_violations(facts, there)
    names = list(dict.fromkeys(one.name for one in violations))
    return [_conflict(facts, [one for one in violations if one.name == name]) for name in names]


def _conflict(facts: JsonObject, violations: List[Violation]) -> Finding:
    distributions = resolve_distributions(facts)
    askers = ", ".join(
        "{} {} ({})".format(each.asker, distributions[each.asker]["version"], each.text) for each in violations[:SHOWN]
    )
    more = " and {} more".format(len(violations) - SHOWN) if len(violations) > SHOWN else ""
    name, there = violations[0].name, violations[0].there
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


def check_pythons(facts: JsonObject) -> List[Finding]:
    """Return findings about packages that declare that they do not support this Python."""
    version = facts["python"]["version"].rstrip("+")
    findings = []
    for name, distribution in resolve_distributions(facts).items():
        text = distribution["requires_python"]
        try:
            fits = not text or specifiers(text).admits(version)
        except ValueError:
            continue
        if not fits:
            message = "{} {} requires Python {}, this is {}".format(name, distribution["version"], text, version)
            findings.append(Finding("requires_python", WARNING, message))
    return findings


# --- metadata --------------------------------------------------------------------------------------------------


def metadata(facts: JsonObject) -> List[Finding]:
    """Return findings about metadata that is broken, duplicate or left over, and about lost or overwritten files."""
    return [
        *_broken(facts),
        *_find_duplicates(facts),
        *_find_missing_files(facts),
        *_find_shared_files(facts),
        *_left(facts),
    ]


def _broken(facts: JsonObject) -> Iterator[Finding]:
    for distribution in facts["distributions"]:
        if distribution["trouble"]:
            place = os.path.join(distribution["location"], distribution["folder"])
            mend = "remove that folder and install {} again".format(distribution["name"])
            yield Finding("metadata.broken", WARNING, "{}: {}; {}".format(place, distribution["trouble"], mend))


def _find_duplicates(facts: JsonObject) -> Iterator[Finding]:
    groups: Dict[Any, List[Any]] = {}
    for distribution in facts["distributions"]:
        groups.setdefault((distribution["location"], canonical(distribution["name"])), []).append(distribution)
    for (location, name), duplicates in groups.items():
        if len({one["version"] for one in duplicates if one["version"]}) > 1:
            folders = ", ".join(one["folder"] for one in duplicates)
            text = (
                "{} is there {} times in {} ({}): its files are a mixture; uninstall it until none is left, then"
                " install it once".format(name, len(duplicates), location, folders)
            )
            yield Finding("metadata.duplicate", WARNING, text)


def _find_missing_files(facts: JsonObject) -> Iterator[Finding]:
    for distribution in facts["distributions"]:
        if distribution["missing"]:
            text = "{} {} lacks {} of its files, such as {}; install it again (pip install --force-reinstall)".format(
                distribution["name"], distribution["version"], distribution["missing"], distribution["missing_files"][0]
            )
            yield Finding("metadata.files", WARNING, text)


def _find_shared_files(facts: JsonObject) -> Iterator[Finding]:
    stems = {(one["location"], one["folder"]): canonical(one["name"]) for one in facts["distributions"]}
    for entry in facts["claimed"]:
        names = list(dict.fromkeys(stems[entry["location"], folder] for folder in entry["folders"]))
        if len(names) > 1:
            text = (
                "{} have {} file(s) in common, such as {}: what was installed last has overwritten the other;"
                " uninstall both, then install one".format(" and ".join(names), entry["count"], entry["file"])
            )
            level = WARNING if any(map(weight, names)) else NOTE
            yield Finding("modules.claimed", level, text)


def _left(facts: JsonObject) -> Iterator[Finding]:
    if facts["leftovers"]:
        text = "{} is left over from an interrupted installation; it can be removed".format(facts["leftovers"][0])
        yield Finding("metadata.leftover", NOTE, text)


# --- conda -----------------------------------------------------------------------------------------------------


def conda(facts: JsonObject) -> List[Finding]:
    """Return findings about conda packages that pip overwrote or removed, and records that cannot be read."""
    findings = []
    there = resolve_distributions(facts)
    site = set(facts["python"]["site_packages"])
    folders = {one["folder"] for one in facts["distributions"] if one["location"] in site}
    for package in facts["conda"]:
        if package.get("trouble"):
            findings.append(
                Finding("conda.broken", WARNING, "conda-meta/{}.json: {}".format(package["name"], package["trouble"]))
            )
            continue
        gone = [folder for folder in package["metadata"] if folder not in folders]
        names = [canonical(folder.rpartition(".")[0].split("-")[0]) for folder in gone]
        for name in names:
            now = there.get(name)
            if now is None:
                change = "its Python package is gone"
            elif now["version"] != package["version"]:
                change = "{} has put {} over it".format(now["installer"] or "something", now["version"])
            else:
                continue
            text = "conda says {} {} ({}), but {}".format(package["name"], package["version"], package["build"], change)
            findings.append(Finding("conda.overwritten", WARNING if weight(name) else NOTE, text))
    return findings


# --- gym and gymnasium -----------------------------------------------------------------------------------------


def check_gym_mix(facts: JsonObject) -> List[Finding]:
    """Return a finding if both gym and gymnasium are installed, with the packages that require each."""
    there = resolve_distributions(facts)
    if "gym" not in there or "gymnasium" not in there:
        return []
    needs = collect_requirements(facts)
    # shimmy requires an API only in order to translate, so it is no sign of a mixture.
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
