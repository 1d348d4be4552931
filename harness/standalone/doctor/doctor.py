"""Inspect an environment (`doctor`): make one document of findings, and show it to people in a few lines."""

from __future__ import annotations

import shutil
import tempfile
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from ..failures import matching
from ..failures.matching import Evidence
from ..installing import Installer, installer
from ..running import Run
from . import (
    differences,
    environment_choice,
    environment_findings,
    nearest_combination,
    package_findings,
    rendering_findings,
)
from .environment_choice import Choice
from .inspect_environment import Viewpoint, run_probes
from .inspect_environment import list_rendering_support as seen_here
from .nearest_combination import Candidate
from .package_findings import NOTE, WARNING, Finding

JsonObject = Mapping[str, Any]
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
    measured: Callable[[], JsonObject]


class Request(NamedTuple):
    """The request of a command line. `rendering` looks at libraries only, which is all that can be done alone.

    `running` is the Python that runs us, where that is the one that is meant.
    """

    python: Optional[str]
    env: Optional[str]
    variables: Mapping[str, str]
    folder: str
    rendering: bool = False
    running: Optional[str] = None
    api: Optional[str] = None


More = Callable[[Choice, JsonObject], Tuple[List[Finding], List[Evidence]]]
"""Looks at more of an environment, given the choice and its facts."""


def document(request: Request, run: Run, knowledge: Knowledge, more: Optional[More] = None) -> Dict[str, Any]:
    """Inspect an environment and return the document of findings. Raises NoEnvironment if there is none."""
    choice = environment_choice.choose_environment(request.python, request.variables, request.folder, request.running)
    scratch = tempfile.mkdtemp(prefix="simmatrix-doctor-")
    try:
        here = Viewpoint(run, choice.python, request.variables, request.folder, scratch)
        return _document(here, choice, request, knowledge, more)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _document(
    here: Viewpoint, choice: Choice, request: Request, knowledge: Knowledge, more: Optional[More]
) -> Dict[str, Any]:
    probes = run_probes(here)
    # A variable such as PYTHONHOME may keep Python from starting; without it the packages are still known.
    looked = probes["facts"] if "distributions" in probes["facts"] else probes["scrubbed"]
    if "distributions" not in looked:
        return _build_failure_document(here, choice, looked)
    apart = differences.differences(here, probes)
    findings = _check_environment(here, probes, looked, apart)
    more_findings, seen = more(choice, looked) if more else ([], [])
    causes = environment_findings.known_causes(knowledge.signatures, probes, looked, seen)
    lurks = [
        *environment_findings.predict_failures(knowledge.signatures, looked),
        *environment_findings.find_silent_issues(knowledge.signatures, looked, request.env),
    ]
    shown = {hit.signature.id for hit in causes}
    lurks = [one for one in lurks if one.id not in shown]
    measured = knowledge.measured()
    more_findings += rendering_findings.findings(seen_here(here), here.variables) if request.rendering else []
    findings += [*more_findings, *map(_report_signature, lurks), *nearest_combination.find_failure(looked, measured)]
    findings.sort(key=_rank)
    issues = [*(hit.signature for hit in causes), *lurks]
    remedies = environment_findings.versions_asked(issues)
    how = installer(choice.python, differences.versions(looked), here.variables)
    api = nearest_combination.spoken_api(request.env, request.api, differences.versions(looked))
    near = nearest_combination.find(looked, measured, request.env, remedies, issues, api)
    other = None if near or request.env is None else nearest_combination.find(looked, measured, None, remedies, issues)
    return {
        "schema": 1,
        "decisive": next((one.text for one in findings if one.level == WARNING), None),
        "diagnoses": [matching.diagnosis(hit.signature, hit.phase, hit.seen) for hit in causes],
        "findings": [one._asdict() for one in findings],
        "environment": dict(_environment(choice, looked), scrubbed=here.removed),
        "imports": {name: _import(one) for name, one in (probes["imports"] or probes["clean_imports"]).items()},
        "differences": [dict(one._asdict(), by=list(one.by)) for one in apart],
        "lurking": [matching.diagnosis(one) for one in lurks],
        "nearest": _near(looked, near or other, how, (request.env, near is not None)),
    }


def _near(
    looked: JsonObject, near: Optional[Candidate], how: Installer, env: Tuple[Optional[str], bool]
) -> Optional[Dict[str, Any]]:
    """Return the nearest combination as the document holds it.

    `env` is the requested environment, and whether it was made in that combination.
    """
    if near is None:
        return None
    name, there = env
    combination = nearest_combination.to_dict(looked, near, how, name if there else None)
    notes = ["{} was not part of any measurement".format(name)] if name and not there else []
    return dict(combination, remarks=[*notes, *combination["remarks"]])


def _check_environment(here: Viewpoint, probes: JsonObject, looked: JsonObject, apart: Sequence[Any]) -> List[Finding]:
    """Return the findings of the checks that every environment gets."""
    findings = [
        *_check_start(probes, apart),
        *environment_findings.report_failed_imports(probes, apart),
        *environment_findings.note_skipped(probes),
        *environment_findings.find_shadowing(here, looked),
        *package_findings.metadata(looked),
        *package_findings.conflicts(looked),
        *package_findings.check_pythons(looked),
        *package_findings.conda(looked),
        *package_findings.check_gym_mix(looked),
        *environment_findings.find_loaded_twice(probes),
        *environment_findings.report_differences(here, looked, apart),
    ]
    return findings + [Finding("probe", NOTE, "could not be checked: " + error) for error in looked["errors"]]


def _check_start(probes: JsonObject, apart: Sequence[Any]) -> List[Finding]:
    """Return a finding if Python starts neither with the caller's variables nor without.

    Its packages may still be known from a start without `site`.
    """
    if any(one.kind == "start" for one in apart) or "trouble" not in probes["scrubbed"]:
        return []
    return [Finding("python.start", WARNING, "this Python does not start: {}".format(probes["scrubbed"]["trouble"]))]


def _rank(finding: Finding) -> Tuple[bool, int]:
    place = ORDER.index(finding.check) if finding.check in ORDER else len(ORDER)
    return finding.level != WARNING, place


def _report_signature(signature: Any) -> Finding:
    """Make a finding of a known failure that these versions have, though nothing has failed yet."""
    if signature.silent and not signature.pattern:
        return Finding("silent", WARNING, "{} ({})".format(signature.plain["cause"], signature.id))
    phases = ", ".join(signature.phases)
    return Finding(
        "known",
        WARNING,
        "known issue of these versions (shows in {}): {} ({})".format(phases, signature.plain["cause"], signature.id),
    )


def _import(result: JsonObject) -> Dict[str, Any]:
    return {name: result.get(name) for name in ("error", "file", "version")}


def _environment(choice: Choice, looked: JsonObject) -> Dict[str, Any]:
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


def _build_failure_document(here: Viewpoint, choice: Choice, looked: JsonObject) -> Dict[str, Any]:
    """Return the document for a Python that cannot be inspected: it is too old, or does not start."""
    # This line runs on every Python, even on one that can run nothing else of ours.
    code = "import sys; sys.stdout.write('%d.%d' % sys.version_info[:2])"
    version_text = here.run(
        [choice.python, "-E", "-c", code], here.scrubbed().variables, here.folder, 30.0
    ).output.strip()
    numbers = version_text.split(".")
    old = len(numbers) == 2 and all(map(str.isdigit, numbers)) and tuple(map(int, numbers)) < OLDEST
    if old:
        finding = Finding(
            "python.version",
            WARNING,
            "this is Python {}, older than 3.7, the oldest supported one".format(version_text),
        )
    else:
        finding = Finding("python.start", WARNING, "this Python does not start: {}".format(looked["trouble"]))
    return {
        "schema": 1,
        "decisive": finding.text,
        "diagnoses": [],
        "findings": [finding._asdict()],
        "environment": {
            "python": choice.python,
            "why": choice.why,
            "remarks": choice.remarks,
            "version": version_text or None,
        },
        "imports": {},
        "differences": [],
        "lurking": [],
        "nearest": None,
    }


def code(report: JsonObject) -> int:
    """Return the exit code: 0 without warnings (notes do not count), 3 if Python is too old to be inspected, else 1."""
    checks = {one["check"] for one in report["findings"] if one["level"] == WARNING}
    return 3 if checks == {"python.version"} else 1 if checks else 0


# --- for people ------------------------------------------------------------------------------------------------


def lines(report: JsonObject, in_words: Callable[[JsonObject], str]) -> Iterable[str]:
    """Yield the document as lines for people: the decisive finding first, then the rest, then what to change."""
    yield from _head(report["environment"])
    warnings = [one for one in report["findings"] if one["level"] == WARNING]
    yield from _causes(report, in_words)
    for finding in warnings[:SHOWN]:
        yield "warning: {}".format(finding["text"])
        yield from _remedy(report, finding["text"], in_words)
    if len(warnings) > SHOWN:
        yield "... and {} more warnings (--json lists all)".format(len(warnings) - SHOWN)
    notes = [one for one in report["findings"] if one["level"] == NOTE]
    yield from ("note: {}".format(one["text"]) for one in notes[:SHOWN])
    if len(notes) > SHOWN:
        yield "... and {} more notes (--json lists all)".format(len(notes) - SHOWN)
    if not warnings:
        yield "no problem was found"
    yield from _nearest(report)


def _head(environment: JsonObject) -> Iterable[str]:
    version = environment.get("version") or "does not answer"
    yield "{} (Python {}), {}".format(environment["python"], version, environment["why"])
    yield from ("  {}".format(one) for one in environment.get("remarks", ()))
    removed = environment.get("scrubbed")
    if removed is not None:
        looked = "checked with and without your shell's variables, this folder and the user site"
        yield "  {} packages, {}".format(len(environment["packages"]), looked)
    yield ""


def _causes(report: JsonObject, in_words: Callable[[JsonObject], str]) -> Iterable[str]:
    for diagnosis in report["diagnoses"][:1]:
        yield "cause: {}".format(diagnosis["cause"])
        yield "remedy: {}".format(in_words(diagnosis["remedy"]))
        yield from ("see: {}".format(reference) for reference in diagnosis["references"][:1])
        yield ""


def _remedy(report: JsonObject, text: str, in_words: Callable[[JsonObject], str]) -> Iterable[str]:
    for diagnosis in report["lurking"]:
        if text.endswith("({})".format(diagnosis["signature"])) and diagnosis["remedy"]:
            yield "  remedy: {}".format(in_words(diagnosis["remedy"]))


def _nearest(report: JsonObject) -> Iterable[str]:
    near = report["nearest"]
    if "packages" not in report["environment"]:
        return
    yield ""
    if near is None:
        yield "closest working versions: none of the installed packages was measured"
        return
    where = "{}, {}, {}".format(near["cell"], near["machine"], near["measured"][:10])
    if not near["command"]:
        beside = ", apart from {},".format(", ".join(near["uncovered"])) if near["uncovered"] else ""
        yield "these versions{} were measured together, and work ({})".format(beside, where)
    elif not _of_versions(report, near):
        changes = ", ".join("{} {}, here {}".format(one["name"], one["then"], one["now"]) for one in near["changes"])
        yield "these versions were not measured together; the nearest that work ({}) have {}".format(where, changes)
    else:
        yield "closest working versions ({}):".format(where)
        yield "  {}".format(near["command"])
    yield from ("  {}".format(one) for one in near["remarks"])
    if near["also"]:
        count = len(near["also"])
        yield "  {} more package(s) differ there, which seldom matters (--json lists them)".format(count)


def _of_versions(report: JsonObject, near: JsonObject) -> bool:
    """Return whether other versions may fix one of the warnings.

    Warnings about the requested environment (`env.*`) count only if it was made in the nearest combination.
    """
    checks = {one["check"] for one in report["findings"] if one["level"] == WARNING} & OF_VERSIONS
    return any(near["env"] or not check.startswith("env.") for check in checks)
