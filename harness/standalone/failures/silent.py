"""Decide which cases silent known issues concern: nothing is raised there, so that a green result may be wrong."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import Any, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

PREFIX = "silent:"
"""Stands before the id of such an issue in `unverified`."""
PASSED = "passed"
SHOWING = frozenset(("failed", "flaky"))
"""Outcomes of a misleading check that show an issue."""


class CaseResult(NamedTuple):
    """One case as it was measured: its environment as it was asked for, and how its phases and checks ended.

    `opengl` is whether an OpenGL context drew its pictures.
    """

    env: Optional[str]
    api: str
    phases: Mapping[str, str]
    checks: Mapping[str, str]
    opengl: bool


def plainly_good(verdict: str, unverified: Iterable[str]) -> bool:
    """Return whether a cell works, and no silent issue is left open in it: the only cells to recommend."""
    return verdict == "works" and not silent_ids(unverified)


def silent_ids(unverified: Iterable[str]) -> List[str]:
    """Return the ids of the silent issues among all that a result leaves unverified."""
    return [name[len(PREFIX) :] for name in unverified if name.startswith(PREFIX)]


def open_issues(lurking: Iterable[Any], case: CaseResult) -> Tuple[str, ...]:
    """Return the silent issues, as `silent:ID`, that fit a case and that no check has shown or refuted.

    `lurking` are those whose packages are all installed.
    """
    fitting = [one for one in lurking if concerns(one, case.env, case.api) and _passed_there(one, case)]
    return tuple(PREFIX + one.id for one in fitting if case.checks.get(one.check) not in {PASSED, *SHOWING})


def shown_issues(lurking: Iterable[Any], case: CaseResult, misleading: Iterable[str]) -> Iterator[Any]:
    """Yield the silent issues that a misleading check has shown in a case."""
    failed = {name for name in misleading if case.checks.get(name) in SHOWING}
    for issue in lurking:
        if issue.check in failed and concerns(issue, case.env, case.api):
            yield issue


def concerns(issue: Any, env: Optional[str], api: Optional[str]) -> bool:
    """Return whether an issue speaks of an environment, given by its id as it was asked for, and of an API.

    Where either is not known, nothing speaks against it. A pattern that begins with `!` leaves environments out.
    """
    if issue.apis and api is not None and api not in issue.apis:
        return False
    if not issue.envs or env is None:
        # A case of a known API without an id makes no environment, so an issue of certain ones does not concern it.
        return not issue.envs or api is None
    names = {env, env.rpartition(":")[2]}
    left_out = [pattern[1:] for pattern in issue.envs if pattern.startswith("!")]
    named = [pattern for pattern in issue.envs if not pattern.startswith("!")]
    return not _any(names, left_out) and (not named or _any(names, named))


def _any(names: Iterable[str], patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(name, pattern) for name in names for pattern in patterns)


def _passed_there(issue: Any, case: CaseResult) -> bool:
    """Return whether a phase passed in which the issue would have been met."""
    if issue.opengl and not case.opengl:
        return False
    return any(case.phases.get(phase) == PASSED for phase in issue.phases or ("single",))
