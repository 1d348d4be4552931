"""Define the settings of a run, the observer that it reports to, and what its cells share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from msgspec import Struct

from harness.machine import capacity
from harness.machine.store import InstallResult, Store
from harness.model import Cell, CellRecord, Interpreter, Lock, Phase, Step
from harness.packages import uv_command
from harness.running.scheduler.steps import Once

if TYPE_CHECKING:
    from harness.packages.environments.environments import Environment
    from harness.packages.package_under_test import SubjectWheel
    from harness.running.offline.offline_bundle import Fetched

WAITING = "wait"
"""The step of a cell whose environment stands and that has no slot yet."""


class Settings(Struct, frozen=True, kw_only=True):
    """The settings of a run; `until` is the last phase wanted.

    `jobs` is how many cells are probed at a time, or `capacity.AUTO`, which asks `reading` what memory is left. `fresh`
    measures everything again, `again` what failed.
    """

    jobs: int = 1
    until: Phase = Phase.SUITE
    fresh: bool = False
    again: bool = False
    offline: bool = False
    verify: bool = False
    fetched: Fetched | None = None
    reading: Callable[[], capacity.Reading] = capacity.reading


class Observer(Protocol):
    """An observer of a run, called from several threads at once."""

    def started(self, cell: Cell) -> None:
        """Report that work on a cell begins."""

    def step(self, cell: Cell, text: str) -> None:
        """Report the current step of a cell (`resolve`, `install`, `wait`, a check's name)."""

    def done(self, record: CellRecord) -> None:
        """Report that a cell is finished and stored."""

    def say(self, text: str) -> None:
        """Tell the user something once."""


class QuietObserver:
    """An observer that shows nothing of cells; what a user has to know goes on to `observer`, if there is one."""

    def __init__(self, observer: Observer | None = None) -> None:
        self._observer = observer

    def started(self, cell: Cell) -> None:
        """Show nothing."""

    def step(self, cell: Cell, text: str) -> None:
        """Show nothing."""

    def done(self, record: CellRecord) -> None:
        """Show nothing."""

    def say(self, text: str) -> None:
        """Tell the user, if somebody listens."""
        if self._observer:
            self._observer.say(text)


class StepObserver(QuietObserver):
    """An observer that hands on the steps of a cell, but not its begin and end, which `observer` sees anyway."""

    def step(self, cell: Cell, text: str) -> None:
        """Show the step, if somebody listens."""
        if self._observer:
            self._observer.step(cell, text)


@dataclass
class Workshop:
    """All that the cells of a run share: where results are kept, how they are made, and what was made once for all.

    `installed` is what is known of installs, `environments` are those that were made or looked at in this run,
    `doubted` the keys of installs that were found damaged. `measured` has the probe runs of this process by their keys.
    """

    store: Store
    settings: Settings
    observer: Observer
    once: Once = field(default_factory=Once)
    resolved: dict[str, tuple[Lock | None, Step]] = field(default_factory=dict)
    installed: dict[str, InstallResult] = field(default_factory=dict)
    environments: dict[str, Environment] = field(default_factory=dict)
    doubted: set[str] = field(default_factory=set)
    measured: dict[str, tuple[str, ...]] = field(default_factory=dict)
    subjects: dict[str, SubjectWheel | Step] = field(default_factory=dict)
    places: Mapping[str, str] = field(default_factory=uv_command.places)
    pythons: dict[str, Interpreter] = field(default_factory=dict)
    unchanged: set[str] = field(default_factory=set)
