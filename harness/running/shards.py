"""Split cells into shards of about equal time, the same way wherever that is computed.

Seconds come from a committed report only, never from what this machine has measured.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from heapq import heapify, heapreplace
from math import fsum
from typing import Self

import msgspec
from msgspec import Struct

from harness.model import Cell
from harness.model.report_types import Document

ALONE = 1.0
"""Seconds of a cell where none was ever recorded: then only their number counts."""

MOST = 10_000
"""Shards of a run."""


class Shard(Struct, frozen=True, kw_only=True):
    """One of `count` shards; `number` is counted from 1."""

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the shard that `I/N` names. Raises ValueError with a sentence."""
        match = re.fullmatch(r"(\d+)/(\d+)", text)
        if match is None:
            message = f"{text!r} is not a shard; write I/N, such as 2/4 for the second of four"
            raise ValueError(message)
        # The length is looked at before int(), which Python refuses for thousands of digits.
        if max(map(len, match.groups())) > len(str(MOST)) or int(match[2]) > MOST:
            message = f"{text[:40]!r}: at most {MOST:,} shards are possible"
            raise ValueError(message)
        number, count = map(int, match.groups())
        if not 1 <= number <= count:
            message = f"{text!r}: there is no shard {number} of {count}; they are counted from 1"
            raise ValueError(message)
        return cls(number=number, count=count)

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"


def recorded_seconds(document: Document) -> dict[str, float]:
    """Return the seconds of each cell that was run, by its id; the most of a cell measured on several machines."""
    seconds: dict[str, float] = {}
    for cell in document.cells:
        if cell.seconds > 0:
            seconds[cell.id] = max(cell.seconds, seconds.get(cell.id, 0.0))
    return seconds


def split(cells: Sequence[Cell], count: int, seconds: Mapping[str, float]) -> tuple[tuple[Cell, ...], ...]:
    """Split cells into `count` shards, each in the order of the cells; some may be empty.

    Cells that ask the same of the same Python stay together, as they share a lock and an environment, unless that is
    more than a shard's fair part. Longest first, each to the shard with the least. A cell without recorded seconds
    counts as the median. The order of the cells has no part in it: matrices may be named in any.
    """
    from statistics import median  # noqa: PLC0415 - start-up

    measured_seconds = [seconds[cell.id] for cell in cells if cell.id in seconds]
    usual = median(measured_seconds) if measured_seconds else ALONE
    cost = [seconds.get(cell.id, usual) for cell in cells]
    # Unlike a plain sum of floats, fsum does not depend on the order of the cells.
    fair = fsum(cost) / count
    groups = [part for group in _groups(cells) for part in _parts(group, cost, fair)]
    groups.sort(key=lambda group: (-sum(cost[place] for place in group), cells[group[0]].id))
    shards: list[list[int]] = [[] for _ in range(count)]
    loads = [(0.0, number) for number in range(count)]
    heapify(loads)
    for group in groups:
        load, number = loads[0]
        shards[number] += group
        heapreplace(loads, (load + sum(cost[place] for place in group), number))
    return tuple(tuple(cells[place] for place in sorted(shard)) for shard in shards)


def _groups(cells: Sequence[Cell]) -> Iterable[list[int]]:
    """Return the places of cells, grouped by the same question and Python."""
    # By value, since each machine has its own objects; once for each object, since many cells share one.
    marks: dict[int, bytes] = {}
    groups: dict[tuple[bytes, str], list[int]] = {}
    for place in sorted(range(len(cells)), key=lambda place: cells[place].id):
        cell = cells[place]
        question = cell.question
        if id(question) not in marks:
            marks[id(question)] = msgspec.json.encode(question, order="deterministic")
        groups.setdefault((marks[id(question)], cell.python), []).append(place)
    return groups.values()


def _parts(group: list[int], cost: Sequence[float], fair: float) -> Iterable[list[int]]:
    """Yield the group, or pieces of it of at most a fair part each (or of one cell)."""
    part: list[int] = []
    load = 0.0
    for place in group:
        # The margin is for rounding: a sum that equals the fair part may come out a little larger.
        if part and load + cost[place] > fair * (1 + 1e-9):
            yield part
            part, load = [], 0.0
        part.append(place)
        load += cost[place]
    yield part
