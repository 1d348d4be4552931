"""Write explanations for people: causes, remedies, references, and the next commands to type."""

from __future__ import annotations

import re
import shlex
from typing import Any, Iterator, List, Mapping, NamedTuple, Optional, Sequence

from ..failures.matching import Diagnosis
from ..failures.remedies import in_words
from ..installing import Installer, installer
from ..requirements import named, requirement
from .explain_text import Explanation

FAULTS = "PYTHONFAULTHANDLER"
LIKE_IT = 2
"""Further causes and references that are shown."""


class Place(NamedTuple):
    """The place of an explanation: how we are called, the interpreter that failed, its command, and the kept output.

    `requirements` lead to the same combination, `installer` serves the environment that failed.
    """

    program: str = "simmatrix"
    alone: bool = False
    python: Optional[str] = None
    command: Sequence[str] = ()
    output_file: Optional[str] = None
    requirements: Sequence[str] = ()
    version: Optional[str] = None
    installer: Optional[Installer] = None


# --- an explanation --------------------------------------------------------------------------------------------


def lines(explanation: Explanation, place: Place) -> Iterator[str]:
    """Yield an explanation as lines for people."""
    if not explanation.failure.failed and not explanation.diagnoses:
        yield "no failure: no line of this text reports a failure"
        yield "last line: {}".format(explanation.failure.last)
    elif explanation.cause is None:
        yield from _unknown(explanation)
    else:
        yield from _cause(explanation.cause)
        others = [hit for hit in explanation.causes[1:] if not hit.signature.masks]
        for other in [hit for hit in others if not _says_the_same(hit, explanation.cause)][:LIKE_IT]:
            yield "also:      {} ({})".format(other.signature.plain["cause"], other.seen)
    if explanation.cause is not None:
        yield from _describe_masks(explanation)
    for _, level, text in explanation.findings:
        yield "{}      {}".format(level + ":", text) if level == "note" else "{}   {}".format(level + ":", text)
    steps = list(suggest_commands(explanation, place))
    for number, step in enumerate(steps):
        yield "{}      {}".format("next:" if number == 0 else "     ", step)
    if place.output_file:
        yield "output:    {}".format(place.output_file)


def _says_the_same(hit: Diagnosis, cause: Diagnosis) -> bool:
    """Return whether two causes of one line are about the same packages: one derived, the other documented."""
    packages = [
        {named(text) for text in each.signature.plain.get("remedy", {}).get("requirements", ())}
        for each in (hit, cause)
    ]
    return hit.seen == cause.seen and bool(packages[0]) and packages[0] <= packages[1]


def _cause(hit: Diagnosis) -> Iterator[str]:
    plain = hit.signature.plain
    yield "failed:    {}".format(hit.seen)
    yield "cause:     {}".format(plain["cause"])
    yield "remedy:    {}".format(in_words(plain.get("remedy", {})))
    for number, link in enumerate(list(plain.get("references", ()))[:LIKE_IT]):
        yield "{} {}".format("reference:" if number == 0 else "          ", link)
    if plain.get("derived"):
        yield "derived:   from the contents of releases and from this line"
    else:
        yield "known as:  {}".format(hit.signature.id)


def _unknown(explanation: Explanation) -> Iterator[str]:
    where = " (in {})".format(explanation.phase) if explanation.phase else ""
    yield "failed:    {}{}".format(explanation.failure.decisive or "without a word", where)
    if explanation.diagnoses and explanation.echoed:
        yield "that is:   {}".format(explanation.diagnoses[0].signature.plain["cause"])
        yield "remedy:    {}".format(in_words(explanation.diagnoses[0].signature.plain.get("remedy", {})))
    else:
        yield from _describe_masks(explanation)
    if explanation.phase == "resolve":
        yield "cause:     unknown: the requirements contradict each other, as the message says"
    else:
        yield "cause:     unknown: no known failure fits"


def _describe_masks(explanation: Explanation) -> Iterator[str]:
    """Yield the lines that hide the cause, each once, and why they do.

    If the cause is unknown, the explanation of one such line follows.
    """
    shown = explanation.cause.seen if explanation.cause else explanation.failure.decisive
    masks = [hit for hit in explanation.diagnoses if hit.signature.masks and hit.seen != shown]
    reasons = {hit.seen: hit.signature.plain["cause"] for hit in reversed(masks)}
    for line in dict.fromkeys(hit.seen for hit in masks):
        yield "hidden by: {}".format(line)
        if explanation.cause is not None:
            yield "because:   {}".format(reasons[line].partition(". ")[0].rstrip(".") + ".")
    named = [hit for hit in masks if hit.signature.packages] if explanation.cause is None else []
    for hit in named[:1]:
        yield "           {}".format(hit.signature.plain["cause"])


# --- what to type next -----------------------------------------------------------------------------------------


def suggest_commands(explanation: Explanation, place: Place) -> Iterator[str]:
    """Yield the commands that help from here, the most likely first."""
    if not explanation.failure.failed:
        yield "{} explain -- COMMAND, which keeps the complete output".format(place.program)
        return
    if explanation.cause is not None:
        yield from _suggest_remedy(explanation.cause.signature.plain.get("remedy", {}), place)
    elif explanation.echoed:
        command = " ".join(map(shlex.quote, place.command)) or "COMMAND"
        yield "{} explain -- env {}=1 {}".format(place.program, FAULTS, command)
        yield "  so that a crashed worker reports where, and all output is kept"
    named = ["--python", shlex.quote(place.python)] if place.python else []
    proving = ["--prove"] if explanation.cause is not None and not place.alone else []
    yield " ".join([place.program, "doctor", *named, *proving])
    yield from _suggest_measurement(explanation, place)
    if explanation.cause is None:
        terms = search_terms(explanation)
        if terms and not terms.endswith(SILENT):
            yield "search for: {}".format(terms)


def _suggest_remedy(remedy: Mapping[str, Any], place: Place) -> Iterator[str]:
    """Yield the commands that apply a remedy."""
    requirements = [*remedy.get("requirements", ()), *remedy.get("constraints", ())]
    gone = remedy.get("uninstall", ())
    by = place.installer or installer(place.python)
    if requirements:
        # An installer leaves a package alone that is there and that no version is asked of.
        here = set(map(named, place.requirements))
        stays = any(named(text) in here and not requirement(text).specifiers for text in requirements)
        yield from by.installing(["--upgrade", *requirements] if stays else requirements)
    if gone:
        yield from by.uninstalling(gone)
    for name, value in (remedy.get("environment") or {}).items():
        yield "export {}={}".format(name, shlex.quote(value)) if value else "unset {}".format(name)
    for name, value in (remedy.get("build_variables") or {}).items():
        yield "export {}={}".format(name, shlex.quote(value))
    if not requirements and not remedy.get("environment"):
        commands = COMMAND.findall(str(remedy.get("text", "")))
        of_conda = [command for command in commands if command.startswith("conda ")]
        others = [command for command in commands if not command.startswith("conda ")]
        yield from ((of_conda if by.conda else others) or commands)[:1]


def _suggest_measurement(explanation: Explanation, place: Place) -> Iterator[str]:
    """Yield the command that measures the same combination apart from this environment."""
    requirements = place.requirements or subjects(explanation.hints.packages)
    if not requirements or place.alone:
        return
    version = place.version or explanation.hints.python
    python = " --python {}".format(".".join(version.split(".")[:2])) if version else ""
    typed = " ".join(map(shlex.quote, requirements)) + python
    if explanation.cause is not None and explanation.cause.signature.plain.get("remedy", {}).get("overlay"):
        yield "{} try {} --overlay".format(place.program, typed)
    else:
        yield "{} repair {}".format(place.program, typed)


def subjects(packages: Mapping[str, str]) -> List[str]:
    """Return the packages that decide, with their versions; none if only numpy is among them."""
    names = [name for name in packages if name in SUBJECTS]
    return ["{}=={}".format(name, packages[name]) for name in names] if set(names) - {"numpy"} else []


COMMAND = re.compile(r"`((?:apt-get|conda|pip|export|unset|python) [^`]+)`")
"""A command within the text of a remedy."""

SILENT = "without a word"
"""How a line ends that nobody wrote: there is nothing to search for."""

SUBJECTS = frozenset(
    "gym gymnasium mujoco mujoco-py dm-control robosuite pybullet gymnasium-robotics metaworld pettingzoo torchrl"
    " stable-baselines3 shimmy ale-py isaacgym isaaclab numpy".split()
)


def search_terms(explanation: Explanation) -> str:
    """Return the decisive line without what differs between machines, and the packages that the text names."""
    first = (explanation.failure.decisive or "").partition(" / ")[0]
    named = re.sub(r"(?:[A-Za-z]:)?(?:[/\\][\w.+-]+)*[/\\]([\w.+-]+)", r"\1", first)  # a file's name is worth a search
    line = re.sub(r"^(?:ERROR|error): |\b0x[0-9a-f]+\b|\bline \d+", " ", named)
    packages = [name for name in explanation.hints.packages if name in SUBJECTS and name not in line][:3]
    return " ".join([" ".join(re.sub(r"[\"`…]", " ", line).split())[:160], *packages]).strip()
