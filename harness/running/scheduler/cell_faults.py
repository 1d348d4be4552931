"""Catch exceptions that nobody foresaw: the cell becomes inconclusive, and the run goes on.

Ctrl-C, SIGTERM and bad input on the command line end it as ever. So does an exception outside of cells, which is a bug
(exit code 4).
"""

from __future__ import annotations

import sys
import traceback
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import harness
from harness.machine import process
from harness.machine.store import digest, write_atomic
from harness.model import Cell, Outcome, Phase, Step
from harness.model.errors import BadInput, CouldNotTell, UnusableRequirement, in_the_way
from harness.standalone.failures.lines import normalise, shorten_line

if TYPE_CHECKING:
    from collections.abc import Mapping

    from harness.running.scheduler.settings import Workshop

FRAMES = 60
"""Innermost frames that are kept of a traceback: a recursion has a thousand."""


def fault(shop: Workshop, cell: Cell, phase: Phase, error: Exception) -> Step:
    """Return the step at which a cell met this error, as a step that says nothing about packages.

    The traceback is kept beside the evidence, and the user is told where. Raises the error again where it is to end the
    run: bad input on the command line, a reader of our output who left, or a run that is stopped already. An unusable
    requirement of one combination of a matrix is the failure of that combination.
    """
    of_matrix = isinstance(error, UnusableRequirement) and not cell.asked
    if isinstance(error, BrokenPipeError) or (isinstance(error, BadInput) and not of_matrix) or process.is_stopped():
        raise error
    if of_matrix:
        return Step(phase=phase, outcome=Outcome.FAILED, decisive=shorten_line(str(error)))
    if isinstance(error, CouldNotTell):
        return Step(phase=phase, outcome=Outcome.INFRA, decisive=shorten_line(str(error)))
    places = {**shop.places, str(Path(harness.__file__).parent): "$HARNESS", sys.base_prefix: "$PYTHON"}
    summary = f"{type(error).__name__}: {error}"[:1000]
    log = _keep_traceback(shop, cell, error, places)
    machine = in_the_way(error)
    if machine:
        reason = f"{machine}; fix that and run it again"
    else:
        reason = f"a fault of simmatrix, not of the packages: {summary}"
        where = f"; please report it with {log}" if log else "; please report it"
        shop.observer.say(f"{cell.id}: {shorten_line(reason)}{where}")
    return Step(
        phase=phase,
        outcome=Outcome.INFRA,
        decisive=shorten_line(normalise(reason, places)),
        log=log,
    )


def _keep_traceback(shop: Workshop, cell: Cell, error: Exception, places: Mapping[str, str]) -> str | None:
    """Keep the traceback; return where, below the state folder, or None where even that fails."""
    # The fault may be a full disk, on which this fails, too.
    with suppress(Exception):
        text = "".join(traceback.format_exception(error, limit=-FRAMES))
        file = shop.store.evidence(f"fault-{digest(cell.id)[:16]}") / "traceback.txt"
        write_atomic(file, normalise(text, places).encode(errors="replace"))
        return shop.store.relative(file)
    return None
