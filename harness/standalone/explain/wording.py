"""Write explanations for people: causes, remedies, references, and the next commands to type."""

from __future__ import annotations

import re
import shlex
from typing import Any, Iterator, List, Mapping, NamedTuple, Optional, Sequence

from ..installing import Installer, installer
from ..matching import Diagnosis
from ..remedies import in_words
from .explaining import Explained

FAULTS = "PYTHONFAULTHANDLER"
LIKE_IT = 2
"""Further causes and references that are shown."""


class Place(NamedTuple):
    """The place of an explanation: how we are called, the interpreter that failed, its command, and the kept output.

    `asked` are requirements that lead to the same combination, `installer` serves the environment that failed.
    """

    program: str = "simmatrix"
    alone: bool = False
    python: Optional[str] = None
    command: Sequence[str] = ()
    kept: Optional[str] = None
    asked: Sequence[str] = ()
    version: Optional[str] = None
    installer: Optional[Installer] = None


# --- an explanation --------------------------------------------------------------------------------------------


def lines(made: Explained, place: Place) -> Iterator[str]:
    """Yield an explanation as lines for people."""
    if not made.told.failed and not made.diagnoses:
        yield "no failure: nothing in this text says that anything failed"
        yield "last line: {}".format(made.told.last)
    elif made.cause is None:
        yield from _unknown(made)
    else:
        yield from _cause(made.cause)
        for other in [hit for hit in made.causes if not hit.signature.masks][1 : 1 + LIKE_IT]:
            yield "also:      {} ({})".format(other.signature.plain["cause"], other.seen)
    if made.cause is not None:
        yield from _hidden(made)
    for _, level, text in made.findings:
        yield "{}      {}".format(level + ":", text) if level == "note" else "{}   {}".format(level + ":", text)
    steps = list(following(made, place))
    for number, step in enumerate(steps):
        yield "{}      {}".format("next:" if number == 0 else "     ", step)
    if place.kept:
        yield "output:    {}".format(place.kept)


def _cause(hit: Diagnosis) -> Iterator[str]:
    plain = hit.signature.plain
    yield "failed:    {}".format(hit.seen)
    yield "cause:     {}".format(plain["cause"])
    yield "remedy:    {}".format(in_words(plain.get("remedy", {})))
    for number, link in enumerate(list(plain.get("references", ()))[:LIKE_IT]):
        yield "{} {}".format("reference:" if number == 0 else "          ", link)
    yield "known as:  {}".format(hit.signature.id)


def _unknown(made: Explained) -> Iterator[str]:
    yield "failed:    {}{}".format(made.told.decisive or "without a word", _where(made))
    if made.diagnoses and made.echoed:
        yield "that is:   {}".format(made.diagnoses[0].signature.plain["cause"])
        yield "remedy:    {}".format(in_words(made.diagnoses[0].signature.plain.get("remedy", {})))
    else:
        yield from _hidden(made)
    if made.phase == "resolve":
        yield "cause:     unknown: what is asked for cannot be had together, as it says; no known failure is behind it"
    else:
        yield "cause:     unknown: no known failure fits"


def _hidden(made: Explained) -> Iterator[str]:
    """Yield the lines that hide the cause, each once.

    If the cause is unknown, the explanation of one such line follows.
    """
    shown = made.cause.seen if made.cause else made.told.decisive
    masks = [hit for hit in made.diagnoses if hit.signature.masks and hit.seen != shown]
    for line in dict.fromkeys(hit.seen for hit in masks):
        yield "hidden by: {}".format(line)
    named = [hit for hit in masks if hit.signature.packages] if made.cause is None else []
    for hit in named[:1]:
        yield "           {}".format(hit.signature.plain["cause"])


def _where(made: Explained) -> str:
    return " (in {})".format(made.phase) if made.phase else ""


# --- what to type next -----------------------------------------------------------------------------------------


def following(made: Explained, place: Place) -> Iterator[str]:
    """Yield the commands that help from here, the most likely first."""
    if not made.told.failed:
        yield "{} explain -- COMMAND, which keeps all that a command writes".format(place.program)
        return
    if made.cause is not None:
        yield from _applied(made.cause.signature.plain.get("remedy", {}), place)
    elif made.echoed:
        command = " ".join(map(shlex.quote, place.command)) or "COMMAND"
        yield "{} explain -- env {}=1 {}".format(place.program, FAULTS, command)
        yield "  so that a worker that crashes says where, and all that the workers write is kept"
    named = ["--python", shlex.quote(place.python)] if place.python else []
    proving = ["--prove"] if made.cause is not None and not place.alone else []
    yield " ".join([place.program, "doctor", *named, *proving])
    yield from _tried(made, place)
    if made.cause is None:
        terms = search_terms(made)
        if terms and not terms.endswith(SILENT):
            yield "search for: {}".format(terms)


def _applied(remedy: Mapping[str, Any], place: Place) -> Iterator[str]:
    """Yield the commands that apply a remedy."""
    asked = [*remedy.get("requirements", ()), *remedy.get("constraints", ())]
    gone = remedy.get("uninstall", ())
    by = place.installer or installer(place.python)
    if asked:
        yield from by.installing(asked)
    if gone:
        yield from by.uninstalling(gone)
    for name, value in (remedy.get("environment") or {}).items():
        yield "export {}={}".format(name, shlex.quote(value)) if value else "unset {}".format(name)
    for name, value in (remedy.get("build_variables") or {}).items():
        yield "export {}={}".format(name, shlex.quote(value))


def _tried(made: Explained, place: Place) -> Iterator[str]:
    """Yield the command that measures the same combination apart from this environment."""
    asked = place.asked or subjects(made.hints.packages)
    if not asked or place.alone:
        return
    version = place.version or made.hints.python
    python = " --python {}".format(".".join(version.split(".")[:2])) if version else ""
    typed = " ".join(map(shlex.quote, asked)) + python
    if made.cause is not None and made.cause.signature.plain.get("remedy", {}).get("overlay"):
        yield "{} try {} --overlay".format(place.program, typed)
    else:
        yield "{} repair {}".format(place.program, typed)


def subjects(packages: Mapping[str, str]) -> List[str]:
    """Return the packages that decide, with their versions; none if only numpy is among them."""
    found = [name for name in packages if name in SUBJECTS]
    return ["{}=={}".format(name, packages[name]) for name in found] if set(found) - {"numpy"} else []


SILENT = "without a word"
"""How a line ends that nobody wrote: there is nothing to search for."""

SUBJECTS = frozenset(
    "gym gymnasium mujoco mujoco-py dm-control robosuite pybullet gymnasium-robotics metaworld pettingzoo torchrl"
    " stable-baselines3 shimmy ale-py isaacgym isaaclab numpy".split()
)


def search_terms(made: Explained) -> str:
    """Return the decisive line without what differs between machines, and the packages that the text names."""
    first = (made.told.decisive or "").partition(" / ")[0]
    named = re.sub(r"(?:[A-Za-z]:)?(?:[/\\][\w.+-]+)*[/\\]([\w.+-]+)", r"\1", first)  # a file's name is worth a search
    line = re.sub(r"^(?:ERROR|error): |\b0x[0-9a-f]+\b|\bline \d+", " ", named)
    packages = [name for name in made.hints.packages if name in SUBJECTS and name not in line][:3]
    return " ".join([" ".join(re.sub(r"[\"`…]", " ", line).split())[:160], *packages]).strip()
