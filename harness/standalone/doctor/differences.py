"""Find the differences that the caller's variables, folder and user site make.

The environment is inspected without them (scrubbed), then with one of them kept, to find the one that causes a
difference.
"""

from __future__ import annotations

import os
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Sequence, Tuple

from ..versions import canonical
from .inspect_environment import USER_SITE, Viewpoint, describe_environment, imports

FOLDER = "the working folder"
FIRST = (
    "PYTHONPATH LD_LIBRARY_PATH LD_PRELOAD MUJOCO_GL PYOPENGL_PLATFORM CUDA_VISIBLE_DEVICES PYTHONHOME MUJOCO_PATH"
    " MUJOCO_EGL_DEVICE_ID EGL_DEVICE_ID"
).split()
"""The variables that make a difference most often."""
# Each run starts a Python and imports modules anew, which may take `inspect_environment.SECONDS` for each of them.
MOST_RUNS = 32

JsonObject = Mapping[str, Any]


class Difference(NamedTuple):
    """A difference between the caller's view and the scrubbed one.

    `kind` names what differs, `by` the settings that cause it (empty if that is unknown).
    """

    kind: str
    module: str
    as_it_is: str
    scrubbed: str
    by: Tuple[str, ...]


def differences(here: Viewpoint, probes: JsonObject) -> List[Difference]:
    """Return all differences, each with the settings that cause it."""
    base_differences = _of_start(here, probes) + _of_path(here, probes) + _of_packages(probes)
    return base_differences + _of_imports(here, probes)


def _of_start(here: Viewpoint, probes: JsonObject) -> List[Difference]:
    """Return a difference if Python starts only with the caller's variables, or only without them."""
    texts = [str(probes[one].get("trouble", "")) for one in ("facts", "scrubbed")]
    if bool(texts[0]) is bool(texts[1]):
        return []
    likely = [name for name in here.removed if name.startswith(("PYTHON", "LD_"))]
    by = [
        name
        for name in likely
        if bool(texts[0]) is ("trouble" in describe_environment(here.scrubbed(name), "start-" + name))
    ]
    return [Difference("start", "", texts[0] or "it starts", texts[1] or "it starts", tuple(by))]


# --- the path --------------------------------------------------------------------------------------------------


def _of_path(here: Viewpoint, probes: JsonObject) -> List[Difference]:
    """Return the folders that the caller's settings add to those of the environment for imports, grouped by cause."""
    if "path" not in probes["facts"] or "path" not in probes["scrubbed"]:
        return []
    clean = set(probes["scrubbed"]["path"])
    more = [entry for entry in probes["facts"]["path"] if entry not in clean]
    groups: Dict[Tuple[str, ...], List[str]] = {}
    for entry in more:
        groups.setdefault(origin(here, probes["facts"], entry), []).append(entry)
    return [Difference("path", "", os.pathsep.join(entries), "", by) for by, entries in groups.items()]


def origin(here: Viewpoint, description: JsonObject, entry: str) -> Tuple[str, ...]:
    """Return the setting that puts a folder on the path; empty if that is unknown."""
    for name in ("PYTHONPATH", "PYTHONHOME"):
        for folder in here.variables.get(name, "").split(os.pathsep):
            place = os.path.abspath(os.path.join(here.folder, folder))
            if folder and (place == entry or (name == "PYTHONHOME" and entry.startswith(place + os.sep))):
                return (name,)
    if entry == description.get("python", {}).get("user_site"):
        return (USER_SITE,)
    return ()


def _of_packages(probes: JsonObject) -> List[Difference]:
    """Return the packages whose version differs between the caller's view and the scrubbed one."""
    here, clean = versions(probes["facts"]), versions(probes["scrubbed"])
    paths = {name: one["location"] for name, one in resolve_distributions(probes["facts"]).items()}
    return [
        Difference("package", name, "{} in {}".format(here[name], paths[name]), str(clean[name]), ())
        for name in sorted(here)
        if name in clean and here[name] != clean[name]
    ]


def resolve_distributions(description: JsonObject) -> Dict[str, Dict[str, Any]]:
    """Return the distribution that Python finds first for each package name."""
    distributions: Dict[str, Dict[str, Any]] = {}
    for distribution in description.get("distributions", ()):
        distributions.setdefault(canonical(distribution["name"]), distribution)
    return distributions


def versions(description: JsonObject) -> Dict[str, str]:
    """Return the installed versions by package name; packages without a version are left out."""
    return {name: one["version"] for name, one in resolve_distributions(description).items() if one["version"]}


# --- imports ---------------------------------------------------------------------------------------------------


def outcome(result: JsonObject) -> Tuple[Any, ...]:
    """Return the comparable result of an import: error, real file, version, and the library's own answers."""
    if result["error"]:
        return ("error", result["error"], "", "")
    file = result["file"] and os.path.realpath(result["file"])
    return ("", file, result["version"] or "", tuple(sorted(result.get("asked", {}).items())))


def describe_result(result: JsonObject) -> str:
    """Describe the result of an import in a few words."""
    if result["error"]:
        return "fails: " + str(result["error"])
    parts = [result["file"] or "", result["version"] or ""]
    parts += ["{} {}".format(name, value) for name, value in sorted(result.get("asked", {}).items())]
    return ", ".join(filter(None, parts))


def _libraries(result: JsonObject) -> Tuple[str, ...]:
    return tuple(sorted(set(result["libraries"])))


def _of_imports(here: Viewpoint, probes: JsonObject) -> List[Difference]:
    current, other = probes["imports"], probes["clean_imports"]
    both = [name for name in current if name in other]
    apart = [name for name in both if outcome(current[name]) != outcome(other[name])]
    import_differences = []
    if apart:
        blamed = _find_causes(here, apart, {name: outcome(current[name]) for name in apart}, outcome)
        import_differences = [
            Difference(
                _kind(current[n], other[n]), n, describe_result(current[n]), describe_result(other[n]), blamed[n]
            )
            for n in apart
        ]
    alike = [] if apart else both  # a process has all that was loaded before, too
    elsewhere = [name for name in alike if _libraries(current[name]) != _libraries(other[name])][:1]
    for name in elsewhere:
        here_only, there_only = (
            ", ".join(sorted({*_libraries(a[name])} - {*_libraries(b[name])}))
            for a, b in ((current, other), (other, current))
        )
        names = both[: both.index(name) + 1]
        blamed = _find_causes(here, names, {name: _libraries(current[name])}, _libraries)
        import_differences.append(Difference("libraries", name, here_only, there_only, blamed[name]))
    return import_differences


def _kind(result: JsonObject, other: JsonObject) -> str:
    if bool(result["error"]) is not bool(other["error"]):
        return "import"
    return "error" if result["error"] else "module"


def _find_causes(
    here: Viewpoint, names: Sequence[str], wanted: Mapping[str, Any], seen: Any
) -> Dict[str, Tuple[str, ...]]:
    """Find the settings that cause each outcome: one alone, kept by itself, else the fewest together."""
    causes: Dict[str, Tuple[str, ...]] = dict.fromkeys(wanted, ())
    trials = [0]

    def try_settings(settings: Sequence[str]) -> List[str]:
        """Return the modules that have the wanted outcome with only these settings kept; none after too many runs."""
        trials[0] += 1
        if trials[0] > MOST_RUNS:
            return []
        folder = here.folder if FOLDER in settings else None
        results = imports(here.scrubbed(*settings, folder=folder), names)
        return [name for name in wanted if seen(results[name]) == wanted[name]]

    removed = here.removed
    for setting in [*(name for name in FIRST if name in removed), FOLDER, USER_SITE]:
        if all(causes.values()):
            return causes
        for name in try_settings([setting]):
            causes[name] = causes[name] or (setting,)
    left = [name for name in wanted if not causes[name]]
    if left:
        fewest = _fewest([*removed, FOLDER, USER_SITE], lambda settings: set(left) <= set(try_settings(settings)))
        causes.update((name, fewest) for name in left)
    return causes


def _fewest(items: Sequence[str], enough: Callable[[Sequence[str]], bool]) -> Tuple[str, ...]:
    """Return few of these items that are still enough; none if all are not enough.

    Parts are left out, half of all first.
    """
    subset = list(items)
    if not enough(subset):
        return ()
    size = len(subset) // 2
    while size:
        place = 0
        while place < len(subset):
            rest = subset[:place] + subset[place + size :]
            if rest and enough(rest):
                subset = rest
            else:
                place += size
        size = size // 2
    return tuple(subset)
