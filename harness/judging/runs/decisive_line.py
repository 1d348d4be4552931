"""Say in one line why a check failed. `standalone/failures/lines.py` finds such a line in any text."""

from __future__ import annotations

import signal
from collections.abc import Iterable

from harness.model import CheckReply, Observation, Raised, WorkerRecord
from harness.standalone.failures.lines import (
    CAUSE,
    CONTEXT,
    MASKS,
    describe_death,
    innermost_frame,
    original,
    shorten_line,
    strip_ansi,
)


def decisive_of_check(reply: CheckReply) -> tuple[str | None, str | None]:
    """Return the reason why a check failed, as the cell reported it, and the line that hid it: (decisive, masked by).

    The first exception, signal or exit code of a worker comes before what its parent saw of it.
    """
    seen = _reply_line(reply)
    worker = _worker_line(reply.workers, echo=not reply.raised or _is_mask(reply.raised))
    if worker is None or worker == seen:
        return seen, None
    return worker, seen


def observed_of_check(reply: CheckReply) -> Observation | None:
    """Return the cell's observation behind the decisive line of a check; None if that line is not ours."""
    decisive, mask = decisive_of_check(reply)
    if mask is None:
        return reply.observed
    first = next((worker for worker in reply.workers if worker.raised and not _is_mask(worker.raised)), None)
    return first.observed if first and first.raised and exception_line(first.raised) == decisive else None


def _reply_line(reply: CheckReply) -> str | None:
    if reply.raised:
        return exception_line(reply.raised)
    return shorten_line(reply.reason) if reply.reason else None


def exception_line(raised: Raised) -> str:
    """Return an exception as Python prints it, or the original that it was raised from."""
    own = shorten_line(f"{raised.type}: {raised.message}" if raised.message.strip() else raised.type)
    chained = CAUSE in raised.traceback or CONTEXT in raised.traceback
    first = original(strip_ansi(raised.traceback).splitlines()) if chained else None
    return shorten_line(first) if first else own


def _is_mask(raised: Raised) -> bool:
    return raised.type.rpartition(".")[2] in MASKS


def _worker_line(workers: Iterable[WorkerRecord], *, echo: bool) -> str | None:
    """Return the line of the first worker that failed by itself; None if there is none.

    A worker that only lost its parent (a mask, SIGTERM) did not. An exit code counts only if the parent saw no more
    than an `echo` of a death: after an exception of the parent's own, workers are ended in many ways.
    """
    records = tuple(workers)
    raised = [worker.raised for worker in records if worker.raised and not _is_mask(worker.raised)]
    if raised:
        return exception_line(raised[0])
    # After an exception of its own a parent may kill what it started: that death is no reason then.
    by_parent = {-signal.SIGTERM} if echo else {-signal.SIGTERM, -signal.SIGKILL}
    dead = [worker for worker in records if worker.exit_code and worker.exit_code not in by_parent]
    for worker in sorted(dead, key=lambda worker: (worker.exit_code or 0) > 0):
        code = worker.exit_code or 0
        if code < 0:
            return f"worker {describe_death(None, -code, worker.stacks or '')}"
        if echo and not worker.raised:
            return f"worker {describe_death(code, None, '')}"
    frames = [innermost_frame(worker.stacks or "") for worker in records if worker.exit_code is None]
    hung = [frame for frame in frames if frame and "multiprocessing/" not in frame]  # the others wait for the parent
    return f"worker hangs in {hung[0]}" if hung and echo else None
