"""Take one cell through its phases; do work that several cells need once."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import monotonic
from typing import TYPE_CHECKING

from msgspec import Struct

from harness.judging.exercised import unregistered_id
from harness.machine import debian_packages, interpreters, process, this_machine
from harness.machine.files.file_locks import claim, exclusive
from harness.machine.store import InstallResult, digest, question_key
from harness.matrix import overlay_recipes
from harness.model import (
    Case,
    CaseRecord,
    Cell,
    CellRecord,
    Interpreter,
    Lock,
    Outcome,
    Phase,
    Question,
    Step,
    replace,
)
from harness.model.errors import BadInput, CouldNotTell
from harness.packages import uv_failures
from harness.packages.environments import bytecode
from harness.packages.step_failed import StepFailed
from harness.probes import launch
from harness.probes.evidence import Host
from harness.probes.measure import Laboratory
from harness.probes.vault import Vault
from harness.running import case_run
from harness.running.scheduler import cell_faults, other_drawing
from harness.running.scheduler.lock_freshness import is_still_valid
from harness.running.scheduler.records import finish_record, not_reached, stopped_record, with_modules
from harness.running.scheduler.settings import Workshop
from harness.running.scheduler.shared_environment import Pool, code_folder, is_outdated, mark_system
from harness.running.scheduler.steps import Steps, carry_out, peek, pending
from harness.running.scheduler.user_supplied import BroughtSoftware, missing

if TYPE_CHECKING:
    from harness.packages.environments.environments import Environment
    from harness.packages.package_under_test import SubjectWheel
    from harness.running.scheduler import subject_in_cell


class Prepared(Struct, frozen=True, kw_only=True):
    """A cell that is resolved and installed. `cases` are still to be probed, in `context`; none where it is finished.

    `claims` are the keys of the runs to be made, `environment` is the key of where; `suite` comes after the cases.
    `site` is there where an environment was all that was wanted. `from_store` is whether the record is that of an
    earlier run. `around` makes the context of other settings.
    """

    record: CellRecord
    context: case_run.Context | None = None
    cases: tuple[Case, ...] = ()
    suite: subject_in_cell.Suite | None = None
    claims: tuple[str, ...] = ()
    environment: str | None = None
    site: launch.Site | None = None
    from_store: bool = False
    around: other_drawing.Around | None = None


class InstallFault(Exception):
    """An unforeseen error while the environment of a record was made: not the resolution's."""

    def __init__(self, record: CellRecord, error: Exception) -> None:
        super().__init__(record.cell.id)
        self.record, self.error = record, error


@dataclass
class Runner(Workshop):
    """A runner that takes cells through their phases; work that several of them need is done once.

    Any thread may call it. It knows nothing of controls.
    """

    luggage: BroughtSoftware = field(init=False)

    def __post_init__(self) -> None:
        self.luggage = BroughtSoftware(offline=self.settings.offline)

    def measure(self, cell: Cell) -> CellRecord:
        """Take one cell through its phases; keep its results, but not its record."""
        ready = self.prepare(cell)
        held = claim([self.store.claim_file(key) for key in ready.claims], wait=True)
        try:
            return self.probe(ready)
        finally:
            if held:
                held.release()

    def keep(self, record: CellRecord) -> None:
        """Store the record of a cell, unless it tells less of the same than the record that is there."""
        wrong = record.cell.asked and unregistered_id(record)  # a mistyped id says nothing of packages
        if not wrong and record.cell.id not in self.unchanged and not self._tells_less(record):
            self.store.save_cell(record)

    def find_record(self, cell: Cell) -> CellRecord | None:
        """Return the record of a cell of which everything is known; None where something has to be done."""
        try:
            ready = peek(self._prepared(cell))
            return ready.record if ready.from_store else finish_record(ready.record)
        except BadInput:
            raise
        except InstallFault as fault:
            if isinstance(fault.error, BadInput):
                raise fault.error from None
            return None
        except Exception:  # Unknown; anything else is met again, and said, where something is done about the cell
            return None

    def prepare(self, cell: Cell) -> Prepared:
        """Resolve and install: mostly waiting, for the network and the disk."""
        self.observer.started(cell)
        self.observer.step(cell, Phase.RESOLVE)
        try:
            return carry_out(self._prepared(cell))
        except InstallFault as fault:
            step = cell_faults.fault(self, cell, Phase.INSTALL, fault.error)
            return Prepared(record=stopped_record(fault.record, step))
        except Exception as error:
            step = cell_faults.fault(self, cell, Phase.RESOLVE, error)
            return Prepared(record=stopped_record(CellRecord(cell=cell, machine=this_machine.facts().id), step))

    def probe(self, ready: Prepared) -> CellRecord:
        """Run the missing probes of a prepared cell, mostly computing; return its record, still without controls."""
        record = ready.record
        if ready.context:
            try:
                record = replace(
                    record, cases=tuple(self._case(record.cell, ready.context, case) for case in ready.cases)
                )
                if ready.around:
                    record = other_drawing.retry_drawing(record, ready.cases, ready.around)
                record = replace(record, suite=ready.suite.measure(record.cases) if ready.suite else None)
            except StepFailed as failed:
                record = stopped_record(record, failed.step)
            except Exception as error:
                record = stopped_record(record, cell_faults.fault(self, record.cell, Phase.INSTALL, error))
        # Probes that our own stop ended look like failures: no record is made of them.
        if process.is_stopped():
            message = f"{record.cell.id}: interrupted"
            raise CouldNotTell(message)
        return record if ready.from_store else finish_record(record)

    def _case(self, cell: Cell, context: case_run.Context, case: Case) -> CaseRecord:
        try:
            return case_run.run_case(context, case)
        except StepFailed:
            raise
        except Exception as error:
            return case_run.inconclusive_record(case, cell_faults.fault(self, cell, Phase.IMPORT, error))

    # --- resolving -------------------------------------------------------------------------------------------------

    def lock_of(self, cell: Cell, interpreter: Interpreter) -> tuple[Lock | None, Step]:
        """Return the lock of a cell, or the step that failed; build its subject for that, if it has one."""
        full_cell, tested = carry_out(self._complete_question(cell, interpreter))
        return (None, tested) if isinstance(tested, Step) else carry_out(self.lock(full_cell.question, interpreter))

    def lock(self, question: Question, interpreter: Interpreter) -> Steps[tuple[Lock | None, Step]]:
        """Return the lock of a question and how it came: kept from before, or resolved now, once for all that ask."""
        key = question_key(question, interpreter)
        with self.once.turn(key):
            answer = self.resolved.get(key)
            if answer is None:
                answer = self._kept_lock(key, question)
                if answer is None:
                    answer = yield from pending(lambda: self._resolved_lock(key, question, interpreter))
                lock, step = answer
                self.resolved[key] = lock, replace(step, seconds=0.0, reused=True)  # for whoever asks next
        return answer

    def _kept_lock(self, key: str, question: Question) -> tuple[Lock | None, Step] | None:
        """Return the stored answer to a question if it is still valid.

        With `fresh` a lock stays valid as long as `lasts` finds no change; a failed resolution does not.
        """
        stored_answer = self.store.load_lock(key)
        if isinstance(stored_answer, Step):
            mended = uv_failures.may_be_mended(stored_answer) and not self.settings.offline
            holds = not (is_outdated(stored_answer) or mended or self.settings.again or self.settings.fresh)
            return (None, replace(stored_answer, reused=True)) if holds else None
        if stored_answer is None or (
            self.settings.fresh and not is_still_valid(stored_answer, question, self.store.locked_at(key))
        ):
            return None
        return stored_answer, Step(phase=Phase.RESOLVE, outcome=Outcome.PASSED, reused=True)

    def _resolved_lock(self, key: str, question: Question, interpreter: Interpreter) -> tuple[Lock | None, Step]:
        from harness.packages.sources import overlays  # noqa: PLC0415 - start-up

        with exclusive(self.store.claim_file(key)):
            stored_answer = self._kept_lock(key, question)  # another process may have answered while we waited
            if stored_answer:
                return stored_answer
            start = monotonic()
            folder = self.store.evidence(f"lock-{key[:16]}")
            answer = overlays.resolve(question, interpreter, folder, offline=self.settings.offline)
            if self.settings.offline:
                key = digest("offline", key)  # what the caches hold is no answer for a run with the network
            if isinstance(answer, Step):
                # Other outcomes are trouble of the network or this machine, and may be gone in the next run.
                if answer.outcome is Outcome.FAILED:
                    self.store.save_lock(key, mark_system(answer))
                return None, answer
            self.store.save_lock(key, answer)
        return answer, Step(phase=Phase.RESOLVE, outcome=Outcome.PASSED, seconds=round(monotonic() - start, 3))

    # --- the way of a cell -----------------------------------------------------------------------------------------

    def _prepared(self, cell: Cell) -> Steps[Prepared]:
        interpreter = yield from self._interpreter(cell)
        missing = interpreter if isinstance(interpreter, str) else _missing(cell)
        if isinstance(interpreter, str) or missing:
            record = CellRecord(cell=cell, machine=this_machine.facts().id)
            return Prepared(record=replace(record, unavailable=missing, cases=not_reached(cell)))
        brought = self.luggage.of(cell)
        full_cell, tested = yield from self._complete_question(cell, interpreter)
        if isinstance(tested, Step):
            record = CellRecord(cell=cell, machine=this_machine.facts().id, python=interpreter.version, brought=brought)
            return Prepared(record=stopped_record(record, tested))
        fetched = self.settings.fetched
        lock, step = fetched.answer(cell) if fetched else (yield from self.lock(full_cell.question, interpreter))
        # What takes looks at this machine comes after the first resolution, beside which they are made.
        record = CellRecord(
            cell=cell,
            machine=this_machine.facts().id,
            python=interpreter.version,
            brought=brought,
            subject=tested.tested if tested else None,
            resolve=step,
        )
        if lock is None:
            return Prepared(record=stopped_record(record, step))
        hashes = (one.artifact.sha256 for one in lock.pins)
        record = replace(
            record,
            repairs=overlay_recipes.select_by_hash(full_cell.question.overlay, hashes),
            lock=self.store.relative(self.store.lock_file(lock)),
            lock_sha256=lock.sha256,
            supplied=this_machine.choose_variables(cell.environment, cell.needs, lock.versions),
        )
        if self.settings.until is Phase.RESOLVE:
            return Prepared(record=record)
        try:
            return (yield from self._installed(record, Pool(self, full_cell, lock, interpreter), tested))
        except Exception as error:
            raise InstallFault(record, error) from error

    def _complete_question(
        self, cell: Cell, interpreter: Interpreter
    ) -> Steps[tuple[Cell, SubjectWheel | Step | None]]:
        """Return the cell with its full question, and its subject, if it has one, or the step why there is no wheel."""
        if cell.subject is None:
            return cell, None
        from harness.packages import package_under_test  # noqa: PLC0415 - start-up
        from harness.running.scheduler import subject_in_cell  # noqa: PLC0415 - start-up

        tested = yield from subject_in_cell.ready(self, cell, interpreter)
        if isinstance(tested, Step):
            return cell, tested
        question = package_under_test.complete_question(cell.question, cell.subject, tested, interpreter)
        return replace(cell, question=question), tested

    def _interpreter(self, cell: Cell) -> Steps[Interpreter | str]:
        """Return the Python of a cell, or why there is none."""
        if self.settings.fetched:
            return self.settings.fetched.interpreter(cell)
        interpreter = self.pythons.get(cell.python)
        if interpreter is None:
            interpreter = interpreters.obtain(cell.python, offline=True)
            if interpreter is None:  # it may be there to be downloaded
                interpreter = yield from pending(
                    lambda: interpreters.obtain(cell.python, offline=self.settings.offline)
                )
            if interpreter:
                self.pythons[cell.python] = interpreter
        return interpreter or interpreters.hint(cell.python)

    def _installed(self, record: CellRecord, pool: Pool, tested: SubjectWheel | None) -> Steps[Prepared]:
        """Install, unless every result is known already."""
        install = pool.load_install() or (yield from pending(pool.install))
        if install.failed:
            return Prepared(record=stopped_record(record, install.failed))
        if tested:
            from harness.running.scheduler import subject_in_cell  # noqa: PLC0415 - start-up

            install = subject_in_cell.add_subject(install, tested)
        record = replace(
            record,
            key=install.key,
            installed=install.versions,
            install=Step(
                phase=Phase.INSTALL,
                outcome=Outcome.PASSED,
                seconds=install.seconds,
                reused=pool.known,
                findings=(*install.findings, *debian_packages.note_unchecked(record.cell.system)),
            ),
        )
        try:
            if self.settings.until is Phase.INSTALL:  # its environment may be gone: that is looked at in turn
                site = yield from pending(lambda: self._site(record, *self._place(pool, tested)))
                return Prepared(record=record, site=site)
            return (yield from self._known_cases(record, pool, install, tested))
        except StepFailed as failed:
            return Prepared(record=stopped_record(record, failed.step))

    def _known_cases(
        self, record: CellRecord, pool: Pool, install: InstallResult, tested: SubjectWheel | None
    ) -> Steps[Prepared]:
        context = self._context(record, pool, tested)
        cases = tuple(with_modules(case, install) for case in record.cell.cases)
        mark = digest(case_run.mark(context, cases, record.lock_sha256), sorted(record.supplied.items()))
        # The mark covers no suite: a cell with a subject is judged from its runs each time.
        record = record if tested else replace(record, mark=mark)
        last_record = self._load_record(record)
        if last_record:
            return Prepared(record=last_record, from_store=True)
        stored = [case_run.stored_case(context, case) for case in cases]
        case_records = tuple(one for one in stored if one)
        suite = yield from self._suite(record, pool, tested)
        if len(case_records) == len(stored):
            whole, ended = suite.find_result(case_records) if suite else (True, None)
            complete = replace(record, cases=case_records, suite=ended)
            if whole and not other_drawing.due(complete):
                return Prepared(record=complete)
        # Made in this stage: otherwise a probe would make it while it holds a slot.
        yield from pending(lambda: self._make_ready(record, pool, tested))
        claims = {case_run.claim(context, case) for case, one in zip(cases, stored, strict=True) if one is None}
        return Prepared(
            record=record,
            context=context,
            cases=cases,
            suite=suite,
            claims=tuple(sorted(claims | ({suite.key} if suite and suite.key else set()))),
            environment=record.key,
            around=lambda other: self._context(other, pool, tested),
        )

    def _load_record(self, record: CellRecord) -> CellRecord | None:
        """Return the last record of the cell, if all that it depends on is the same."""
        if self.settings.fresh or self.settings.again or record.mark is None:
            return None
        last_record = self.store.load_cell(record.machine, record.cell)
        if last_record is None or last_record.mark != record.mark:
            return None
        if last_record.cell == record.cell:
            self.unchanged.add(record.cell.id)
        versions = (
            record.installed if record.installed == last_record.installed else last_record.installed
        )  # one of many cells
        return replace(last_record, cell=record.cell, installed=versions, reused=True)

    def _suite(
        self, record: CellRecord, pool: Pool, tested: SubjectWheel | None
    ) -> Steps[subject_in_cell.Suite | None]:
        """Return the subject's own suite, resolved and installed; None if the cell has none or stops before it."""
        cell = record.cell
        wanted = tested and cell.subject and cell.subject.suite and self.settings.until is Phase.SUITE
        if not wanted or tested is None:
            return None
        from harness.running.scheduler import subject_in_cell  # noqa: PLC0415 - start-up

        suite = subject_in_cell.Suite(
            shop=self,
            resolve=self.lock,
            cell=pool.cell,
            lock=pool.lock,
            interpreter=pool.interpreter,
            tested=tested,
            site=lambda environment, below: self._site(record, environment, below),
            identity=self._identity(record),
        )
        yield from suite.prepare()
        return suite

    def _place(self, pool: Pool, tested: SubjectWheel | None) -> tuple[Environment, Environment | None]:
        """Return the environment that a cell is probed in, and the environment below it, if it is a thin layer."""
        if tested is None:
            return pool.environment(), None
        from harness.running.scheduler import subject_in_cell  # noqa: PLC0415 - start-up

        return subject_in_cell.on_top(self, pool, tested), pool.environment()

    def _make_ready(self, record: CellRecord, pool: Pool, tested: SubjectWheel | None) -> None:
        """Make the environment that a cell is probed in, and compile what a new one is known to need."""
        environment, below = self._place(pool, tested)
        if not environment.reused:
            bytecode.compile_ahead(self._site(record, environment, below).byte_code)

    def _variables(self, record: CellRecord) -> dict[str, str]:
        given = {**this_machine.base_environment(record.cell.needs), **record.supplied, **record.cell.environment}
        # A matrix unsets a variable by an empty value; `empty` names those that are set to the empty string.
        chosen = {name: value for name, value in given.items() if value != ""}
        return chosen | dict.fromkeys(record.cell.empty, "")

    def _identity(self, record: CellRecord) -> tuple[object, ...]:
        """Return the parts of a cell that the keys of its results hold besides its environment."""
        variables, files = sorted(self._variables(record).items()), sorted(record.cell.files.items())
        cell, brought = record.cell, [(one.name, one.mark) for one in record.brought]
        around = (cell.python_path, brought, [(one.variable, one.python_path) for one in cell.bring])
        return variables, files, process.sandbox_mode(), this_machine.facts().id, *filter(None, around)

    def _site(self, record: CellRecord, environment: Environment, below: Environment | None) -> launch.Site:
        copies, folders = self.luggage.unpacked(record.cell)
        return launch.Site(
            folder=environment.path,
            python=environment.python,
            pycache=code_folder(environment),
            variables=self._variables(record),
            files={name: content.encode() for name, content in record.cell.files.items()},
            below=below.path if below else None,
            python_path=folders,
            brought=copies,
            stands=lambda: self._stand(*filter(None, (environment, below))),
        )

    def _stand(self, *used: Environment) -> bool:
        """Tell whether environments are as they were installed; if one is not, later requests get a new one."""
        from harness.packages.environments import environments  # noqa: PLC0415 - start-up

        if all(environments.is_intact(one) for one in used):
            return True
        for environment in used:  # one that lies on top leads on to the other
            for key in [key for key, made in self.environments.items() if made is environment]:
                with self.once.turn(("environment", key)):
                    environments.discard(environment, used=True)
                    bytecode.forget(code_folder(environment))
                    # The next one is made with every file held against its hash (`thorough`).
                    self.doubted.add(key)
                    self.environments.pop(key, None)
        return False

    def _context(self, record: CellRecord, pool: Pool, tested: SubjectWheel | None) -> case_run.Context:
        cell = record.cell
        on_top = (tested.tested.content,) if tested else ()
        return case_run.Context(
            laboratory=Laboratory(
                vault=Vault(self.store.folder),
                site=lambda: self._site(record, *self._place(pool, tested)),
                host=Host(
                    python=record.python or "",
                    undrawable=this_machine.explain_undrawable(
                        {**record.supplied, **cell.environment}, pool.lock.versions
                    ),
                    conditions=this_machine.conditions(),
                ),
                places=self.places,
            ),
            identity=(record.key, *self._identity(record), *on_top),
            until=self.settings.until,
            fresh=self.settings.fresh,
            again=self.settings.again,
            verify=self.settings.verify,
            measured=self.measured,
            notify=lambda text: self.observer.step(cell, text),
        )

    def _tells_less(self, record: CellRecord) -> bool:
        """Return whether a run that was to stop early has nothing to say against what is known of the same lock."""
        if self.settings.until not in {Phase.RESOLVE, Phase.INSTALL} or not record.lock:
            return False
        last_record = self.store.load_cell(record.machine, record.cell)
        failed = record.install is not None and record.install.outcome is not Outcome.PASSED
        return (
            not failed
            and last_record is not None
            and last_record.cell == record.cell
            and last_record.lock_sha256 == record.lock_sha256
        )


def _missing(cell: Cell) -> str | None:
    """Return a sentence on the needs of the cell that this machine lacks, and their remedies; None if it lacks none."""
    lacking = "; ".join(filter(None, (*missing(cell), this_machine.describe_missing(cell.needs))))
    return lacking or debian_packages.describe_missing(cell.system)
