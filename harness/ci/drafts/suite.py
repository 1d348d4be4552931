"""Find the extras and dependency groups that the tests of a project need, and the folder of its tests."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from packaging.requirements import InvalidRequirement
from packaging.utils import canonicalize_name

from harness.model import requirement_texts

PYTEST = "pytest"
NAMES = ("test", "tests", "testing", "pytest")
"""Extras and groups called so are for tests."""

MIXED = ("dev", "develop", "development", "ci", "all-dev")
"""Those for developers, taken where they name pytest or a plugin of it."""

ASIDE = frozenset({"docs", "doc", "documentation", "lint", "linting", "style", "format", "typing", "release", "build"})
"""Those that no test needs."""

FOLDERS = ("tests", "test")


@dataclass(frozen=True, kw_only=True, slots=True)
class SuiteDraft:
    """The `[suite]` of a first matrix."""

    arguments: tuple[str, ...] = ()
    extras: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()
    requirements: tuple[str, ...] = ()


def draft_suite(
    extras: Mapping[str, Sequence[str]],
    groups: Mapping[str, Sequence[object]],
    folders: Collection[str],
    *,
    in_workflow: Iterable[str] = (),
    configured: bool = False,
) -> SuiteDraft | None:
    """Return the settings that run the tests, None if there are no tests.

    `folders` are those of the project; `in_workflow` are extras that its own CI installs beside pytest, `configured`
    says that pytest's settings name where tests lie.
    """
    place = next((folder for folder in FOLDERS if folder in folders), None)
    if place is None and not configured:
        return None
    of_tests = [*_for_tests(extras)]
    of_ci = [name for name in in_workflow if name in extras and canonicalize_name(name) not in ASIDE]
    grouped = () if of_tests else _for_tests(groups)
    return SuiteDraft(
        # By itself pytest finds the tests that its settings name, wherever they lie.
        arguments=() if configured or place is None else (place,),
        extras=tuple(dict.fromkeys((*of_ci, *of_tests))),
        groups=tuple(grouped),
    )


def runtime(extras: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return the extras that users of the package install: none for tests, documentation or developers."""
    aside = {*NAMES, *MIXED, *ASIDE}
    return tuple(name for name in extras if canonicalize_name(name) not in aside)


def _for_tests(named: Mapping[str, Sequence[object]]) -> Iterator[str]:
    matches = [name for name in named if canonicalize_name(name) in NAMES]
    mixed = (name for name in named if canonicalize_name(name) in MIXED and _names_pytest(named[name]))
    yield from matches or mixed


def _names_pytest(lines: Iterable[object]) -> bool:
    """Return whether one of these requirements is pytest, or is made for it."""
    for line in lines:
        try:
            name = canonicalize_name(requirement_texts.requirement(str(line)).name)
        except InvalidRequirement:
            # A group may hold tables such as { include-group = "x" }, and an extra may hold lines that nobody can read.
            continue
        if name == PYTEST or name.startswith(f"{PYTEST}-"):
            return True
    return False
