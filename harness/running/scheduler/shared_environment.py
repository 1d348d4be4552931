"""Make the environment of a cell only when it is needed, once for all cells that share it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from harness.machine import this_machine
from harness.machine.store import InstallResult, Store, cache_folder, digest
from harness.model import Cell, Interpreter, Lock, Outcome, Phase, Step
from harness.model.hostile_data import Unreadable
from harness.model.vocabulary import FAMILY
from harness.packages.environments import first_import
from harness.running.once_per_key import Once
from harness.running.scheduler.settings import Observer, Settings

if TYPE_CHECKING:
    from harness.packages.environments.environments import Environment


class Owner(Protocol):
    """The runner, as far as a pool needs it; `installed` is what it knows of installs, `environments` are those
    that were made or looked at in this run, `doubted` are keys of installs that were found damaged."""

    store: Store
    settings: Settings
    observer: Observer
    once: Once
    installed: dict[str, InstallResult]
    environments: dict[str, Environment]
    doubted: set[str]


class NoEnvironment(Exception):
    """The environment of a lock cannot be made now."""

    def __init__(self, step: Step) -> None:
        super().__init__(step.decisive)
        self.step = step


class Pool:
    """The environment of one cell."""

    def __init__(self, owner: Owner, cell: Cell, lock: Lock, interpreter: Interpreter) -> None:
        self.owner, self.cell, self.lock, self.interpreter = owner, cell, lock, interpreter
        question = cell.question
        # Build settings count beside the lock: they decide which wheels its sdists become.
        self.key = digest(
            "install",
            lock.sha256,
            interpreter.identity,
            question.build_constraints,
            question.build_variables,
            *first_import.marks(lock.versions, question),
        )
        self.known = False

    def load_install(self) -> InstallResult | None:
        """Return the stored result of the install, if it still holds."""
        result, settings = self.owner.installed.get(self.key), self.owner.settings
        if result is None:
            result = None if settings.fresh else self.owner.store.load_installed(self.key)
            if result is None or (result.failed and (settings.again or outdated(result.failed))):
                return None
            self.owner.installed[self.key] = result
        self.known = True
        return replace(result, failed=replace(result.failed, reused=True)) if result.failed else result

    def install(self) -> InstallResult:
        """Make the environment, keep the result of the install and return it."""
        with self.owner.once.turn(("install", self.key)):
            result = self.load_install()  # another thread may have made it while we waited
            if result:
                return result
            result = self._new()
            if result.failed is None or result.failed.outcome is Outcome.FAILED:
                self.owner.store.save_installed(self.key, result)
            self.owner.installed[self.key] = result
        return result

    def _new(self) -> InstallResult:
        try:
            environment = self.environment()
        except NoEnvironment as failure:
            return InstallResult(failed=conditioned(failure.step))
        try:
            return self._describe_environment(environment)
        except Unreadable:  # it was damaged: once more, from its wheels
            self._discard(environment)
        try:
            return self._describe_environment(self.environment())
        except NoEnvironment as failure:
            return InstallResult(failed=conditioned(failure.step))

    def _discard(self, environment: Environment) -> None:
        from harness.packages.environments import environments  # noqa: PLC0415 - start-up

        environments.discard(environment)
        self.owner.environments.pop(self.key, None)

    def _describe_environment(self, environment: Environment) -> InstallResult:
        from harness.packages.environments import site_packages  # noqa: PLC0415 - start-up

        return InstallResult(
            key=environment.key,
            versions=environment.installed,
            modules=site_packages.modules(environment.path),
            speaking={api: site_packages.requiring(environment.path, api) for api in FAMILY},
            unheld=site_packages.find_unmet(environment.path),
            seconds=round(environment.seconds, 3),
            findings=environment.findings,
        )

    def environment(self) -> Environment:
        """Return the environment itself, from the pool or made now. Raises NoEnvironment."""
        from harness.packages.environments import bytecode, environments  # noqa: PLC0415 - start-up

        with self.owner.once.turn(("environment", self.key)):
            if self.key not in self.owner.environments:
                self.owner.observer.step(self.cell, Phase.INSTALL)
                ensured = self._ensured()
                if (
                    self.owner.settings.verify
                    and not isinstance(ensured, Step)
                    and not environments.is_intact(ensured, thorough=True)
                ):
                    environments.discard(ensured)
                    ensured = self._ensured()
                if isinstance(ensured, Step):
                    raise NoEnvironment(ensured)
                # An earlier case may have poisoned what numba and Warp compiled (docs/threat-model.md).
                if self.owner.settings.verify or self.owner.settings.fresh:
                    bytecode.forget(code_folder(ensured))
                self.owner.environments[self.key] = ensured
        return self.owner.environments[self.key]

    def _ensured(self) -> Environment | Step:
        from harness.packages.environments import environments  # noqa: PLC0415 - start-up
        from harness.packages.sources import overlays  # noqa: PLC0415 - start-up

        settings = self.owner.settings
        if settings.fetched:
            failed = settings.fetched.supply(self.cell, self.lock, self.interpreter)
            if failed:
                return failed
        lock = overlays.provide_wheels(self.lock, self.cell.question, offline=settings.offline)
        if isinstance(lock, Step):
            return lock
        thorough = settings.verify or self.key in self.owner.doubted
        return environments.ensure(
            lock, self.interpreter, self.cell.question, offline=settings.offline, thorough=thorough
        )


def code_folder(environment: Environment) -> Path:
    """Return the folder of the byte code of an environment."""
    return cache_folder() / "pycache" / environment.path.name


def conditioned(step: Step) -> Step:
    """Return a failed build with a mark of the system that it failed on; a resolution depends on no system."""
    return replace(step, conditions=this_machine.conditions()) if step.phase is Phase.INSTALL else step


def outdated(step: Step) -> bool:
    """Return whether something was installed on this system since: a failed build is tried again."""
    return step.conditions not in {None, this_machine.conditions()}
