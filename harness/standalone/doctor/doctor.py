"""Inspect an environment (`doctor`): make one document of findings, and show it to people in a few lines."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from .. import matching
from ..installing import Installer, installer
from ..matching import Evidence
from ..running import Run
from . import choosing, declared, differences, drawing, nearest, reading
from .choosing import Choice
from .declared import NOTE, WARNING, Finding
from .nearest import Near
from .probing import Here, probed
from .probing import seen as seen_here

Told = Mapping[str, Any]
SHOWN = 8
OLDEST = (3, 7)

ORDER = (
    "python.start python.version import env.import env.single import.shadowed metadata.duplicate metadata.broken"
    " modules.claimed known measured env.render rendering requirements.conflict requirements.missing probe.difference"
    " import.library_twice requires_python conda.overwritten metadata.files silent gym.mixed"
).split()
"""Findings that decide come first."""
OF_VERSIONS = frozenset(
    "import env.import env.single known measured requirements.conflict requirements.missing requires_python silent"
    " import.library_twice".split()
)
"""The findings that other versions may mend."""


class Knowledge(NamedTuple):
    """Reference data of an inspection: known failures as their files have them, and measured results."""

    signatures: Sequence[Any]
    measured: Callable[[], Told]


class Asked(NamedTuple):
    """The request of a command line. `rendering` looks at libraries only, which is all that can be done alone.

    `running` is the Python that runs us, where that is the one that is meant.
    """

    python: Optional[str]
    env: Optional[str]
    variables: Mapping[str, str]
    folder: str
    rendering: bool = False
    running: Optional[str] = None


More = Callable[[Choice, Told], Tuple[List[Finding], List[Evidence]]]
"""Looks at more of an environment, given the choice and its facts."""


def document(asked: Asked, run: Run, known: Knowledge, more: Optional[More] = None) -> Dict[str, Any]:
    """Inspect an environment and return the document of findings. Raises NoEnvironment if there is none."""
    choice = choosing.chosen(asked.python, asked.variables, asked.folder, asked.running)
    scratch = tempfile.mkdtemp(prefix="simmatrix-doctor-")
    try:
        here = Here(run, choice.python, asked.variables, asked.folder, scratch)
        return _document(here, choice, asked, known, more)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _document(here: Here, choice: Choice, asked: Asked, known: Knowledge, more: Optional[More]) -> Dict[str, Any]:
    probes = probed(here)
    looked = probes["facts"] if "distributions" in probes["facts"] else probes["scrubbed"]
    if "distributions" not in looked:
        return _nothing(here, choice, looked)
    apart = differences.differences(here, probes)
    found = _found(here, probes, looked, apart)
    told, seen = more(choice, looked) if more else ([], [])
    causes = reading.known_causes(known.signatures, probes, looked, seen)
    lurks = [*reading.foreseen(known.signatures, looked), *reading.quiet(known.signatures, looked, asked.env)]
    shown = {hit.signature.id for hit in causes}
    lurks = [one for one in lurks if one.id not in shown]
    measured = known.measured()
    told += drawing.findings(seen_here(here), here.variables) if asked.rendering else []
    found += [*told, *map(_lurking, lurks), *nearest.failed(looked, measured)]
    found.sort(key=_rank)
    issues = [*(hit.signature for hit in causes), *lurks]
    remedies = reading.versions_asked(issues)
    near = nearest.found(looked, measured, asked.env, remedies, issues)
    other = None if near or asked.env is None else nearest.found(looked, measured, None, remedies, issues)
    return {
        "schema": 1,
        "decisive": next((one.text for one in found if one.level == WARNING), None),
        "diagnoses": [matching.diagnosis(hit.signature, hit.phase, hit.seen) for hit in causes],
        "findings": [one.plain() for one in found],
        "environment": dict(_environment(choice, looked), scrubbed=here.removed),
        "imports": {name: _import(one) for name, one in (probes["imports"] or probes["clean_imports"]).items()},
        "differences": [one.plain() for one in apart],
        "lurking": [matching.diagnosis(one) for one in lurks],
        "nearest": _near(looked, near or other, _installer(here, choice, looked), (asked.env, near is not None)),
    }


def _near(
    looked: Told, near: Optional[Near], how: Installer, env: Tuple[Optional[str], bool]
) -> Optional[Dict[str, Any]]:
    """Return the nearest combination as the document holds it.

    `env` is the requested environment, and whether it was made in that combination.
    """
    if near is None:
        return None
    name, there = env
    made = nearest.plain(looked, near, how, name if there else None)
    said = ["{} was made in nothing that was measured".format(name)] if name and not there else []
    return dict(made, remarks=[*said, *made["remarks"]])


def _installer(here: Here, choice: Choice, looked: Told) -> Installer:
    return installer(choice.python, differences.versions(looked), here.variables)


def _found(here: Here, probes: Told, looked: Told, apart: Sequence[Any]) -> List[Finding]:
    """Return the findings of the checks that every environment gets."""
    found = [*_startless(probes, apart), *reading.failed(probes, apart), *reading.skipped(probes)]
    found += [*reading.hidden(here, looked), *declared.metadata(looked), *declared.conflicts(looked)]
    found += [*declared.pythons(looked), *declared.conda(looked), *declared.mixed(looked)]
    found += [*reading.twice(probes), *reading.different(here, looked, apart)]
    return found + [Finding("probe", NOTE, "could not be told: " + error) for error in looked["errors"]]


def _startless(probes: Told, apart: Sequence[Any]) -> List[Finding]:
    """Return a finding if Python starts neither with the caller's variables nor without.

    Its packages may still be known from a start without `site`.
    """
    if any(one.kind == "start" for one in apart) or "trouble" not in probes["scrubbed"]:
        return []
    return [Finding("python.start", WARNING, "this Python does not start: {}".format(probes["scrubbed"]["trouble"]))]


def _rank(one: Finding) -> Tuple[bool, int]:
    place = ORDER.index(one.check) if one.check in ORDER else len(ORDER)
    return one.level != WARNING, place


def _lurking(one: Any) -> Finding:
    """Make a finding of a known failure that these versions have, though nothing has failed yet."""
    if one.silent and not one.pattern:
        return Finding("silent", WARNING, "{} ({})".format(one.plain["cause"], one.id))
    phases = ", ".join(one.phases)
    return Finding(
        "known", WARNING, "known of these versions (shows in {}): {} ({})".format(phases, one.plain["cause"], one.id)
    )


def _import(one: Told) -> Dict[str, Any]:
    return {name: one.get(name) for name in ("error", "file", "version")}


def _environment(choice: Choice, looked: Told) -> Dict[str, Any]:
    python = looked["python"]
    return {
        "python": choice.python,
        "why": choice.why,
        "remarks": list(choice.remarks),
        "version": python["version"],
        "implementation": python["implementation"],
        "executable": python["executable"],
        "prefix": python["prefix"],
        "base_prefix": python["base_prefix"],
        "conda": bool(looked["conda"]),
        "platform": python["platform"],
        "libc": python["libc"],
        "packages": differences.versions(looked),
    }


def _nothing(here: Here, choice: Choice, looked: Told) -> Dict[str, Any]:
    """Return the document for a Python that cannot be inspected: it is too old, or does not start."""
    code = "import sys; sys.stdout.write('%d.%d' % sys.version_info[:2])"
    said = here.run([choice.python, "-E", "-c", code], here.scrubbed().variables, here.folder, 30.0).output.strip()
    numbers = said.split(".")
    old = len(numbers) == 2 and all(map(str.isdigit, numbers)) and tuple(map(int, numbers)) < OLDEST
    if old:
        finding = Finding(
            "python.version", WARNING, "this is Python {}, older than 3.7, the oldest known here".format(said)
        )
    else:
        finding = Finding("python.start", WARNING, "this Python does not start: {}".format(looked["trouble"]))
    return {
        "schema": 1,
        "decisive": finding.text,
        "diagnoses": [],
        "findings": [finding.plain()],
        "environment": {"python": choice.python, "why": choice.why, "remarks": choice.remarks, "version": said or None},
        "imports": {},
        "differences": [],
        "lurking": [],
        "nearest": None,
    }


def code(made: Told) -> int:
    """Return the exit code: 0 without warnings (notes do not count), 3 if Python is too old to be inspected, else 1."""
    checks = {one["check"] for one in made["findings"] if one["level"] == WARNING}
    return 3 if checks == {"python.version"} else 1 if checks else 0


# --- for people ------------------------------------------------------------------------------------------------


def lines(made: Told, in_words: Callable[[Told], str]) -> Iterable[str]:
    """Yield the document as lines for people: the decisive finding first, then the rest, then what to change."""
    yield from _head(made["environment"])
    found = [one for one in made["findings"] if one["level"] == WARNING]
    yield from _causes(made, in_words)
    for one in found[:SHOWN]:
        yield "warning: {}".format(one["text"])
        yield from _remedy(made, one["text"], in_words)
    if len(found) > SHOWN:
        yield "... and {} more warnings (--json lists all)".format(len(found) - SHOWN)
    notes = [one for one in made["findings"] if one["level"] == NOTE]
    yield from ("note: {}".format(one["text"]) for one in notes[:SHOWN])
    if len(notes) > SHOWN:
        yield "... and {} more notes (--json lists all)".format(len(notes) - SHOWN)
    if not found:
        yield "nothing is wrong, as far as can be seen from outside"
    yield from _nearest(made)


def _head(told: Told) -> Iterable[str]:
    version = told.get("version") or "does not answer"
    yield "{} (Python {}), {}".format(told["python"], version, told["why"])
    yield from ("  {}".format(one) for one in told.get("remarks", ()))
    removed = told.get("scrubbed")
    if removed is not None:
        looked = "checked with and without your shell's variables, this folder and the user site"
        yield "  {} packages, {}".format(len(told["packages"]), looked)
    yield ""


def _causes(made: Told, in_words: Callable[[Told], str]) -> Iterable[str]:
    for one in made["diagnoses"][:1]:
        yield "cause: {}".format(one["cause"])
        yield "remedy: {}".format(in_words(one["remedy"]))
        yield from ("see: {}".format(reference) for reference in one["references"][:1])
        yield ""


def _remedy(made: Told, text: str, in_words: Callable[[Told], str]) -> Iterable[str]:
    for one in made["lurking"]:
        if text.endswith("({})".format(one["signature"])) and one["remedy"]:
            yield "  remedy: {}".format(in_words(one["remedy"]))


def _nearest(made: Told) -> Iterable[str]:
    near = made["nearest"]
    if "packages" not in made["environment"]:
        return
    yield ""
    if near is None:
        yield "nearest known-good: nothing that is installed here was measured"
        return
    where = "{}, {}, {}".format(near["cell"], near["machine"], near["measured"][:10])
    if not near["command"]:
        beside = ", apart from {},".format(", ".join(near["uncovered"])) if near["uncovered"] else ""
        yield "these versions{} were measured together, and work ({})".format(beside, where)
    elif not _of_versions(made, near):
        changes = ", ".join("{} {}, here {}".format(one["name"], one["then"], one["now"]) for one in near["changes"])
        yield "these versions were not measured together; the nearest that work ({}) have {}".format(where, changes)
    else:
        yield "nearest known-good ({}):".format(where)
        yield "  {}".format(near["command"])
    yield from ("  {}".format(one) for one in near["remarks"])
    if near["also"]:
        count = len(near["also"])
        yield "  {} more package(s) differ there, which seldom matters (--json lists them)".format(count)


def _of_versions(made: Told, near: Told) -> bool:
    """Return whether other versions may fix one of the warnings.

    Warnings about the requested environment (`env.*`) count only if it was made in the nearest combination.
    """
    checks = {one["check"] for one in made["findings"] if one["level"] == WARNING} & OF_VERSIONS
    return any(near["env"] or not check.startswith("env.") for check in checks)


def printed(text: str) -> None:
    """Write to stdout; characters that its encoding lacks are replaced."""
    encoding = sys.stdout.encoding or "ascii"
    sys.stdout.write(text.encode(encoding, "replace").decode(encoding) + os.linesep)
