"""Make findings of an inspection: imports that fail, modules that are hidden, libraries loaded twice."""

from __future__ import annotations

import os
import re
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

from ..failures.matching import Around, Diagnosis, Evidence, diagnose, is_bounded, lurking
from ..failures.silent import concerns
from ..keys import MODULES
from ..requirements import requirement
from ..versions import canonical
from .differences import FIRST, Difference, versions
from .inspect_environment import USER_SITE, Viewpoint
from .package_findings import NOTE, WARNING, Finding

JsonObject = Mapping[str, Any]
STEM = re.compile(r"^(lib[A-Za-z+]+?)[-.\d]")
KINDS = {"libgomp": "OpenMP", "libomp": "OpenMP", "libiomp": "OpenMP"}
NAMES = {
    "libmujoco": "MuJoCo",
    "libstdc++": "the C++ library",
    "libGL": "libGL",
    "libEGL": "libEGL",
    "libOSMesa": "OSMesa",
    "libglfw": "GLFW",
    "libcudart": "CUDA's runtime",
}
SHOWN = 4
SHOWN_PREFIXES = tuple(
    "PYTHON LD_ MUJOCO CUDA PYOPENGL EGL DISPLAY LIBGL MESA __EGL __GLX SDL QT OMP MKL OPENBLAS JAX XLA TORCH".split()
)
"""How the variables begin whose values are shown; that of another may be a secret."""


# --- imports ---------------------------------------------------------------------------------------------------


def report_failed_imports(probes: JsonObject, apart: Sequence[Difference]) -> List[Finding]:
    """Return findings about imports that fail, except those that a difference already explains."""
    explained_modules = {one.module for one in apart if one.kind in {"import", "error"}}
    findings = []
    for name, entry in (probes["imports"] or probes["clean_imports"]).items():
        if not entry["error"] or name in explained_modules:
            continue
        if entry.get("alone"):
            text = "`import {}` fails once others are imported, and works alone: {}".format(name, entry["error"])
        else:
            text = "`import {}` fails: {}".format(name, entry["error"])
        findings.append(Finding("import", WARNING, text))
    return findings


def evidence(probes: JsonObject) -> Iterator[Evidence]:
    """Yield the errors and tracebacks of failed imports as evidence for known failures."""
    for result in (probes["imports"] or probes["clean_imports"]).values():
        if result["error"]:
            reasons = tuple(filter(None, (result["error"], result.get("traceback"))))
            yield Evidence(phase="import", reasons=reasons, signal=result.get("signal"))


def note_skipped(probes: JsonObject) -> List[Finding]:
    """Return notes on the packages that were not imported, with the reason."""
    return [
        Finding("import.skipped", NOTE, "{} was not imported: {}".format(name, why))
        for name, why in probes["left_out"].items()
    ]


# --- known failures --------------------------------------------------------------------------------------------


def failure_context(facts: JsonObject) -> Around:
    """Return the context for known failures: the installed versions and Python."""
    # A Python built from a checkout calls itself `3.14.0+`, which is no version.
    return Around(installed=versions(facts), python=facts["python"]["version"].rstrip("+"))


def known_causes(
    signatures: Iterable[Any], probes: JsonObject, facts: JsonObject, more: Sequence[Evidence] = ()
) -> Tuple[Diagnosis, ...]:
    """Return the known failures that the errors themselves show, the deepest cause first.

    Matches in a log alone do not count.
    """
    hits = diagnose(signatures, [*evidence(probes), *more], failure_context(facts))
    return tuple(hit for hit in hits if hit.is_reason)


def find_silent_issues(signatures: Iterable[Any], facts: JsonObject, env: Optional[str] = None) -> List[Any]:
    """Return the silent known issues that what is installed runs into, and that speak of the environment asked for."""
    return [one for one in lurking(signatures, failure_context(facts)) if concerns(one, env, None)]


def predict_failures(signatures: Iterable[Any], facts: JsonObject) -> List[Any]:
    """Return the known failures of exactly these versions: all take part, and the remedy asks for others.

    Two packages at least are named with versions, or one with Pythons: what fails with any version is not foreseen.
    Of several with one remedy that which shows in the fewest phases stands for all.
    """
    there = versions(facts)
    plain = [one for one in signatures if not one.masks and one.phases and not {"resolve", "install"} & {*one.phases}]
    # `lurking` takes only silent failures and asks for nothing but packages, which is the question here.
    sure = [
        one._replace(silent=True)
        for one in plain
        if not one.silent and sum(map(is_bounded, one.packages)) + bool(one.python) > 1
    ]
    by_remedy: Dict[Any, Any] = {}
    for signature in lurking(sure, failure_context(facts)):
        remedy = tuple(sorted(versions_asked([signature])))
        if _mended(signature, there) and (
            remedy not in by_remedy or len(signature.phases) < len(by_remedy[remedy].phases)
        ):
            by_remedy[remedy] = signature
    return list(by_remedy.values())


def versions_asked(signatures: Iterable[Any]) -> List[str]:
    """Return the requirements and constraints of all remedies."""
    remedies = [one.plain.get("remedy", {}) for one in signatures]
    return [text for one in remedies for key in ("requirements", "constraints") for text in one.get(key, ())]


def _mended(signature: Any, there: Mapping[str, str]) -> bool:
    """Return whether the remedy asks for other versions than those that are there."""
    requirements = [requirement(text) for text in versions_asked([signature])]
    return any(each.name in there and not each.specifiers.admits(there[each.name]) for each in requirements)


# --- modules that hide others ----------------------------------------------------------------------------------


def find_shadowing(here: Viewpoint, facts: JsonObject) -> List[Finding]:
    """Return findings about modules that are found before those of the environment's packages."""
    own = tuple(one + os.sep for one in facts["python"]["site_packages"])
    groups: Dict[Tuple[str, bool], List[JsonObject]] = {}
    for entry in facts["hidden"]:
        # A module that the environment's own folder puts first is the one that is meant.
        if not entry["first"].startswith(own):
            groups.setdefault((_place(here, facts, entry["first"]), entry["standard"]), []).append(entry)
    return [_hiding(place, those, standard=standard) for (place, standard), those in groups.items()]


def _place(here: Viewpoint, facts: JsonObject, path: str) -> str:
    """Return the place that a module is imported from, in words."""
    if os.path.dirname(path) == here.folder or os.path.dirname(os.path.dirname(path)) == here.folder:
        return "the working folder"
    entries = [entry for entry in facts["path"] if path.startswith(entry + os.sep)]
    entry = max(entries, key=len) if entries else os.path.dirname(path)
    listed = [os.path.abspath(one) for one in here.variables.get("PYTHONPATH", "").split(os.pathsep) if one]
    if entry in listed:
        return "PYTHONPATH ({})".format(entry)
    return "{} ({})".format(USER_SITE, entry) if entry == facts["python"]["user_site"] else entry


def _hiding(place: str, entries: Sequence[JsonObject], *, standard: bool) -> Finding:
    names = ", ".join(one["module"] for one in entries[:SHOWN])
    more = " and {} more".format(len(entries) - SHOWN) if len(entries) > SHOWN else ""
    whose = "of Python's own library" if standard else "of this environment"
    first = entries[0]
    text = "{} hides {}{} {}: {} is imported, not {}".format(place, names, more, whose, first["first"], first["then"])
    return Finding("import.shadowed", WARNING, text)


# --- libraries -------------------------------------------------------------------------------------------------


def find_loaded_twice(probes: JsonObject) -> List[Finding]:
    """Return findings about shared libraries that were loaded more than once in a process."""
    paths = sorted({path for one in probes["imports"].values() for path in one["libraries"]})
    groups: Dict[str, Dict[str, str]] = {}
    for path in paths:
        stem = _stem(path)
        kind = KINDS.get(stem, NAMES.get(stem))
        if kind:
            groups.setdefault(kind, {})[path] = stem
    return [_double(kind, those) for kind, those in groups.items() if len(those) > 1]


def _stem(path: str) -> str:
    """Return the name of a library without its version."""
    name = os.path.basename(path)
    match = STEM.match(name)
    return match.group(1) if match else name


def _double(kind: str, libraries: Mapping[str, str]) -> Finding:
    listed = ", ".join(libraries)
    harmless = kind == "OpenMP" and set(libraries.values()) <= {"libgomp"}
    harmless = harmless or kind == "CUDA's runtime"
    text = "{} was loaded {} times in one process: {}".format(kind, len(libraries), listed)
    return Finding("import.library_twice", NOTE if harmless else WARNING, text)


# --- differences -----------------------------------------------------------------------------------------------


def report_differences(here: Viewpoint, facts: JsonObject, apart: Sequence[Difference]) -> List[Finding]:
    """Return findings about the differences that the caller's settings make."""
    tellers = {
        "start": _start,
        "path": _path,
        "package": _package,
        "import": _import,
        "error": _import,
        "module": _module,
        "libraries": _loaded,
    }
    groups: Dict[Tuple[str, Tuple[str, ...]], List[Difference]] = {}
    hidden_modules = {one["module"] for one in facts["hidden"]}
    other = {one.module for one in apart if one.kind == "package"}
    for entry in apart:
        if entry.module in hidden_modules and entry.kind in {"import", "error", "module"}:
            continue  # which file hides it says more
        if entry.kind == "path" and other and set(_from(entry, facts)) <= other:
            continue  # which versions come from there says more
        groups.setdefault((entry.kind, entry.by), []).append(entry)
    findings = [tellers[kind](_by(here, by), those, facts) for (kind, by), those in groups.items()]
    return findings + _without_effect(here, apart)


def _without_effect(here: Viewpoint, apart: Sequence[Difference]) -> List[Finding]:
    """Return a note on the settings that often matter and changed no import here."""
    blamed = {name for one in apart for name in one.by}
    idle = ["{}={}".format(name, here.variables[name]) for name in FIRST if name in here.removed and name not in blamed]
    text = "set here, without effect on any import that was tried: {}".format(" ".join(idle))
    return [Finding("probe.variables", NOTE, text)] if idle else []


def _by(here: Viewpoint, by: Sequence[str]) -> str:
    """Return the settings that cause a difference, in words, with the values that may be shown."""
    if not by:
        return "something in the caller's settings, but in no single setting,"
    named = ("{}={}".format(name, here.variables[name]) if name.startswith(SHOWN_PREFIXES) else name for name in by)
    return " and ".join(named)


def _start(by: str, differences: Sequence[Difference], _: JsonObject) -> Finding:
    bad, where = (
        (differences[0].as_it_is, "here")
        if differences[0].scrubbed == "it starts"
        else (differences[0].scrubbed, "without it")
    )
    return Finding("probe.difference", WARNING, "with {} this Python does not start {}: {}".format(by, where, bad))


def _from(difference: Difference, facts: JsonObject) -> List[str]:
    """Return the packages that lie in the folders of a difference."""
    entries = difference.as_it_is.split(os.pathsep)
    return [canonical(each["name"]) for each in facts["distributions"] if each["location"] in entries]


def _path(by: str, differences: Sequence[Difference], facts: JsonObject) -> Finding:
    entries = [entry for one in differences for entry in one.as_it_is.split(os.pathsep)]
    from_there = {name for one in differences for name in _from(one, facts)}
    keys = sorted(from_there & {*MODULES}) or sorted(from_there)
    names = ", ".join(keys[:SHOWN]) + (" and {} more".format(len(keys) - SHOWN) if len(keys) > SHOWN else "")
    brings = "brings {} from {}".format(names, ", ".join(entries)) if names else "adds {}".format(", ".join(entries))
    text = "{} {}, outside this environment".format(by.partition("=")[0], brings)
    return Finding("probe.difference", WARNING if set(keys) & {*MODULES} else NOTE, text)


def _package(by: str, differences: Sequence[Difference], facts: JsonObject) -> Finding:
    listed = ", ".join("{} {}, not {}".format(one.module, one.as_it_is, one.scrubbed) for one in differences[:SHOWN])
    more = " and {} more".format(len(differences) - SHOWN) if len(differences) > SHOWN else ""
    text = "versions from outside this environment are used: {}{}".format(listed, more)
    return Finding("probe.difference", WARNING, text)


def _import(by: str, differences: Sequence[Difference], _: JsonObject) -> Finding:
    names, first = ", ".join(one.module for one in differences), differences[0]
    alone = "it " + first.scrubbed if first.scrubbed.startswith("fails") else "it works"
    text = "with {} `import {}` {}; without, {}".format(by, names, first.as_it_is, alone)
    return Finding("probe.difference", WARNING, text)


def _module(by: str, differences: Sequence[Difference], _: JsonObject) -> Finding:
    first = differences[0]
    names = ", ".join(one.module for one in differences)
    text = "with {} another {} is imported: {}; without: {}".format(by, names, first.as_it_is, first.scrubbed)
    return Finding("probe.difference", WARNING, text)


def _loaded(by: str, differences: Sequence[Difference], _: JsonObject) -> Finding:
    """Make a finding about shared libraries that differ.

    Another file of the same library is a warning. An additional library is a note: that is the purpose of settings
    such as MUJOCO_GL=egl.
    """
    first = differences[0]
    stems = [{_stem(path) for path in side.split(", ") if path} for side in (first.as_it_is, first.scrubbed)]
    text = "with {} `import {}` loads {}; without, {}".format(
        by, first.module, first.as_it_is or "less", first.scrubbed or "less"
    )
    return Finding("probe.difference", WARNING if stems[0] & stems[1] else NOTE, text)
