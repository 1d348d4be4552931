"""Declare faults, and find all declared ones."""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from ._desk import Desk

SECTIONS = (
    "kills and signals",
    "disks and damaged files",
    "hostile probes",
    "wheels and builds",
    "bad input",
    "what is printed",
    "several at once",
    "whose fault",
)
"""In the order of the table."""


class Unavailable(Exception):
    """This machine lacks what a fault needs."""


class FaultResult(NamedTuple):
    """The result of a fault in one sentence, and whether the promise held."""

    what: str
    held: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class Fault:
    """One declared fault; `documented` names the heading of the threat model for what no mechanism can hold."""

    row: str
    section: str
    done: str
    promise: str
    limit: float
    documented: str
    module: str
    name: str
    do: Callable[[Desk], FaultResult]


_declared: list[Fault] = []


def fault(
    row: str, *, section: str, done: str, promise: str, limit: float = 120, documented: str = ""
) -> Callable[[Callable[[Desk], FaultResult]], Callable[[Desk], FaultResult]]:
    """Declare a fault; the function does it and returns what came."""
    if section not in SECTIONS:
        msg = f"{section!r} is none of {', '.join(SECTIONS)}"
        raise ValueError(msg)

    def declare(do: Callable[[Desk], FaultResult]) -> Callable[[Desk], FaultResult]:
        module = do.__module__.rpartition(".")[2]
        texts = {"section": section, "done": done, "promise": promise, "documented": documented}
        _declared.append(Fault(row=row, limit=limit, module=module, name=do.__name__, do=do, **texts))
        return do

    return declare


def load_faults() -> list[Fault]:
    """Return every fault of every module of this folder, in the order of the table."""
    for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
        if module.name[0] != "_":
            importlib.import_module(f"{__package__}.{module.name}")
    return sorted(_declared, key=lambda each: (SECTIONS.index(each.section), natural(each.row)))


def natural(row: str) -> list[tuple[int, str]]:
    """Order rows as people do: 9 before 30a before 30b before 100, words last."""
    parts = re.findall(r"\d+|\D+", row)
    return [(int(part), "") if part.isdigit() else (10**9, part) for part in parts]
