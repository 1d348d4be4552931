"""Test a package in a cell: make it ready once for each Python, put it on top, run its suite beside."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from harness import model
from harness.judging.runs import suite as judging
from harness.machine import this_machine
from harness.machine.store import InstallResult, digest
from harness.model import (
    CaseRecord,
    Cell,
    Finding,
    Interpreter,
    Level,
    Lock,
    Outcome,
    Phase,
    PhaseRecord,
    Question,
    Step,
    replace,
)
from harness.model.vocabulary import SELF, parsed_requirement, required_name
from harness.packages import package_under_test, uv_command
from harness.packages.environments import environments
from harness.packages.environments.environments import Environment
from harness.packages.package_under_test import SubjectWheel
from harness.packages.step_failed import StepFailed
from harness.probes import launch
from harness.probes.evidence import Host, Request
from harness.probes.vault import Vault
from harness.running import own_suites
from harness.running.scheduler.settings import Workshop
from harness.running.scheduler.shared_environment import Pool, is_outdated, mark_system, obtain
from harness.running.scheduler.steps import Steps, pending


def ready(shop: Workshop, cell: Cell, interpreter: Interpreter) -> Steps[SubjectWheel | Step]:
    """Return the wheel of the cell's subject, or the step that failed; made once in a run for each Python."""
    assert cell.subject
    question = cell.question
    inputs = (
        question.build_constraints,
        question.build_variables,
        question.only_binary,
        question.index,
        question.snapshot,
    )
    key = digest("subject", cell.subject.source, cell.subject.state, interpreter.identity, *inputs)
    with shop.once.turn(("subject", key)):
        if key not in shop.subjects:
            shop.subjects[key] = yield from _ready(shop, cell, interpreter, key)
    return shop.subjects[key]


def _ready(shop: Workshop, cell: Cell, interpreter: Interpreter, key: str) -> Steps[SubjectWheel | Step]:
    """Return a wheel that was built before, a failure that still holds, or the result of a build now."""
    assert cell.subject
    settings = shop.settings
    try:
        wheel = package_under_test.find_wheel(cell.subject, interpreter, cell.question)
    except StepFailed as failed:
        return failed.step
    if wheel:
        return wheel
    before = None if settings.fresh or settings.again else shop.store.load_installed(key)
    if before and before.failed and not is_outdated(before.failed):
        return replace(before.failed, reused=True)
    return (yield from pending(lambda: _build(shop, cell, interpreter, key)))


def _build(shop: Workshop, cell: Cell, interpreter: Interpreter, key: str) -> SubjectWheel | Step:
    """Build the wheel of the subject now; keep a failure."""
    assert cell.subject
    shop.observer.step(cell, "build")
    try:
        return package_under_test.ensure_wheel(cell.subject, interpreter, cell.question, offline=shop.settings.offline)
    except StepFailed as failed:
        if failed.step.outcome is Outcome.FAILED:
            shop.store.save_installed(key, InstallResult(failed=mark_system(failed.step)))
        return failed.step


def add_subject(install: InstallResult, tested: SubjectWheel) -> InstallResult:
    """Return the install with the subject on top of it; the subject may register any environment."""
    name = tested.tested.name
    return replace(
        install,
        versions=dict(sorted({**install.versions, name: tested.tested.version}.items())),
        modules={**install.modules, name: tested.modules, SELF: tested.modules},
        speaking={api: (*names, SELF) for api, names in install.speaking.items()},
        findings=(*install.findings, *_refusals(install, tested)),
    )


def _refusals(install: InstallResult, tested: SubjectWheel) -> Iterator[Finding]:
    """Yield a warning for each package that requires another version of the subject, which is installed anyway."""
    name, version = tested.tested.name, tested.tested.version
    for asker, line in install.unheld:
        need = parsed_requirement(line)
        if required_name(line) == name and not need.specifier.contains(version, prereleases=True):
            text = f"{asker} requires {line}, and this is {name} {version}: pip would complain"
            yield Finding(check="install.subject", level=Level.WARNING, text=text)


def on_top(shop: Workshop, pool: Pool, tested: SubjectWheel) -> Environment:
    """Return the environment of a cell with the subject on top. Raises StepFailed."""
    base = pool.environment()
    # By content, not by hash: builds are not the same to the byte twice (`environments`).
    key = digest("on top", base.key, tested.tested.content)
    with shop.once.turn(("environment", key)):
        if key not in shop.environments:
            environment = obtain(lambda: environments.ensure_layer(base, tested.wheel, pool.interpreter), shop)
            shop.environments[key] = environment
    return shop.environments[key]


# --- the suite -------------------------------------------------------------------------------------------------


@dataclass
class Suite:
    """The suite of one cell: its known result, and the way to measure it.

    `cell` has the question that was resolved for it, `lock` is its lock. `resolve` returns the lock of a question, or
    why there is none; `site` makes the place of a run from an environment and the environment below it. `identity` is
    the part of a result's key that describes the cell besides the environment.
    """

    shop: Workshop
    cell: Cell
    lock: Lock
    interpreter: Interpreter
    tested: SubjectWheel
    resolve: Callable[[Question, Interpreter], Steps[tuple[Lock | None, Step]]]
    site: Callable[[Environment, Environment], launch.Site]
    identity: tuple[object, ...]
    failed: PhaseRecord | None = field(default=None, init=False)
    pool: Pool | None = field(default=None, init=False)
    key: str | None = field(default=None, init=False)

    def prepare(self) -> Steps[None]:
        """Resolve and install its needs."""
        assert self.cell.subject
        cell_question, subject = self.cell.question, self.cell.subject
        question = own_suites.question(cell_question, self.lock, subject, self.tested, self.interpreter)
        lock, step = yield from self.resolve(question, self.interpreter)
        if lock is None:
            reason = f"the tests' packages cannot be installed with the cell's: {step.decisive}"
            self.failed = own_suites.not_run(reason, step)
            return
        moved = own_suites.describe_version_changes(self.lock, lock)
        if moved:
            self.failed = own_suites.not_run(moved, Step(phase=Phase.RESOLVE, outcome=Outcome.FAILED, decisive=moved))
            return
        self.pool = Pool(self.shop, replace(self.cell, question=question), lock, self.interpreter)
        install = self.pool.load_install() or (yield from pending(self.pool.install))
        if install.failed:
            decisive = f"the environment of the tests cannot be made: {install.failed.decisive}"
            self.failed = own_suites.not_run(decisive, install.failed)
            return
        # The tests come from a copy of the source, so that its state counts besides the wheel.
        tests = (subject.suite, subject.state, launch.file_hash(own_suites.DOOR))
        self.key = digest("suite", install.key, self.tested.tested.content, tests, self.identity)

    def find_result(self, cases: tuple[CaseRecord, ...]) -> tuple[bool, PhaseRecord | None]:
        """Return whether the suite's result after these cases is known, and the result; None if it is not reached."""
        if not _imported(cases):
            return True, None
        if self.failed or self.key is None:
            return self.failed is not None, self.failed
        fold = self._fold_runs()
        return (False, None) if self._todo(fold) else (True, judging.phase(fold, reused=True))

    def _fold_runs(self) -> judging.Folded:
        """Fold the stored runs that may be reused, and the runs of this process whatever their results."""
        assert self.key
        settings, vault = self.shop.settings, Vault(self.shop.store.folder)
        mine = self.shop.measured.get(self.key, ())
        before = () if settings.fresh else [name for name in vault.runs(self.key) if name not in mine]
        folded = judging.fold(vault.readings(before))
        folded = folded.reusable(this_machine.conditions(), failed_too=not settings.again)
        return judging.fold(vault.readings(mine), folded)

    def _todo(self, fold: judging.Folded) -> Request | None:
        assert self.cell.subject
        return judging.todo(self.cell.subject.suite or model.Suite(), fold, verify=self.shop.settings.verify)

    def measure(self, cases: tuple[CaseRecord, ...]) -> PhaseRecord | None:
        """Return the suite's result, stored or measured now; None if it is not reached. Raises StepFailed."""
        complete, result = self.find_result(cases)
        if complete or self.pool is None or self.key is None:
            return result
        assert self.cell.subject
        base = self.pool.environment()
        environment = on_top(self.shop, self.pool, self.tested)
        vault, fold = Vault(self.shop.store.folder), self._fold_runs()
        bench = own_suites.Bench(
            subject=self.cell.subject,
            package=self.tested,
            site=self.site(environment, base),
            vault=vault,
            host=Host(conditions=this_machine.conditions()),
            places=uv_command.places(),
        )
        while request := self._todo(fold):
            self.shop.observer.step(self.cell, Phase.SUITE)
            name = bench.measure(request, self.key)
            self.shop.measured[self.key] = (*self.shop.measured.get(self.key, ()), name)
            fold = judging.add_run(fold, vault.reading(name))
        return judging.phase(fold, reused=False)


def _imported(cases: tuple[CaseRecord, ...]) -> bool:
    """Return whether an import passed, without which tests would only say the same again."""
    ended = {phase.outcome for case in cases for phase in case.phases if phase.phase is Phase.IMPORT}
    return Outcome.PASSED in ended
