"""Find the working measured combination nearest to the installed packages, and the changes that lead to it.

`measured` is the document of measured results: cells with verdict, Python, cases and the lock of each.
"""

from __future__ import annotations

from typing import Any, Container, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from ..adapters import package
from ..failures import matching
from ..failures.matching import Around
from ..failures.silent import plainly_good
from ..installing import Installer
from ..keys import SIMULATORS, weight
from ..requirements import Requirement, requirement
from ..versions import is_version, version
from .differences import versions
from .package_findings import NOTE, WARNING, Finding, Violation, find_violations

JsonObject = Mapping[str, Any]
PYTHON, UNCOVERED, FARTHEST = 8, 20, 2
"""What it weighs that a cell was measured on the next minor version of Python, and that it says nothing of a package
that is here; and from how many minor versions away nothing is taken."""
# Only this many are checked for conflicts, because each check reads the requirements of all packages again.
MOST = 40
FAMILY = ("gymnasium", "gym")
"""APIs that register environments under the same ids."""

FAILED = frozenset(("failed", "crashed", "timed_out"))


class Change(NamedTuple):
    """A change of one package: `now` is the installed version (None if missing), `then` the version to install."""

    name: str
    now: Optional[str]
    then: str


class Candidate(NamedTuple):
    """A cell that works, and its distance: `changes` matter, `also` are the other versions that differ.

    `uncovered` is there and not in the cell, `foreign` in the cell and not there.
    """

    cell: JsonObject
    lock: Mapping[str, str]
    changes: Tuple[Change, ...]
    also: Tuple[Change, ...]
    uncovered: Tuple[str, ...]
    foreign: Tuple[str, ...]

    @property
    def distance(self) -> int:
        """Return the sum of the weights of all changes; another patch release weighs least."""
        return sum(max(weight(one.name), 1) * _gap(one) for one in self.changes)


def minor(text: Optional[str]) -> str:
    """Return the first two parts of a version of Python."""
    return ".".join((text or "").split(".")[:2])


def subjects(facts: JsonObject) -> List[str]:
    """Return the simulators that are installed here, sorted by name."""
    return sorted(set(versions(facts)) & SIMULATORS)


def find(
    facts: JsonObject,
    measured: JsonObject,
    env: Optional[str] = None,
    remedies: Sequence[str] = (),
    issues: Sequence[Any] = (),
    api: Optional[str] = None,
) -> Optional[Candidate]:
    """Return the nearest cell, first one that breaks no unchanged package; None if nothing known is installed.

    One that does what `remedies` ask for is nearer. One whose own versions run into one of the `issues` (known failures
    of what is installed here) is no answer, whatever passed there. `api` is the one that `env` speaks.
    """
    wanted = subjects(facts)
    green = _green(measured, env, api)
    near = [_near(facts, cell, lock, wanted, env) for cell, lock in green if not _shares(issues, cell, lock)]
    python = facts["python"]["version"]
    near = [one for one in near if _count_minors_apart(one.cell["python"], python) <= FARTHEST]
    fitting = [one for one in near if len(one.uncovered) < max(len(wanted), 1)] if wanted or env else []
    requirements = [requirement(text) for text in remedies]
    ordered = sorted(fitting, key=lambda candidate: (_against(candidate, requirements), _order(candidate, facts)))[
        :MOST
    ]
    candidates = [_with_needs(facts, _with_missing(facts, one, requirements)) for one in ordered]
    return next(
        (one for one in candidates if not describe_conflicts(facts, one)), candidates[0] if candidates else None
    )


def spoken_api(env: Optional[str], api: Optional[str], installed: Container[str]) -> Optional[str]:
    """Return the API that an environment's id belongs to: the named one, that of its prefix, else gymnasium before gym.

    None where neither is installed, or no environment is named.
    """
    if env is None or api is not None:
        return api
    prefix = env.partition(":")[0] if ":" in env else ""
    return prefix if prefix in FAMILY else next((name for name in FAMILY if name in installed), None)


def _green(measured: JsonObject, env: Optional[str], api: Optional[str]) -> Iterator[Tuple[JsonObject, Dict[str, str]]]:
    """Yield the cells that work, each with its installed versions."""
    for cell in measured.get("cells", ()):
        lock = measured["locks"].get(cell["lock"]) if cell["lock"] else None
        # A cell with repaired wheels is no answer: the suggested command would install the ones of the index.
        if lock and is_good(cell) and not cell.get("repairs") and (env is None or _has(cell, env, api)):
            yield cell, dict(lock)


def _shares(issues: Sequence[Any], cell: JsonObject, lock: Mapping[str, str]) -> bool:
    """Tell whether the versions of a cell run into one of these known failures, as those that are installed here do."""
    # A failure of packages in any version says nothing against a cell that was measured to work.
    bounded = [one._replace(silent=True) for one in issues if any(map(matching.is_bounded, one.packages))]
    return bool(matching.lurking(bounded, Around(installed=lock, python=cell["python"])))


def is_good(cell: JsonObject) -> bool:
    """Return whether a cell works, and no silent issue is left open in it."""
    return plainly_good(cell["verdict"], cell["unverified"])


def _has(cell: JsonObject, env: str, api: Optional[str]) -> bool:
    """Return whether an environment was made and stepped there; one of gym says nothing of gymnasium's."""
    return any(
        (case["api"] == api or case["api"] not in FAMILY or api is None)
        and bare_id(case["env"], case["api"]) == bare_id(env, case["api"])
        and case["phases"].get("single") == "passed"
        for case in cell["cases"]
        if case["env"]
    )


def bare_id(env: str, api: str) -> str:
    """Return the id of an environment without the name of its API."""
    return env[len(api) + 1 :] if env.startswith(api + ":") else env


def _near(
    facts: JsonObject, cell: JsonObject, lock: Dict[str, str], wanted: Sequence[str], env: Optional[str]
) -> Candidate:
    there = versions(facts)
    apart = [Change(name, there[name], then) for name, then in lock.items() if name in there and there[name] != then]
    if env is not None:
        brought = {case["api"] for case in cell["cases"] if case["env"] and bare_id(case["env"], case["api"]) == env}
        named = {name for name in lock if name in SIMULATORS and (name in cell["axes"] or name in brought)}
        apart += [Change(name, None, lock[name]) for name in sorted(named - set(there))]
    changes = [one for one in apart if _matters(one)]
    return Candidate(
        cell=cell,
        lock=lock,
        changes=tuple(sorted(changes, key=lambda change: (-weight(change.name), change.name))),
        also=tuple(sorted(one for one in apart if one not in changes)),
        uncovered=tuple(name for name in wanted if name not in lock),
        foreign=tuple(sorted(name for name in lock if name in SIMULATORS and name not in there)),
    )


def _matters(change: Change) -> bool:
    """Return whether a difference counts: of simulators each, of what they stand on that of the first number."""
    if change.now is None or change.name in SIMULATORS:
        return True
    if not weight(change.name) or not is_version(change.now):
        return False
    return version(change.now).release[:1] != version(change.then).release[:1]


def _order(candidate: Candidate, facts: JsonObject) -> Tuple[Any, ...]:
    """Return a sort key, least for the nearest cell: it has all that is here, and needs few changes.

    Another Python counts as a change.
    """
    away = _count_minors_apart(candidate.cell["python"], facts["python"]["version"])
    numpy = candidate.lock.get("numpy", "0")
    newest = tuple(-part for part in version(numpy).release) if is_version(numpy) else ()
    settings = len(candidate.cell.get("environment", {}))
    return (
        candidate.distance + PYTHON * away + UNCOVERED * len(candidate.uncovered),
        _old(candidate), len(candidate.foreign), away, settings,
        len(candidate.also), newest, candidate.cell["id"],
    )  # fmt: skip


def _old(candidate: Candidate) -> List[Any]:
    """Return a sort key of the packages missing here: gymnasium first, then the newest versions."""
    new = [each for each in candidate.changes if each.now is None]
    return [(each.name != "gymnasium", each.name, [-part for part in version(each.then).release]) for each in new]


def _against(candidate: Candidate, requirements: Sequence[Requirement]) -> int:
    """Return how many remedies it does not heed, or says nothing of."""
    return sum(
        each.name not in candidate.lock or not each.specifiers.admits(candidate.lock[each.name])
        for each in requirements
    )


def _count_minors_apart(python: Optional[str], other: str) -> int:
    """Return how many minor versions two Pythons are apart."""
    numbers = [int(part) for each in (python, other) for part in minor(each).split(".")[1:]]
    return abs(numbers[0] - numbers[1]) if len(numbers) > 1 else 99


def _gap(change: Change) -> int:
    """Return how far two versions are apart: 1 within a minor version, 2 within a major one, else 3.

    Before 1.0 each minor version counts as a major one.
    """
    if change.now is None or not (is_version(change.now) and is_version(change.then)):
        return 3
    now, then = version(change.now).release, version(change.then).release
    if now[0] != then[0] or (now[0] == 0 and now[:2] != then[:2]):
        return 3
    return 1 if now[:2] == then[:2] else 2


def _with_missing(facts: JsonObject, candidate: Candidate, requirements: Sequence[Requirement]) -> Candidate:
    """Add the packages that a remedy installs, where they are in the cell and not here."""
    there, named = versions(facts), {each.name for each in candidate.changes}
    missing = dict.fromkeys(
        each.name for each in requirements if each.name not in {*there, *named} and each.name in candidate.lock
    )
    return candidate._replace(
        changes=(*candidate.changes, *(Change(name, None, candidate.lock[name]) for name in missing))
    )


def _with_needs(facts: JsonObject, candidate: Candidate) -> Candidate:
    """Add the changes of further packages that would otherwise conflict with the changes."""
    changes = list(candidate.changes)
    while True:
        hurt = {each.asker for each in _newly_unmet(facts, changes)}
        more = [each for each in candidate.also if each.name in hurt and each not in changes]
        if not more:
            return candidate._replace(
                changes=tuple(changes), also=tuple(each for each in candidate.also if each not in changes)
            )
        changes += more


def _newly_unmet(facts: JsonObject, changes: Iterable[Change]) -> List[Violation]:
    """Return the requirements of unchanged packages that the changes break."""
    there, changed = versions(facts), {each.name: each.then for each in changes}
    before = {(each.asker, each.name) for each in find_violations(facts, there)}
    return [
        each
        for each in find_violations(facts, {**there, **changed})
        if each.asker in there and each.asker not in changed and (each.asker, each.name) not in before
    ]


def describe_conflicts(facts: JsonObject, candidate: Candidate) -> List[str]:
    """Return sentences about unchanged packages whose requirements the changes break."""
    there = versions(facts)
    return [
        "{} {} asks for {}".format(each.asker, there[each.asker], each.text)
        for each in _newly_unmet(facts, candidate.changes)
    ]


# --- what failed -----------------------------------------------------------------------------------------------


def find_failure(facts: JsonObject, measured: JsonObject) -> List[Finding]:
    """Return a finding if exactly these versions were measured to fail, and no measurement with them works."""
    wanted = subjects(facts)
    python = minor(facts["python"]["version"])
    red: List[JsonObject] = []
    green: List[JsonObject] = []
    for cell in measured.get("cells", ()):
        lock = measured["locks"].get(cell["lock"]) if cell["lock"] else None
        # A cell with variables of its own may have failed by them, and not by its versions.
        if not lock or not wanted or minor(cell["python"]) != python or cell.get("environment"):
            continue
        candidate = _near(facts, cell, dict(lock), wanted, None)
        if not (candidate.changes or candidate.uncovered or candidate.foreign):
            (green if is_good(cell) else red).append(cell)
    telling = [(cell, envs) for cell in red for envs in [_failing(cell, wanted)] if envs and cell["decisive"]]
    return [] if green else [_red(cell, envs) for cell, envs in telling[:1]]


def _failing(cell: JsonObject, wanted: Sequence[str]) -> List[str]:
    """Return the environments that failed or mislead in a cell, of those whose API is installed here."""
    bad = [case for case in cell["cases"] if FAILED & set(case["phases"].values()) or case.get("misleads")]
    return [case["env"] for case in bad if case["env"] and package(case["api"]) in wanted]


def _red(cell: JsonObject, envs: Sequence[str]) -> Finding:
    phases = ", ".join(name for name, how in cell["phases"].items() if how in FAILED)
    what = "fails in {}".format(phases) if phases else "misleads"
    text = "measured with these versions ({}), {} {}: {}".format(cell["id"], ", ".join(envs), what, cell["decisive"])
    return Finding("measured", NOTE if cell["verdict"] == "partial" else WARNING, text)


# --- in words --------------------------------------------------------------------------------------------------


def command(candidate: Candidate, installer: Installer) -> Optional[str]:
    """Return the line that installs the changes; None where nothing has to change."""
    if not candidate.changes:
        return None
    return " && ".join(installer.installing(["{}=={}".format(each.name, each.then) for each in candidate.changes]))


def remarks(facts: JsonObject, candidate: Candidate) -> List[str]:
    """Return sentences on the limits of a combination: another Python, parts not tested, settings, conflicts."""
    python, there = minor(facts["python"]["version"]), minor(candidate.cell["python"])
    sentences = []
    if python != there:
        sentences.append("it was measured on Python {}: nothing near was measured on {}".format(there, python))
    if candidate.uncovered:
        verb = "was" if len(candidate.uncovered) == 1 else "were"
        sentences.append("{} {} not part of that test".format(" and ".join(candidate.uncovered), verb))
    if candidate.cell.get("unverified"):
        sentences.append("not verified there: {}".format(", ".join(candidate.cell["unverified"])))
    settings = {**candidate.cell.get("environment", {}), **candidate.cell.get("supplied", {})}
    if settings:
        sentences.append("with " + " ".join("{}={}".format(name, value) for name, value in sorted(settings.items())))
    return sentences + ["afterwards " + text for text in describe_conflicts(facts, candidate)]


def to_dict(facts: JsonObject, candidate: Candidate, installer: Installer, env: Optional[str] = None) -> Dict[str, Any]:
    """Return the combination as a plain dict.

    `env` is the environment that was made and stepped there, if one was requested.
    """
    cell = candidate.cell
    return {
        "cell": cell["id"],
        "env": env,
        "python": cell["python"],
        "machine": cell["machine"],
        "measured": cell["measured"],
        "lock": cell["lock"],
        "distance": candidate.distance,
        "changes": [each._asdict() for each in candidate.changes],
        "also": [each._asdict() for each in candidate.also],
        "command": command(candidate, installer),
        "uncovered": list(candidate.uncovered),
        "remarks": remarks(facts, candidate),
    }
