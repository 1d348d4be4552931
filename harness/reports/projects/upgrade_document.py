"""Define the document of `upgrade`, and its exit code."""

from __future__ import annotations

import msgspec

from harness.reports.projects.changes import TaskChange
from harness.reports.projects.installable import InstallAnswer
from harness.reports.projects.tried_task import TriedTask


class Move(msgspec.Struct, frozen=True, kw_only=True):
    """A package that moves: `now` is the version at hand, None if it is not there or not pinned.

    With `pulled` a resolver moves it, since another one that moves requires that: to the newest release that fits.
    """

    name: str
    now: str | None
    then: str
    pulled: bool = False


class RunningTask(msgspec.Struct, frozen=True, kw_only=True):
    """An environment in the measured combination nearest to the upgrade; `line` says why it does not work."""

    env: str
    works: bool
    cell: str
    python: str
    line: str | None = None
    other_versions: dict[str, str] = {}


class Sameness(msgspec.Struct, frozen=True, kw_only=True):
    """The environments that stay the same, that change, and of which it was not measured.

    `between` are those that stay the same by their neighbours: one of the releases was not measured itself.
    `other_versions` are those of other packages with which it was measured, where they are not those at hand.
    """

    same: tuple[str, ...]
    changed: tuple[TaskChange, ...]
    unmeasured: tuple[str, ...]
    between: tuple[str, ...] = ()
    starts: tuple[str, ...] = ()
    other_versions: dict[str, str] = {}

    @property
    def changing(self) -> list[str]:
        """Return the environments that change."""
        return sorted({change.env for change in self.changed})


class Upgraded(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `upgrade --json`.

    `tasks` are the environments of the project that use a package which moves. `unchanging` is the newest release of
    each package at which nothing is known to change, None where that is the one at hand. `command` does the upgrade.
    `tried` are tasks that were measured for this answer.
    """

    schema: int = 1
    source: str
    python: str | None
    moves: tuple[Move, ...]
    install: InstallAnswer
    tasks: tuple[str, ...]
    running: tuple[RunningTask, ...]
    behaviour: Sameness
    pictures: Sameness
    unchanging: dict[str, str | None]
    command: tuple[str, ...]
    tried: tuple[TriedTask, ...] = ()


def exit_code(document: Upgraded) -> int:
    """Return 1 where something fails or changes, 3 where something was not measured, else 0."""
    fails = document.install.possible is False or any(not task.works for task in document.running)
    tried = [task for task in document.tried if not task.runs_then or task.behaves_otherwise]
    if fails or tried or document.behaviour.changed or document.pictures.changed:
        return 1
    same = {task.env for task in document.tried if task.behaves_otherwise is False}
    ran = {task.env for task in document.running} | same
    tasks = {*document.tasks} or same
    whole = tasks and ran >= tasks and {*document.behaviour.unmeasured} <= same
    return 0 if whole and (document.install.possible or same) else 3
