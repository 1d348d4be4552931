"""Find the differences that the caller's variables, folder and user site make.

The environment is inspected without them (scrubbed), then with one of them kept, to find the one that causes a
difference.
"""

from __future__ import annotations

import os
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Sequence, Tuple

from ..versions import canonical
from .probing import USER_SITE, Here, facts, imports

FOLDER = "the working folder"
FIRST = (
    "PYTHONPATH LD_LIBRARY_PATH LD_PRELOAD MUJOCO_GL PYOPENGL_PLATFORM CUDA_VISIBLE_DEVICES PYTHONHOME MUJOCO_PATH"
    " MUJOCO_EGL_DEVICE_ID EGL_DEVICE_ID"
).split()
"""The variables that make a difference most often."""
MOST_RUNS = 32

Told = Mapping[str, Any]


class Difference(NamedTuple):
    """A difference between the caller's view and the scrubbed one.

    `kind` names what differs, `by` the settings that cause it (empty if that is unknown).
    """

    kind: str
    module: str
    as_it_is: str
    scrubbed: str
    by: Tuple[str, ...]

    def plain(self) -> Dict[str, Any]:
        """Return the difference as a plain dict."""
        return dict(self._asdict(), by=list(self.by))


def differences(here: Here, probes: Told) -> List[Difference]:
    """Return all differences, each with the settings that cause it."""
    found = _of_start(here, probes) + _of_path(here, probes) + _of_packages(probes)
    return found + _of_imports(here, probes)


def _of_start(here: Here, probes: Told) -> List[Difference]:
    """Return a difference if Python starts only with the caller's variables, or only without them."""
    texts = [str(probes[one].get("trouble", "")) for one in ("facts", "scrubbed")]
    if bool(texts[0]) is bool(texts[1]):
        return []
    likely = [name for name in here.removed if name.startswith(("PYTHON", "LD_"))]
    by = [name for name in likely if bool(texts[0]) is ("trouble" in facts(here.scrubbed(name), "start-" + name))]
    return [Difference("start", "", texts[0] or "it starts", texts[1] or "it starts", tuple(by))]


# --- the path --------------------------------------------------------------------------------------------------


def _of_path(here: Here, probes: Told) -> List[Difference]:
    """Return the folders that the caller's settings add to those of the environment for imports, grouped by cause."""
    if "path" not in probes["facts"] or "path" not in probes["scrubbed"]:
        return []
    clean = set(probes["scrubbed"]["path"])
    more = [entry for entry in probes["facts"]["path"] if entry not in clean]
    groups: Dict[Tuple[str, ...], List[str]] = {}
    for entry in more:
        groups.setdefault(origin(here, probes["facts"], entry), []).append(entry)
    return [Difference("path", "", os.pathsep.join(entries), "", by) for by, entries in groups.items()]


def origin(here: Here, told: Told, entry: str) -> Tuple[str, ...]:
    """Return the setting that puts a folder on the path; empty if that is unknown."""
    for name in ("PYTHONPATH", "PYTHONHOME"):
        for one in here.variables.get(name, "").split(os.pathsep):
            place = os.path.abspath(os.path.join(here.folder, one))
            if one and (place == entry or (name == "PYTHONHOME" and entry.startswith(place + os.sep))):
                return (name,)
    if entry == told.get("python", {}).get("user_site"):
        return (USER_SITE,)
    return ()


def _of_packages(probes: Told) -> List[Difference]:
    """Return the packages whose version differs between the caller's view and the scrubbed one."""
    here, clean = versions(probes["facts"]), versions(probes["scrubbed"])
    paths = {name: one["location"] for name, one in effective(probes["facts"]).items()}
    return [
        Difference("package", name, "{} in {}".format(here[name], paths[name]), str(clean[name]), ())
        for name in sorted(here)
        if name in clean and here[name] != clean[name]
    ]


def effective(told: Told) -> Dict[str, Dict[str, Any]]:
    """Return the distribution that Python finds first for each package name."""
    found: Dict[str, Dict[str, Any]] = {}
    for one in told.get("distributions", ()):
        found.setdefault(canonical(one["name"]), one)
    return found


def versions(told: Told) -> Dict[str, str]:
    """Return the installed versions by package name; packages without a version are left out."""
    return {name: one["version"] for name, one in effective(told).items() if one["version"]}


# --- imports ---------------------------------------------------------------------------------------------------


def outcome(told: Told) -> Tuple[Any, ...]:
    """Return the comparable result of an import: error, real file, version, and the library's own answers."""
    if told["error"]:
        return ("error", told["error"], "", "")
    file = told["file"] and os.path.realpath(told["file"])
    return ("", file, told["version"] or "", tuple(sorted(told.get("asked", {}).items())))


def said(told: Told) -> str:
    """Describe the result of an import in a few words."""
    if told["error"]:
        return "fails: " + str(told["error"])
    parts = [told["file"] or "", told["version"] or ""]
    parts += ["{} {}".format(name, value) for name, value in sorted(told.get("asked", {}).items())]
    return ", ".join(filter(None, parts))


def _libraries(told: Told) -> Tuple[str, ...]:
    return tuple(sorted(set(told["libraries"])))


def _of_imports(here: Here, probes: Told) -> List[Difference]:
    one, other = probes["imports"], probes["clean_imports"]
    both = [name for name in one if name in other]
    apart = [name for name in both if outcome(one[name]) != outcome(other[name])]
    found = []
    if apart:
        blamed = _blamed(here, apart, {name: outcome(one[name]) for name in apart}, outcome)
        found = [Difference(_kind(one[n], other[n]), n, said(one[n]), said(other[n]), blamed[n]) for n in apart]
    alike = [] if apart else both  # a process has all that was loaded before, too
    elsewhere = [name for name in alike if _libraries(one[name]) != _libraries(other[name])][:1]
    for name in elsewhere:
        here_only, there_only = (
            ", ".join(sorted({*_libraries(a[name])} - {*_libraries(b[name])})) for a, b in ((one, other), (other, one))
        )
        names = both[: both.index(name) + 1]
        blamed = _blamed(here, names, {name: _libraries(one[name])}, _libraries)
        found.append(Difference("libraries", name, here_only, there_only, blamed[name]))
    return found


def _kind(one: Told, other: Told) -> str:
    if bool(one["error"]) is not bool(other["error"]):
        return "import"
    return "error" if one["error"] else "module"


def _blamed(here: Here, names: Sequence[str], wanted: Mapping[str, Any], seen: Any) -> Dict[str, Tuple[str, ...]]:
    """Find the settings that cause each outcome: one alone, kept by itself, else the fewest together."""
    found: Dict[str, Tuple[str, ...]] = dict.fromkeys(wanted, ())
    trials = [0]

    def tried(kept: Sequence[str]) -> List[str]:
        """Return the modules that have the wanted outcome with only these settings kept; none after too many runs."""
        trials[0] += 1
        if trials[0] > MOST_RUNS:
            return []
        folder = here.folder if FOLDER in kept else None
        told = imports(here.scrubbed(*kept, folder=folder), names)
        return [name for name in wanted if seen(told[name]) == wanted[name]]

    removed = here.removed
    for one in [*(name for name in FIRST if name in removed), FOLDER, USER_SITE]:
        if all(found.values()):
            return found
        for name in tried([one]):
            found[name] = found[name] or (one,)
    left = [name for name in wanted if not found[name]]
    if left:
        fewest = _fewest([*removed, FOLDER, USER_SITE], lambda kept: set(left) <= set(tried(kept)))
        found.update((name, fewest) for name in left)
    return found


def _fewest(items: Sequence[str], enough: Callable[[Sequence[str]], bool]) -> Tuple[str, ...]:
    """Return few of these items that are still enough; none if all are not enough.

    Parts are left out, half of all first.
    """
    kept = list(items)
    if not enough(kept):
        return ()
    size = len(kept) // 2
    while size:
        place = 0
        while place < len(kept):
            rest = kept[:place] + kept[place + size :]
            if rest and enough(rest):
                kept = rest
            else:
                place += size
        size = size // 2
    return tuple(kept)
