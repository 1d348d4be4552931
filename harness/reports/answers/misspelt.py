"""Refuse requirements that no index can serve: a misspelt package, a release that does not exist.

Only what the user wrote is looked at, never the metadata of other packages, and without any cutoff: a release that
came later, or was yanked, exists. Releases that an index once listed are remembered, so that good input asks no network
twice.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from difflib import get_close_matches
from hashlib import sha256

from msgspec import Struct
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version

from harness.machine import process, store
from harness.machine.files import guarded_files
from harness.model import Cell, IndexSettings, Verdict
from harness.model.errors import BadInput
from harness.model.hostile_data import Unreadable
from harness.model.vocabulary import parsed_requirement
from harness.packages import index
from harness.packages.index_settings import NOTHING, combine
from harness.reports.answers import result_index

Say = Callable[[str], None]
AT_A_TIME = 8


class Listing(Struct, frozen=True, kw_only=True):
    """The versions of a package in an index; `newest` is neither yanked nor, if possible, a pre-release."""

    versions: tuple[str, ...] = ()
    newest: str | None = None


def check_cells(cells: Iterable[Cell], say: Say, *, offline: bool = False) -> None:
    """Refuse requirements of cells that no index has, except in cells expected to be unresolvable. Raises BadInput."""
    unexpected = (cell for cell in cells if not cell.expect or cell.expect.verdict is not Verdict.UNRESOLVABLE)
    questions = {id(cell.question): cell.question for cell in unexpected}
    by_index: dict[IndexSettings, dict[str, None]] = {}
    for question in questions.values():
        texts = by_index.setdefault(question.index, {})
        texts |= dict.fromkeys(
            (*question.requirements, *question.constraints, *question.overrides, *question.build_constraints)
        )
    for place, requirements in by_index.items():
        check(requirements, say, place, offline=offline)


def check(requirements: Iterable[str], say: Say, index: IndexSettings = NOTHING, *, offline: bool = False) -> None:
    """Refuse requirements that the index cannot serve; print a note if it cannot be asked. Raises BadInput."""
    wanted: dict[str, list[Requirement]] = {}
    for requirement in filter(None, map(_parsed, requirements)):
        if not requirement.url:
            wanted.setdefault(canonicalize_name(requirement.name), []).append(requirement)
    memory = _Memory(index)
    listings = {name: memory.load(name) for name in wanted}
    unseen = [name for name, asked in wanted.items() if not all(_fits(one, listings[name]) for one in asked)]
    answers = _ask_index(unseen, index, offline=offline)
    wrong = [line for name, listed in answers.items() for line in _describe_faults(name, wanted[name], listed)]
    if wrong:
        raise BadInput("\n".join(wrong))
    if len(answers) < len(unseen):
        silent = ", ".join(name for name in unseen if name not in answers)
        say(f"note: the package index could not be asked whether this exists: {silent}")


# --- what is wrong ---------------------------------------------------------------------------------------------


def _describe_faults(name: str, requirements: Iterable[Requirement], listed: Listing | None) -> Iterable[str]:
    """Yield a line for each requirement that cannot be served; `listed` is None where there is no such package."""
    if listed is None:
        near = nearest(name)
        yield f"{name}: no such package" + (f"; did you mean {near}?" if near else "; check its name")
        return
    for requirement in (
        requirements if listed.versions else ()
    ):  # a page that lists nothing, a login page say, tells nothing
        if not _fits(requirement, listed):
            pinned = _pinned(requirement)
            what = f"{name} {pinned}: no such release" if pinned else f"{name}{requirement.specifier}: no release fits"
            yield f"{what}; newest is {listed.newest or listed.versions[-1]}"


def nearest(name: str) -> str | None:
    """Return the most similarly spelt name of a measured or well-known package, or None."""
    from harness.standalone.keys import MODULES  # noqa: PLC0415 - start-up

    measured = result_index.load()
    axes = {name for cell in measured.cells for name in cell.axes if name != "python"}
    locked = {name for lock in measured.locks.values() for name, _ in lock}
    return next(iter(get_close_matches(name, sorted({*MODULES, *axes, *locked}), n=1, cutoff=0.75)), None)


def _parsed(text: str) -> Requirement | None:
    """Return the parsed requirement, or None if it is invalid: the code that needs it reports the error."""
    try:
        return parsed_requirement(text)
    except ValueError:
        return None


def _pinned(requirement: Requirement) -> str | None:
    """Return the version that a requirement pins, or None."""
    exact = [
        part.version for part in requirement.specifier if part.operator in {"==", "==="} and "*" not in part.version
    ]
    return exact[0] if len(requirement.specifier) == 1 and exact else None


def _fits(requirement: Requirement, listed: Listing | None) -> bool:
    """Return whether some release satisfies a requirement.

    The local part of a version is ignored: such releases come from other indexes.
    """
    if listed is None:
        return False
    plain = SpecifierSet(
        ",".join(str(part).partition("+")[0] for part in requirement.specifier if part.operator != "===")
    )
    return any(plain.contains(version, prereleases=True) for version in listed.versions)


# --- what an index has -----------------------------------------------------------------------------------------


def _ask_index(names: Sequence[str], settings: IndexSettings, *, offline: bool) -> dict[str, Listing | None]:
    """Ask the index about packages and return the answers by name.

    A package that the index lacks maps to None. A package that it did not answer for is left out.
    """
    if not names:
        return {}

    memory = _Memory(settings)

    def answer(name: str) -> tuple[str, Listing | None] | None:
        try:
            # This check only helps before the work: an index that is slow or down must not hold up the run.
            releases = index.releases(name, settings, offline=offline, patience=index.HASTY)
        except index.UnknownPackage:
            # Unknown names are not remembered: a package may be published later.
            return name, None
        except index.IndexUnreachable:
            return None
        plain = [each.version for each in releases if not each.yanked]
        stable = [version for version in plain if not Version(version).is_prerelease]
        listed = Listing(
            versions=tuple(each.version for each in releases), newest=next(reversed(stable or plain), None)
        )
        memory.keep(name, listed)
        return name, listed

    with ThreadPoolExecutor(AT_A_TIME) as pool:
        try:
            return dict(filter(None, pool.map(answer, names)))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            process.stop()
            raise


MOST_LISTED = 16 << 20


class _Memory:
    """Package listings of an index from earlier runs, in the cache folder."""

    def __init__(self, settings: IndexSettings) -> None:
        # The user's own uv and pip settings are part of the key, because other places list other releases.
        places = sha256(repr(combine(settings)).encode()).hexdigest()[:12]
        self._folder = store.cache_folder() / "releases" / places

    def load(self, name: str) -> Listing | None:
        """Return the stored listing, or None if there is none."""
        try:
            listed = guarded_files.read_decoded(self._folder / f"{name}.json", MOST_LISTED, json.loads)
            return Listing(versions=tuple(map(str, listed)))
        except (Unreadable, TypeError):
            return None

    def keep(self, name: str, listed: Listing) -> None:
        """Store a listing."""
        store.write_atomic(self._folder / f"{name}.json", json.dumps(listed.versions).encode())
