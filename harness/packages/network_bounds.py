"""Bound the time of network answers: a server that drips bytes, or never ends, keeps nobody waiting."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING, TypeVar

from harness.machine import process
from harness.model.errors import CouldNotTell

if TYPE_CHECKING:
    import requests

T = TypeVar("T")

MOST_PAGE = 128 << 20
"""Bytes of an index page, unpacked; the longest ones have about 20 MB."""

CHUNK = 1 << 16
LOOK_SECONDS = 0.2


class Overdue(CouldNotTell):
    """An answer did not end in its time, or the command that waits for it is being ended."""


class Watch:
    """Tell a waiting thread that bytes came, and the one that reads that nobody waits any more."""

    def __init__(self) -> None:
        self.received = 0
        self.over = Event()

    def chunks(self, response: requests.Response, most: float = float("inf")) -> Iterator[bytes]:
        """Yield the content piece by piece. Raises ValueError past `most` bytes, Overdue where nobody waits."""
        for chunk in response.iter_content(CHUNK):
            self.received += len(chunk)
            if self.over.is_set():
                raise Overdue
            if self.received > most:
                message = f"more than {most} bytes"
                raise ValueError(message)
            yield chunk


def in_time(work: Callable[[Watch], T], seconds: float, *, slowest: float = float("inf")) -> T:
    """Run network work in a thread that is abandoned if it takes too long. Raises Overdue.

    It has `seconds`, and one more for each `slowest` bytes received.
    """
    watch, future, began = Watch(), Future[T](), monotonic()

    def run() -> None:
        try:
            future.set_result(work(watch))
        except BaseException as error:
            # An error that only ended the thread would keep the caller waiting until the time is over.
            future.set_exception(error)

    # A daemon: an abandoned thread must not hold up the end of the command.
    Thread(target=run, daemon=True).start()
    try:
        while not process.is_stopped() and monotonic() < began + seconds + watch.received / slowest:
            try:
                return future.result(LOOK_SECONDS)
            except TimeoutError:
                # The work may raise a TimeoutError itself: then it is done, and there is nothing to wait for.
                if future.done():
                    return future.result()
    finally:
        watch.over.set()
    raise Overdue("interrupted" if process.is_stopped() else "its answer does not end; try again later")
