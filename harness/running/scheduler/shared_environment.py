"""Make the environment of a cell only when it is needed, once for all cells that share it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from harness.machine import this_machine
from harness.machine.store import InstallResult, cache_folder, digest
from harness.model import Cell, Interpreter, Lock, Outcome, Phase, Step, replace
from harness.model.hostile_data import Unreadable
from harness.model.vocabulary import FAMILY
from harness.packages.environments import bytecode, first_import, site_packages
from harness.packages.step_failed import StepFailed
from harness.running.scheduler.settings import Workshop

if TYPE_CHECKING:
    from harness.packages.environments.environments import Environment


class Pool:
    """The environment of one cell."""

    def __init__(self, shop: Workshop, cell: Cell, lock: Lock, interpreter: Interpreter) -> None:
        self.shop, self.cell, self.lock, self.interpreter = shop, cell, lock, interpreter
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
        result, settings = self.shop.installed.get(self.key), self.shop.settings
        if result is None:
            result = None if settings.fresh else self.shop.store.load_installed(self.key)
            if result is None or (result.failed and (settings.again or is_outdated(result.failed))):
                return None
            self.shop.installed[self.key] = result
        self.known = True
        return replace(result, failed=replace(result.failed, reused=True)) if result.failed else result

    def install(self) -> InstallResult:
        """Make the environment, keep the result of the install and return it."""
        with self.shop.once.turn(("install", self.key)):
            result = self.load_install()  # another thread may have made it while we waited
            if result:
                return result
            result = self._new()
            if result.failed is None or result.failed.outcome is Outcome.FAILED:
                self.shop.store.save_installed(self.key, result)
            self.shop.installed[self.key] = result
        return result

    def _new(self) -> InstallResult:
        try:
            environment = self.environment()
            try:
                return self._describe_environment(environment)
            except Unreadable:  # it was damaged: once more, from its wheels
                self._discard(environment)
            return self._describe_environment(self.environment())
        except StepFailed as failed:
            return InstallResult(failed=mark_system(failed.step))

    def _discard(self, environment: Environment) -> None:
        from harness.packages.environments import environments  # noqa: PLC0415 - start-up

        environments.discard(environment)
        self.shop.environments.pop(self.key, None)

    def _describe_environment(self, environment: Environment) -> InstallResult:
        described = site_packages.describe(environment.path, FAMILY)
        return InstallResult(
            key=environment.key,
            versions=environment.installed,
            modules=described.modules,
            speaking=described.asking,
            unheld=described.unmet,
            seconds=round(environment.seconds, 3),
            findings=environment.findings,
        )

    def environment(self) -> Environment:
        """Return the environment itself, from the pool or made now. Raises StepFailed."""
        with self.shop.once.turn(("environment", self.key)):
            if self.key not in self.shop.environments:
                self.shop.observer.step(self.cell, Phase.INSTALL)
                ensured = obtain(self._ensured, self.shop)
                # An earlier case may have poisoned what numba and Warp compiled (docs/threat-model.md).
                if self.shop.settings.verify:
                    bytecode.forget(code_folder(ensured))
                elif self.shop.settings.fresh:
                    bytecode.forget_compiled(code_folder(ensured))
                self.shop.environments[self.key] = ensured
        return self.shop.environments[self.key]

    def _ensured(self) -> Environment:
        from harness.packages.environments import environments  # noqa: PLC0415 - start-up
        from harness.packages.sources import overlays  # noqa: PLC0415 - start-up

        settings = self.shop.settings
        if settings.fetched:
            settings.fetched.supply(self.cell, self.lock, self.interpreter)
        lock = overlays.provide_wheels(self.lock, self.cell.question, offline=settings.offline)
        thorough = settings.verify or self.key in self.shop.doubted
        return environments.ensure(
            lock, self.interpreter, self.cell.question, offline=settings.offline, thorough=thorough
        )


def obtain(make: Callable[[], Environment], shop: Workshop) -> Environment:
    """Make an environment; with `verify` also check every file of it, and make it anew if need be.

    Raises StepFailed.
    """
    from harness.packages.environments import environments  # noqa: PLC0415 - start-up

    started = monotonic()
    try:
        environment = make()
        if shop.settings.verify and not environments.is_intact(environment, thorough=True):
            environments.discard(environment)
            environment = make()
    except StepFailed as failed:
        raise StepFailed(replace(failed.step, seconds=monotonic() - started)) from None
    return environment


def code_folder(environment: Environment) -> Path:
    """Return the folder of the byte code of an environment."""
    return cache_folder() / "pycache" / environment.path.name


def mark_system(step: Step) -> Step:
    """Return a failed build with a mark of the system that it failed on; a resolution depends on no system."""
    return replace(step, conditions=this_machine.conditions()) if step.phase is Phase.INSTALL else step


def is_outdated(step: Step) -> bool:
    """Return whether something was installed on this system since: a failed build is tried again."""
    return step.conditions not in {None, this_machine.conditions()}
