"""Many questions at once, asked for nothing but whether they resolve."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from harness import interpreters, process, scheduler
from harness.errors import CouldNotTell
from harness.model import Cell, CellRecord, Outcome, Phase, Question
from harness.plan import Ask
from harness.store import Store


class _Unobserved:
    """Tells nobody: whoever asks tells how many questions there are."""

    def started(self, cell: Cell) -> None:
        """Say nothing."""

    def step(self, cell: Cell, text: str) -> None:
        """Say nothing."""

    def done(self, record: CellRecord) -> None:
        """Say nothing."""

    def say(self, text: str) -> None:
        """Say nothing."""


def asking(store: Store, settings: scheduler.Settings) -> Ask:
    """A function that resolves (Python, question) each, several at a time, and keeps the locks for the run to come.

    Its answers say why there is no lock, None where there is one, or where this machine cannot tell (no such Python),
    or where a build failed: those are for the run to measure. A trouble of the network is CouldNotTell.
    """
    runner = scheduler.Runner(store, settings, _Unobserved())

    def reason(python: str, question: Question) -> str | None:
        interpreter = interpreters.obtain(python, offline=settings.offline)
        if interpreter is None:
            return None
        _, step = runner.lock(question, interpreter)
        if step.outcome is Outcome.INFRA:
            message = f"whether {', '.join(question.requirements)} resolve on Python {python}: {step.decisive}"
            raise CouldNotTell(message)
        failed = step.outcome is Outcome.FAILED and step.phase is Phase.RESOLVE
        return step.decisive if failed else None

    def ask(questions: Sequence[tuple[str, Question]]) -> list[str | None]:
        pool = ThreadPoolExecutor(max_workers=settings.jobs or scheduler.default_jobs(), thread_name_prefix="resolve")
        try:
            return list(pool.map(reason, *zip(*questions, strict=True))) if questions else []
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            process.stop()
            raise
        finally:
            pool.shutdown()

    return ask
