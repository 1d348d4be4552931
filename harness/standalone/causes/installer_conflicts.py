"""Explain what installers say of requirements that do not fit, and what installers and shells refuse at once."""

from __future__ import annotations

import re
from typing import List, Optional, Set, Tuple

from ..explain.import_names import package_with
from ..requirements import Requirement, requirement
from ..versions import canonical, is_version, specifiers, unsatisfiable
from ..versions import version as parsed_version
from .scene import PACKAGE, Cause, Causes, Pattern, Scene, requirement_remedy

BOUND = r"((?:[<>=!~]=?=?\s?[\w.*+!]+,?\s?(?:and )?)+)"
INCOMPATIBLE = Pattern(
    r"({0}) (\d\S*) (?:requires|has requirement) ({0})(?:\[[\w,-]*\])?\s?\(?{1}\)?(?:; [^,]+)?, but you(?:'ll)? have"
    r" (?:\3|{0}) (\S+) which is incompatible".format(PACKAGE, BOUND),
    "which is incompatible",
)
CHECKED = Pattern(
    r"({0})(?:\[[\w,-]*\])?{1} is required .*?but found ({0})==(\d\S*)".format(PACKAGE, BOUND), "but found "
)
"""The line of a library that checks its requirements itself."""

UNINSTALLED = Pattern(
    r"({0}) (\d\S*) requires ({0})(?:\[[\w,-]*\])?\s?{1}?, which is not installed".format(PACKAGE, BOUND),
    "which is not installed",
)
DEPENDS = Pattern(
    r"({0}(?:\[[\w,-]+\])?)(?: \(?|==|-)(\d[\w.!+]*)\)? depends on ({0})(?:\[[\w,-]+\])?\s?\(?{1}".format(
        PACKAGE, BOUND
    ),
    " depends on ",
)
REQUESTED = Pattern(r"The user requested ()({0})(?:\[[\w,-]+\])?{1}".format(PACKAGE, BOUND), "The user requested ")
UV_NONE = Pattern(
    r"Because there (?:are|is) no versions? of ({0})(?:\[[\w,-]+\])?(?:{1})?(?: in the package registry)? and"
    r" ({0})(?:\[[\w,-]+\])?(?:==(\S+?))? depends on \1".format(PACKAGE, BOUND),
    "Because there",
)
UNSATISFIED = Pattern(
    r"(?:ContextualVersionConflict|VersionConflict|DistributionNotFound).*?\(?({0}) (\d\S*) \(.*?Requirement\.parse\("
    r"'({0}){1}'\)(?:, \{{(.*?)\}})?".format(PACKAGE, BOUND),
    "Requirement.parse",
)
NOT_FOUND = Pattern(
    r"The '({0}){1}?' distribution was not found and is required by ([\w.-]+)".format(PACKAGE, BOUND),
    "distribution was not found",
)


EXTRA = Pattern(
    r"({0})(?: (\d\S*))? does not (?:provide|have) (?:the|an) extra(?: named)?:? '?`?({0})".format(PACKAGE), " extra"
)
BRACKETS = Pattern(r"no matches found: '?({0}\[[\w, -]+\]\S*)".format(PACKAGE), "no matches found: ")
COMMAND = Pattern(
    r"(?:not (?:installed|found|available)|is missing|missing|[Pp]lease install|needs? to be installed|is required"
    r"|are required|must be installed|unavailable|to install|not have|No module|not import|importing|dependenc)"
    r".*?(?:pip3? install|pip install|uv add) ((?:-U |--upgrade |-q )?[`'\"]?{0}(?:\[[\w, -]+\])?"
    r"(?:[<>=!~]=?[\w.,<>=]+)?)".format(PACKAGE),
    "pip install ", "pip3 install ", "uv add ",
)  # fmt: skip
REQUIRED = Pattern(
    r"^\W*(?:\w+(?:Error|NotInstalled): )?[`'\"]({0})[`'\"] is required but (?:is )?not installed".format(PACKAGE),
    "not installed",
)
ABSENT = Pattern(
    r"^\W*(?:\w+(?:Error|NotInstalled): )?([A-Za-z]\w+) (?:is )?not (?:found|installed)\b", "not found", "not installed"
)
GONE = Pattern(
    r"^\W*(?:ResolvePackageNotFound|PackagesNotFoundError|nothing provides requested)[^-]*?-? ?"
    r"\b([\w.-]+) ?==?=?([\w.]+)(?:[= ](\w+))?",
    "ResolvePackageNotFound", "PackagesNotFoundError", "nothing provides requested",
)  # fmt: skip
METADATA = Pattern(r"No package metadata was found for ({0})".format(PACKAGE), "No package metadata")
NEEDED = Pattern(r"nothing provides (\S+)(?: (\S+))? needed by ([\w.-]+?)-(\d[\w.]*)", "nothing provides ")


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where a line tells of two requirements that do not fit."""
    for rule in (_incompatible, _checked, _absent, _none, _depends, _unsatisfied):
        cause = rule(line, scene)
        if cause is not None:
            yield cause
            return


def _incompatible(line: str, scene: Scene) -> Optional[Cause]:
    match = INCOMPATIBLE.search(line)
    if match is None:
        return None
    name, version, package, bound, there = match.groups()
    text = "{} {} requires {}{}, but {} {} is installed".format(name, version, package, bound.strip(), package, there)
    other = _allowing(scene, name, package, there)
    way = "Or `{}=={}`, which allows {} {}.".format(name, other, package, there) if other and other != version else ""
    remedy = requirement_remedy(package + _bare(bound), way)
    return Cause(canonical(package), text, remedy, asker=canonical(name))


def _allowing(scene: Scene, name: str, package: str, there: str) -> Optional[str]:
    """Return the newest release of a package that requires another one and allows this release of it."""
    history = scene.load(canonical(name))
    if history is None or not is_version(there):
        return None
    bounding: Set[int] = set()
    excluding: Set[int] = set()
    for text, spans in history.plain.get("requires", {}).items():
        wanted = _parsed(text)
        if wanted is not None and wanted.name == canonical(package):
            places = {place for first, last in spans for place in range(first, last + 1)}
            bounding |= places
            excluding |= set() if wanted.specifiers.admits(there) else places
    fitting = [place for place in bounding - excluding if not parsed_version(history.versions[place]).is_prerelease]
    return history.versions[max(fitting)] if fitting else None


def _parsed(text: str) -> Optional[Requirement]:
    try:
        wanted = requirement(text)
    except ValueError:
        return None
    return wanted if wanted.marker is None or "extra" not in str(wanted.marker) else None


def _checked(line: str, scene: Scene) -> Optional[Cause]:
    match = CHECKED.search(line)
    if match is None or canonical(match.group(1)) != canonical(match.group(3)):
        return None
    package, bound, _, there = match.groups()
    asking = scene.modules[0] if scene.modules else "a library"
    text = "{} requires {}{}, but {} is installed".format(asking, package, bound.strip(), there.rstrip(".,"))
    return Cause(canonical(package), text, requirement_remedy(package + _bare(bound)))


def _absent(line: str, scene: Scene) -> Optional[Cause]:
    match = UNINSTALLED.search(line)
    if match is None:
        return None
    name, version, package, bound = match.groups()
    text = "{} {} requires {}, which is not installed".format(name, version, package)
    return Cause(canonical(package), text, requirement_remedy(package + _bare(bound or "")))


def _none(line: str, scene: Scene) -> Optional[Cause]:
    match = UV_NONE.search(line)
    if match is None:
        return None
    package, bound, asking, version = match.groups()
    wanted = package + _bare(bound or "")
    text = "{} requires {}, and the index has no such release".format(" ".join(filter(None, (asking, version))), wanted)
    other = "Install another release of {}; or, if {} has another name today, an override.".format(asking, package)
    return Cause(canonical(package), text, {"text": other})


def _depends(line: str, scene: Scene) -> Optional[Cause]:
    """Explain a resolver's "A 1.0 depends on B<2": of several such sentences two that are about one package."""
    match = DEPENDS.search(line)
    if match is None:
        return None
    conflict = _conflict(scene.failure.text)
    if conflict is not None:
        return conflict
    stated = []
    rest = line
    while match:
        stated.append(match.groups())
        rest = rest[match.end() :]
        match = DEPENDS.search(rest)
    name, version, package, bound = stated[0]
    rival = next((other for other in stated[1:] if canonical(other[2]) == canonical(package)), None)
    wanted = package + _bare(bound)
    first = "{} {} requires {}".format(name, version, wanted)
    if rival is not None and _bare(rival[3]) != _bare(bound):
        second = "{} {} requires {}".format(rival[0], rival[1], rival[2] + _bare(rival[3]))
        remedy = "Install another release of {} or of {}.".format(name, rival[0])
        return Cause(canonical(package), "{}, and {}".format(first, second), {"text": remedy}, asker=canonical(name))
    text = "{}, and another requirement excludes it".format(first)
    other = "Or install another release of {}.".format(name)
    return Cause(canonical(package), text, requirement_remedy(wanted, other), asker=canonical(name))


def _conflict(text: str) -> Optional[Cause]:
    """Return the first two of all sentences of a text that exclude each other; None where none do."""
    sentences: List[Tuple[str, str, str]] = []
    for line in text.splitlines():
        rest = line
        for pattern in (DEPENDS, REQUESTED):
            match = pattern.search(rest)
            while match:
                groups = match.groups()
                asker = " ".join(groups[:-2]) or "your command"
                sentences.append((asker, groups[-2], _bare(groups[-1] or "")))
                rest = rest[match.end() :]
                match = pattern.search(rest)
    for number, (asker, package, bound) in enumerate(sentences):
        for rival, rival_package, rival_bound in sentences[:number]:
            if canonical(package) == canonical(rival_package) and _excludes(bound, rival_bound):
                words = "{} requires {}, and {} requires {}".format(
                    asker, package + bound, rival, rival_package + rival_bound
                )
                ways = [name for name in (asker, rival) if name != "your command"]
                way = "Install another release of {}.".format(" or of ".join(name.split(" ")[0] for name in ways))
                remedy = {"text": way}
                if len(ways) == 1:
                    remedy = requirement_remedy(
                        package + (bound if ways[0] == asker else rival_bound), "Or i" + way[1:]
                    )
                return Cause(canonical(package), words, remedy, asker=canonical(ways[0].split(" ")[0]))
    return None


def _excludes(bound: str, other: str) -> bool:
    try:
        return unsatisfiable([specifiers(bound), specifiers(other)])
    except ValueError:
        return False


def _unsatisfied(line: str, scene: Scene) -> Optional[Cause]:
    match, absent = UNSATISFIED.search(line), NOT_FOUND.search(line)
    if match:
        name, version, package, bound, by = match.groups()
        asking = (by or "a package").strip("'\" ")
        text = "{} requires {}{}, but {} {} is installed".format(asking, package, bound.strip(), name, version)
        return Cause(canonical(package), text, requirement_remedy(package + _bare(bound)))
    if absent:
        package, bound, by = absent.groups()
        text = "{} requires {}, which is not installed".format(by, package)
        return Cause(canonical(package), text, requirement_remedy(package + _bare(bound or "")))
    return None


def _bare(bound: str) -> str:
    return bound.replace(" and ", ",").replace(" ", "").rstrip(",.")


# --- what is refused before anything is resolved -----------------------------------------------------------------


def refusals(line: str, scene: Scene) -> Causes:
    """Yield the cause where an installer, a shell or the message itself says what is missing."""
    extra, brackets, command = EXTRA.search(line), BRACKETS.search(line), COMMAND.search(line)
    needed = NEEDED.search(line)
    if extra:
        yield _extra(extra, scene)
    elif brackets:
        name = brackets.group(1)
        yield Cause(
            "shell",
            "zsh reads the brackets in `{}` as a pattern of file names; no installer receives them".format(name),
            {"text": "Type quotes around it: `pip install '{}'`.".format(name)},
        )
    elif GONE.search(line):
        yield _gone(GONE.search(line))
    elif needed:
        wanted, bound, package, version = needed.groups()
        text = "conda's channels have no {} {}, which {} {} needs".format(wanted, bound or "", package, version)
        yield Cause(
            canonical(package),
            " ".join(text.split()).replace(" ,", ","),
            {"text": "Add conda-forge (`-c conda-forge`), use another Python, or install {} by pip.".format(package)},
        )
    elif command:
        wanted = re.sub(r"^(?:-U|--upgrade|-q) ", "", command.group(1)).strip("`'\"")
        name = canonical(wanted.partition("[")[0])
        if name not in {"pip", "install", "the", "it", "e"}:
            yield Cause(name, "an optional package is missing, and the message names it", {"requirements": [wanted]})
    else:
        absent, metadata = ABSENT.search(line), METADATA.search(line) or REQUIRED.search(line)
        name = canonical(metadata.group(1)) if metadata else package_with(absent.group(1)) if absent else None
        if name:
            yield Cause(name, "the package {} is not installed for this Python".format(name), {"requirements": [name]})


def _gone(match: "Optional[re.Match[str]]") -> Cause:
    """Return the cause that the channels of conda have no such release, or no such build of it."""
    name, version, build = match.groups() if match else ("", "", "")
    if build:
        text = "conda's channels have no build {} of {} {} for this platform".format(build, name, version)
        way = "Remove the builds (what follows the second =) from the file: `conda env export --no-builds` makes it so."
        return Cause(canonical(name), text, {"text": way})
    text = "conda's channels have no {} {} for this platform".format(name, version)
    way = "Type `-c conda-forge`, or install it by pip: `pip install {}=={}`.".format(name, version)
    return Cause(canonical(name), text, {"text": way})


def _extra(match: "re.Match[str]", scene: Scene) -> Cause:
    package, version, extra = match.groups()
    name = "{} {}".format(package, version) if version else package
    text = "{} declares no extra `{}`, so nothing is installed for it".format(name, extra)
    history = scene.load(canonical(package))
    spans = history.spans("extras", extra) if history else None
    there = history.where(spans, version or scene.versions.get(canonical(package))) if history and spans else None
    if there is not None:
        return Cause(
            canonical(package),
            text,
            {"requirements": [there.bound.replace(package, "{}[{}]".format(package, extra), 1)]},
        )
    return Cause(
        canonical(package),
        text,
        {"text": "Remove `[{}]`, and install the packages that it should bring by name.".format(extra)},
    )
