"""Takes one cell through its phases; what several cells need is done once."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from time import monotonic

from harness import cellrun, environments, interpreters, launch, machine, process, uv, uvcli
from harness.environments import Environment
from harness.errors import CouldNotTell
from harness.model import (
    Case,
    CaseRecord,
    Cell,
    CellRecord,
    Interpreter,
    Lock,
    Outcome,
    Phase,
    PhaseRecord,
    Question,
    Step,
)
from harness.scheduler.settings import Observer, Settings
from harness.store import Installed, Store, cache_folder, digest, now, question_key
from harness.vocabulary import Api


class _Once:
    """Does the work of a key once, however many threads ask for it."""

    def __init__(self) -> None:
        self._locks: dict[Hashable, threading.Lock] = {}
        self._guard = threading.Lock()

    @contextmanager
    def turn(self, key: Hashable) -> Iterator[None]:
        """Hold the key; the first holder does the work, the next find it done."""
        with self._guard:
            lock = self._locks.setdefault(key, threading.Lock())
        with lock:
            yield


@dataclass
class Runner:
    """Takes cells through their phases; what several of them need is done once."""

    store: Store
    settings: Settings
    observer: Observer
    once: _Once = field(default_factory=_Once)
    resolved: dict[str, tuple[Lock | None, Step]] = field(default_factory=dict)

    def cell(self, cell: Cell) -> CellRecord:
        """Take one cell through its phases and keep its record."""
        self.observer.started(cell)
        record = self.measure(cell)
        self.store.save_cell(record)
        self.observer.done(record)
        return record

    def measure(self, cell: Cell) -> CellRecord:
        """Take one cell through its phases; its results are kept, its record is not."""
        record = self._run(cell)
        if process.stopped():
            message = f"{cell.id}: interrupted"
            raise CouldNotTell(message)
        measured = max((phase.measured for phase in _phases(record) if phase.measured), default=now())
        return replace(record, measured=measured, seconds=_seconds(record), reused=_reused(record))

    def _run(self, cell: Cell) -> CellRecord:
        record = CellRecord(cell=cell, machine=machine.facts().id, supplied=machine.supplied(cell.environment))
        interpreter = interpreters.obtain(cell.python, offline=self.settings.offline)
        missing = machine.missing_for(cell.needs) if interpreter else interpreters.hint(cell.python)
        if interpreter is None or missing:
            return replace(record, unavailable=missing, cases=_not_reached(cell))
        record = replace(record, python=interpreter.version)
        self.observer.step(cell, Phase.RESOLVE)
        lock, step = self.lock(cell.question, interpreter)
        record = replace(record, resolve=step)
        if lock is None:
            return _stopped(record, step)
        file = self.store.relative(self.store.lock_file(lock))
        record = replace(record, lock=file, lock_sha256=lock.sha256)
        return record if self.settings.until is Phase.RESOLVE else self._probe(record, lock, interpreter)

    def lock(self, question: Question, interpreter: Interpreter) -> tuple[Lock | None, Step]:
        """The lock of a question and how it came: kept from before, or resolved now, once for all that ask it."""
        key = question_key(question, interpreter)
        with self.once.turn(key):
            if key not in self.resolved:
                self.resolved[key] = self._lock(key, question, interpreter)
        return self.resolved[key]

    def _lock(self, key: str, question: Question, interpreter: Interpreter) -> tuple[Lock | None, Step]:
        kept = None if self.settings.fresh else self.store.load_lock(key)
        kept = None if isinstance(kept, Step) and _outdated(kept) else kept
        if self.settings.offline and not kept:
            key = digest("offline", key)  # what the caches hold is no answer for a run with the network
        start = monotonic()
        answer = kept or uv.resolve(
            question, interpreter, self.store.evidence(f"lock-{key[:16]}"), offline=self.settings.offline
        )
        if isinstance(answer, Step):
            if not kept and answer.outcome is Outcome.FAILED:
                self.store.save_lock(key, _conditioned(answer))
            return None, replace(answer, reused=bool(kept))
        if not kept:
            self.store.save_lock(key, answer)
        seconds = 0.0 if kept else monotonic() - start
        return answer, Step(phase=Phase.RESOLVE, outcome=Outcome.PASSED, seconds=round(seconds, 3), reused=bool(kept))

    def _probe(self, record: CellRecord, lock: Lock, interpreter: Interpreter) -> CellRecord:
        """Install, unless every result is known already, and run the cases."""
        pool = _Pool(self, record.cell, lock, interpreter)
        known = pool.installed()
        if known.failed:
            return _stopped(record, known.failed)
        record = replace(
            record,
            key=known.key,
            installed=known.versions,
            install=Step(
                phase=Phase.INSTALL,
                outcome=Outcome.PASSED,
                seconds=known.seconds,
                reused=pool.known,
                findings=known.findings,
            ),
        )
        try:
            if self.settings.until is Phase.INSTALL:
                pool.environment()
                return record
            context = self._context(record, pool)
            cases = tuple(cellrun.run_case(context, _with_modules(case, known)) for case in record.cell.cases)
        except _NoEnvironment as failure:
            return _stopped(record, failure.step)
        return replace(record, cases=cases)

    def _context(self, record: CellRecord, pool: _Pool) -> cellrun.Context:
        cell = record.cell
        given = {**record.supplied, **cell.environment}
        needs = (*cell.needs, *machine.drawing_needs(given))
        variables = {name: value for name, value in {**machine.base_environment(needs), **given}.items() if value != ""}
        files = {name: content.encode() for name, content in cell.files.items()}
        facts = machine.facts()

        def site() -> launch.Site:
            environment = pool.environment()
            return launch.Site(
                folder=environment.path,
                python=environment.python,
                pycache=cache_folder() / "pycache" / environment.key,
                variables=variables,
                files=files,
            )

        return cellrun.Context(
            store=self.store,
            python=record.python or "",
            site=site,
            identity=(
                record.key,
                sorted(variables.items()),
                sorted(cell.files.items()),
                process.sandbox_mode(),
                facts.id,
            ),
            undrawable=machine.undrawable(given),
            conditions=machine.conditions(),
            places=uvcli.places(),
            until=self.settings.until,
            fresh=self.settings.fresh,
            verify=self.settings.verify,
            notify=lambda text: self.observer.step(cell, text),
        )


class _NoEnvironment(Exception):
    """The environment of a lock that was installed before cannot be made again now."""

    def __init__(self, step: Step) -> None:
        super().__init__(step.decisive)
        self.step = step


class _Pool:
    """The environment of one cell, made only when a probe has to run."""

    def __init__(self, runner: Runner, cell: Cell, lock: Lock, interpreter: Interpreter) -> None:
        self.runner, self.cell, self.lock, self.interpreter = runner, cell, lock, interpreter
        question = cell.question
        self.key = digest(
            "install", lock.sha256, interpreter.identity, question.build_constraints, question.build_variables
        )
        self.known = False
        self.made: Environment | None = None

    def installed(self) -> Installed:
        """What the install came to, now or before; an environment is made if it is not known."""
        kept = None if self.runner.settings.fresh else self.runner.store.load_installed(self.key)
        if kept and not (kept.failed and _outdated(kept.failed)):
            self.known = True
            return replace(kept, failed=replace(kept.failed, reused=True) if kept.failed else None)
        try:
            made = self.environment()
        except _NoEnvironment as failure:
            if failure.step.outcome is Outcome.FAILED:
                self.runner.store.save_installed(self.key, Installed(failed=_conditioned(failure.step)))
            return Installed(failed=failure.step)
        known = Installed(
            key=made.key,
            versions=made.installed,
            modules=environments.modules(made.path),
            speaking={api: environments.requiring(made.path, api) for api in Api},
            seconds=round(made.seconds, 3),
            findings=made.findings,
        )
        self.runner.store.save_installed(self.key, known)
        return known

    def environment(self) -> Environment:
        """The environment itself, from the pool or made now."""
        if self.made is None:
            self.runner.observer.step(self.cell, Phase.INSTALL)
            with self.runner.once.turn(("environment", self.key)):
                made = self._ensured()
                if self.runner.settings.verify and isinstance(made, Environment) and environments.verify(made):
                    environments.discard(made)
                    made = self._ensured()
            if isinstance(made, Step):
                raise _NoEnvironment(made)
            self.made = made
        return self.made

    def _ensured(self) -> Environment | Step:
        offline = self.runner.settings.offline
        return environments.ensure(self.lock, self.interpreter, self.cell.question, offline=offline)


def _stopped(record: CellRecord, step: Step) -> CellRecord:
    """A record whose resolve or install did not succeed: the cases are not reached."""
    cases = _not_reached(record.cell)
    if step.outcome is Outcome.UNAVAILABLE:
        return replace(record, unavailable=step.decisive, cases=cases)
    if step.phase is Phase.INSTALL:
        resolve = record.resolve if record.lock else Step(phase=Phase.RESOLVE, outcome=Outcome.PASSED)
        return replace(record, resolve=resolve, install=step, cases=cases)
    return replace(record, resolve=step, cases=cases)


def _conditioned(step: Step) -> Step:
    """A failed build with the mark of the system that it failed on; a resolution depends on no system."""
    return replace(step, conditions=machine.conditions()) if step.phase is Phase.INSTALL else step


def _outdated(step: Step) -> bool:
    """Whether something was installed on this system since: a failed build is tried again."""
    return step.conditions not in {None, machine.conditions()}


def _not_reached(cell: Cell) -> tuple[CaseRecord, ...]:
    return tuple(cellrun.not_reached(case) for case in cell.cases)


def _with_modules(case: Case, installed: Installed) -> Case:
    """The case with the modules of its packages; one that installs none is left to fail by its name."""
    speaking = [name for name in case.packages if not case.api or name in installed.speaking.get(case.api, ())]
    found = (installed.modules.get(name) or (name.replace("-", "_"),) for name in speaking)
    modules = tuple(module for modules in found for module in modules)
    if case.env is None:
        return replace(case, imports=(*case.imports, *modules))
    return replace(case, providers=modules)


def _phases(record: CellRecord) -> Iterator[PhaseRecord]:
    return (phase for case in record.cases for phase in case.phases if phase.measured)


def _seconds(record: CellRecord) -> float:
    steps = sum(step.seconds for step in (record.resolve, record.install) if step)
    return round(steps + sum(phase.seconds for phase in _phases(record)), 3)


def _reused(record: CellRecord) -> bool:
    """Whether nothing of it was measured in this run."""
    steps = [step.reused for step in (record.resolve, record.install) if step]
    return bool(steps) and all(steps) and all(phase.reused for phase in _phases(record))
