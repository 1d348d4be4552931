"""Explain what installers and shells refuse before anything is resolved: extras, brackets, absent packages of conda."""

from __future__ import annotations

import re
from typing import Optional

from ..explain.import_names import package_with
from ..versions import canonical
from .scene import PACKAGE, Cause, Causes, Pattern, Scene

EXTRA = Pattern(
    r"({0})(?: (\d\S*))? does not (?:provide|have) (?:the|an) extra(?: named)?:? '?`?({0})".format(PACKAGE), " extra"
)
BRACKETS = Pattern(r"no matches found: '?({0}\[[\w, -]+\]\S*)".format(PACKAGE), "no matches found: ")
COMMAND = Pattern(
    r"(?:not (?:installed|found|available)|is missing|missing|[Pp]lease install|needs? to be installed|is required"
    r"|are required|must be installed|unavailable|to install|not have|No module|not import|importing|dependenc)"
    r".*?(?:pip3? install|pip install|uv add) ((?:-U |--upgrade |-q )?[`'\"]?{0}(?:\[[\w, -]+\])?(?:[<>=!~]=?[\w.,<>=]+)?)"
    .format(PACKAGE),
    "pip install ", "pip3 install ", "uv add ",
)  # fmt: skip
ABSENT = Pattern(r"^\W*(?:\w+(?:Error|NotInstalled): )?([A-Za-z]\w+) (?:is )?not (?:found|installed)\b", "not found", "not installed")
GONE = Pattern(r"^\W*(?:ResolvePackageNotFound|PackagesNotFoundError|nothing provides requested)[^-]*?-? ?\b([\w.-]+) ?==?=?([\w.]+)(?:[= ](\w+))?",
               "ResolvePackageNotFound", "PackagesNotFoundError", "nothing provides requested")
NEEDED = Pattern(r"nothing provides (\S+)(?: (\S+))? needed by ([\w.-]+?)-(\d[\w.]*)", "nothing provides ")


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where an installer, a shell or the message itself says what is missing."""
    extra, brackets, command = EXTRA.search(line), BRACKETS.search(line), COMMAND.search(line)
    needed = NEEDED.search(line)
    if extra:
        yield _extra(extra, scene)
    elif brackets:
        name = brackets.group(1)
        yield Cause(
            "shell",
            "zsh reads the brackets in `{}` as a pattern of file names; no installer has seen them".format(name),
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
            {"text": "Add conda-forge (`-c conda-forge`), take another Python, or install {} by pip.".format(package)},
        )
    elif command:
        wanted = re.sub(r"^(?:-U|--upgrade|-q) ", "", command.group(1)).strip("`'\"")
        name = canonical(wanted.partition("[")[0])
        if name not in {"pip", "install", "the", "it", "e"}:
            yield Cause(name, "an optional package is missing, and the message names it", {"requirements": [wanted]})
    else:
        absent = ABSENT.search(line)
        name = package_with(absent.group(1)) if absent else None
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
        return Cause(canonical(package), text, {"requirements": [there.bound.replace(package, "{}[{}]".format(package, extra), 1)]})
    return Cause(canonical(package), text, {"text": "Leave `[{}]` out, and install what it stands for by name.".format(extra)})
