"""Find the first cases of a project: list the environments of the installed package in a cell, and try some of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from packaging.version import Version

from harness.ci.drafts import Case as Drafted
from harness.ci.drafts.candidates import Candidate, chosen_order, needs_arguments, ordered_extras, read
from harness.judging.assess import Assessed, assess
from harness.judging.counted_phases import reason
from harness.machine import interpreters
from harness.machine.store import Store
from harness.matrix import plan
from harness.model import Case, Cell, Outcome, Phase, Subject, replace
from harness.model.errors import HarnessError
from harness.model.report_types import format_count
from harness.model.vocabulary import HOST
from harness.packages import package_under_test
from harness.probes import launch
from harness.running.scheduler import Observer, Runner, Settings

LISTING = "list.environments"
LIMIT = 300.0
"""Seconds for the imports of a package and its submodules."""

ENOUGH, BATCH, MOST_TRIED, MOST_EXTRAS, MOST_PYTHONS, MOST_SKIPPED = 3, 3, 12, 5, 3, 3
STEPS = 25
"""Steps of a trial: it only sorts out what does not run at all, and a step of some simulators takes a second."""

LONGEST = 200
"""Characters of a module's name that a cell wrote."""


@dataclass(frozen=True, kw_only=True, slots=True)
class FirstCases:
    """The cases of a first matrix, the extras that they need, and sentences on what was and was not found out.

    `importable` is whether the package could be installed and imported, `registered` how many environments it has.
    """

    cases: tuple[Drafted, ...] = ()
    extras: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    importable: bool = False
    registered: int = 0


@dataclass(frozen=True, kw_only=True, slots=True)
class _Listed:
    """The answer of a cell: its environments, the imports that failed, or why nothing could be asked."""

    candidates: tuple[Candidate, ...] = ()
    failed: tuple[tuple[str, str], ...] = ()
    trouble: str | None = None
    imported: bool = False


@dataclass
class Scout:
    """A search for cases in cells of one project; `extras` are those that its users may install, in order."""

    opened: Store
    observer: Observer
    folder: Path
    instant: str
    offline: bool = False
    extras: tuple[str, ...] = ()
    tried: dict[str, str] = field(default_factory=dict)

    def look(self, pythons: Sequence[str]) -> FirstCases:
        """Find cases on the first of these Pythons that the project can be installed on; then with its extras."""
        trouble = None
        for python in [one for one in pythons if interpreters.find(one)][:MOST_PYTHONS] or [HOST]:
            listed = self._list_environments(python, ())
            if listed.imported or (listed.trouble is None):
                return self._with_extras(python, listed)
            trouble = trouble or f"On Python {python}: {listed.trouble}"
        return FirstCases(notes=(trouble,) if trouble else ())

    def _with_extras(self, python: str, listed: _Listed) -> FirstCases:
        """Return the environments that run without extras; if none does, those that run with one of the extras."""
        cases = self._running(python, (), listed.candidates)
        if cases:
            return self._build_first_cases(listed, cases, ())
        lacking = [*(each.lacking for each in listed.candidates if each.lacking), *(why for _, why in listed.failed)]
        places = [each.place for each in listed.candidates] + [module for module, _ in listed.failed]
        # Where nothing failed and nothing was missing, no extra can help; each one costs an install.
        for extra in ordered_extras(self.extras, places)[:MOST_EXTRAS] if lacking or self.tried else ():
            more = self._list_environments(python, (extra,))
            # An extra such as `butterfly` brings what the part of that name needs, so that part alone is tried.
            near = [each for each in more.candidates if extra in each.place.split(".")]
            cases = self._running(python, (extra,), near or more.candidates)
            if cases:
                return self._build_first_cases(more, cases, (extra,))
        return self._nothing_runs(listed)

    def _build_first_cases(self, listed: _Listed, cases: Sequence[Drafted], extras: tuple[str, ...]) -> FirstCases:
        notes = [
            f"The package has {format_count(len(listed.candidates), 'environment')}; each can be a case of its own."
        ]
        if extras:
            notes.append(f"No environment runs without an extra; these run with {', '.join(extras)}.")
        notes += [f"{env} was tried and left out: {why}" for env, why in list(self.tried.items())[:ENOUGH]]
        return FirstCases(
            cases=tuple(cases), extras=extras, notes=tuple(notes), importable=True, registered=len(listed.candidates)
        )

    def _nothing_runs(self, listed: _Listed) -> FirstCases:
        """Keep one case that fails for a reason users meet. An environment that only lacks an argument is no case."""
        notes = [*([listed.trouble] if listed.trouble else [])]
        real = {env: why for env, why in self.tried.items() if not needs_arguments(why)}
        asking = [env for env in self.tried if env not in real]
        if asking:
            notes.append(f"{', '.join(asking[:ENOUGH])}: needs arguments (`kwargs` of a case): {self.tried[asking[0]]}")
        if not listed.candidates and not listed.trouble:
            notes.append("It registers no environments of its own: its tests are what can be run.")
        by_env = {each.env: each for each in listed.candidates}
        cases = [_drafted(by_env[env], f"Tried, and it does not run: {why}") for env, why in list(real.items())[:1]]
        notes += [
            f"None of its environments runs as it is installed; {env}: {why}" for env, why in list(real.items())[:1]
        ]
        left = [each for each in listed.candidates if each.lacking]
        if left and not real:
            notes.append(f"{left[0].env} and {len(left) - 1} more cannot be made as installed: {left[0].lacking}")
        return FirstCases(
            cases=tuple(cases), notes=tuple(notes), importable=listed.imported, registered=len(listed.candidates)
        )

    # --- in a cell -------------------------------------------------------------------------------------------------

    def _cell(self, python: str, extras: tuple[str, ...]) -> Cell:
        subject = package_under_test.record_state(Subject(source=str(self.folder), extras=extras), offline=self.offline)
        options = plan.TrialOptions(requirements=(), python=python, subject=subject, as_of=self.instant)
        return plan.single(options).cells[0]

    def _runner(self, until: Phase) -> Runner:
        return Runner(self.opened, Settings(until=until, offline=self.offline), self.observer)

    def _list_environments(self, python: str, extras: tuple[str, ...]) -> _Listed:
        """List the registered environments. Repeat it without a submodule whose import ends the process."""
        runner = self._runner(Phase.INSTALL)
        try:
            ready = runner.prepare(self._cell(python, extras))
        except HarnessError as error:
            return _Listed(trouble=str(error))
        if ready.site is None:
            return _Listed(trouble=_trouble(assess(ready.record)))
        modules = next(
            known.modules for known in runner.subjects.values() if isinstance(known, package_under_test.SubjectWheel)
        )
        skip: list[str] = []
        while True:
            answer = self._list_in_process(ready.site, modules, skip)
            if isinstance(answer, _Listed):
                return answer
            # Without the package itself nothing can be listed; a module that comes again would loop for ever.
            if answer in {"", *modules, *skip} or len(skip) == MOST_SKIPPED:
                return _Listed(trouble=f"importing {answer or ', '.join(modules)} ends the process", imported=True)
            skip.append(answer)

    def _list_in_process(self, site: launch.Site, modules: tuple[str, ...], skip: Sequence[str]) -> _Listed | str:
        """List the environments in one process. If it ends too early, return the module that it was importing."""
        case = Case(id="list", env="*", api="", imports=modules, kwargs={"skip": list(skip)})
        with launch.probe(site, case, {LISTING: LIMIT}) as run:
            reply = next((check for check in run.reply.checks if check.check == LISTING), None)
            if reply and reply.raised:
                why = f"importing {', '.join(modules)} fails: {reply.raised.type}: {reply.raised.message}"
                return _Listed(trouble=why.splitlines()[0], imported=True)
            if reply and reply.outcome is Outcome.PASSED:
                candidates, failed = read(reply.facts)  # of any shape, as a cell wrote them
                return _Listed(candidates=candidates, failed=failed, imported=True)
            return run.text("importing")[:LONGEST]

    def _running(self, python: str, extras: tuple[str, ...], candidates: Sequence[Candidate]) -> list[Drafted]:
        """Try candidates until enough of them run: one environment at least, for some steps."""
        order = [each for each in chosen_order(candidates) if not each.lacking][:MOST_TRIED]
        cases: list[Drafted] = []
        while order and len(cases) < ENOUGH:
            batch, order = order[:BATCH], order[BATCH:]
            for candidate, why in self._outcomes(python, extras, batch):
                if why is None:
                    # It may have failed before, when the extra was not installed.
                    self.tried.pop(candidate.env, None)
                    cases.append(_drafted(candidate))
                else:
                    self.tried[candidate.env] = why
        return cases[:ENOUGH]

    def _outcomes(
        self, python: str, extras: tuple[str, ...], batch: Sequence[Candidate]
    ) -> Iterator[tuple[Candidate, str | None]]:
        cases = tuple(replace(_case(candidate), steps=STEPS) for candidate in batch)
        cell = replace(self._cell(python, extras), cases=cases, id=f"init/{self.folder.name}")
        runner = self._runner(Phase.SINGLE)  # the phase that decides; later ones take minutes where a step is slow
        record = runner.probe(runner.prepare(cell))  # whose fault a failure is matters to the first run, not here
        assessed = assess(record)
        for candidate, case in zip(batch, cases, strict=True):
            yield candidate, _failure(assessed, case.id)


def _case(candidate: Candidate) -> Case:
    """Return the case that a matrix with this candidate has."""
    options = plan.TrialOptions(requirements=(), python=HOST, envs=(candidate.env,), api=candidate.api)
    (case,) = plan.cases_for(replace(options, subject=Subject(source="."), imports=candidate.imports))
    return case


def _drafted(candidate: Candidate, note: str | None = None) -> Drafted:
    return Drafted(env=candidate.env, api=candidate.api, imports=candidate.imports, note=note)


def _failure(assessed: Assessed, case: str) -> str | None:
    """Return the reason why a case did not pass `single`, None if it did."""
    assessed_case = next((tried for tried in assessed.cases if tried.record.case == case), None)
    phases = {phase.phase: phase for phase in assessed_case.phases} if assessed_case else {}
    single = phases.get(Phase.SINGLE)
    if single is not None and single.outcome is Outcome.PASSED:
        return None
    failed = (phase for phase in phases.values() if phase.outcome not in {Outcome.PASSED, Outcome.SKIPPED})
    return next((line for phase in failed if (line := reason(phase))), None) or _trouble(assessed)


def _trouble(assessed: Assessed) -> str:
    """Return the reason why a cell did not reach its cases."""
    return f"{assessed.verdict.replace('_', ' ')}: {assessed.decisive or 'no line of the output explains it'}"


def by_preference(pythons: Iterable[str], baseline: str | None) -> tuple[str, ...]:
    """Return Pythons with the baseline first, then newer ones, then older ones, each the nearest first."""
    named = [python for python in pythons if python != HOST]
    if not named:
        return (HOST,)
    start = Version(baseline or named[(len(named) - 1) // 2])
    newer = sorted((one for one in named if Version(one) >= start), key=Version)
    older = sorted((one for one in named if Version(one) < start), key=Version, reverse=True)
    return (*newer, *older)
