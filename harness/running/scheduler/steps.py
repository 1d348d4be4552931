"""Describe work as steps, each known or still to be done: one description answers what is known, and does the rest.

A way of working is a generator that yields a `Pending` for each step whose result is not stored, is sent the result
of that step, and returns the result of the whole. `Once` lets work be done once that several threads ask for.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Pending(Generic[T]):
    """A step whose result is not known; `do` does it and returns the result."""

    do: Callable[[], T]


Steps = Generator[Pending[Any], Any, T]
"""Steps towards a result of type T."""


class Unknown(Exception):
    """Something has to be done before the result is known."""


def pending(do: Callable[[], T]) -> Steps[T]:
    """Ask for a step to be done, and return its result: `result = yield from pending(do)`."""
    result: T = yield Pending(do)
    return result


def peek(steps: Steps[T]) -> T:
    """Return the result of steps that are all known. Raises Unknown at the first that is not, and does nothing."""
    try:
        next(steps)
    except StopIteration as end:
        result: T = end.value
        return result
    # Closed at once: the steps may hold turns (`Once.turn`) that other threads wait for.
    steps.close()
    raise Unknown


def carry_out(steps: Steps[T]) -> T:
    """Do every pending step in turn and return the result; what a step raises is raised where the steps ask for it."""
    try:
        step = next(steps)
        while True:
            try:
                result = step.do()
            except BaseException as error:
                # An interrupt is thrown in, too, so that the steps let go of the turns that they hold.
                step = steps.throw(error)
            else:
                step = steps.send(result)
    except StopIteration as end:
        final: T = end.value
        return final


class Once:
    """A guard that lets the work of a key be done once, however many threads ask for it."""

    def __init__(self) -> None:
        self._locks: dict[Hashable, threading.Lock] = {}
        self._guard = threading.Lock()

    @contextmanager
    def turn(self, key: Hashable) -> Iterator[None]:
        """Hold the key; the first holder does the work, the next holders find it done."""
        with self._guard:
            lock = self._locks.setdefault(key, threading.Lock())
        with lock:
            yield
