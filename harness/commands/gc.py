"""`simmatrix gc`: remove waste and old files from cache and state; all but probe runs can be made again."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from time import time

import msgspec
from rich.filesize import decimal

from harness.machine import store
from harness.machine.console import tell
from harness.model.report_types import format_count
from harness.packages import uv_command
from harness.running import cleanup
from harness.running.cleanup import DAY, Item, Kind, disk_usage
from harness.standalone.output import print_json

HELP = (
    "Delete unused entries of the cache and of the state folder. With --older-than or --max-size, also delete the least"
    " recently used ones. Nothing in use is deleted, and everything deleted can be rebuilt; only --evidence deletes"
    " results that no combination refers to."
)

UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}
SIZE = re.compile(r"(\d+(?:\.\d+)?) ?([kmgt]i?)?b?", re.IGNORECASE)
EXAMPLE = 30.0
"""Days of the limit that is suggested where none is given."""


class Removed(msgspec.Struct, frozen=True, kw_only=True):
    """The removed items of one kind: how many, and their share of the disk in bytes."""

    kind: Kind
    number: int
    bytes: int


class Collected(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `gc --json`. Sizes are bytes on disk of cache and state, each file counted once."""

    schema: int = 1
    dry_run: bool
    removed: tuple[Removed, ...]
    freed: int
    in_use: int
    size_before: int
    size_after: int


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `gc`."""
    parser.add_argument(
        "--older-than", metavar="DAYS", type=_days, help="also delete entries that were not used for DAYS days"
    )
    parser.add_argument(
        "--max-size",
        metavar="SIZE",
        type=_size,
        help="delete the least recently used entries until cache and state fit: 20GB, 500MB",
    )
    parser.add_argument(
        "--evidence",
        action="store_true",
        help="also delete logs of runs that no combination refers to; they cannot be rebuilt",
    )
    parser.add_argument("--dry-run", action="store_true", help="list what would be deleted, and delete nothing")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Remove the chosen items, and print how many and how much was freed."""
    places = cleanup.Places(cache=store.cache_folder(), state=store.state_path(), evidence=args.evidence)
    before = time() - args.older_than * DAY if args.older_than is not None else None
    size_before = disk_usage(places.cache, places.state)
    basket = _Basket(dry=args.dry_run)
    # uv prunes first: what that frees need not be taken from environments to reach --max-size.
    size = _pruned(places, basket, size_before)
    basket.take(cleanup.select_items(cleanup.find(places), size, before=before, most=args.max_size))
    if Kind.RECORD in basket.numbers and not args.dry_run:  # what only they named is waste now
        basket.take([item for item in cleanup.find(places) if item.waste])
    size_after = size_before - basket.size if args.dry_run else disk_usage(places.cache, places.state)
    summary = Collected(
        dry_run=args.dry_run,
        removed=tuple(
            Removed(kind=kind, number=count, bytes=round(basket.sizes[kind])) for kind, count in basket.numbers.items()
        ),
        freed=size_before - size_after,
        in_use=basket.in_use,
        size_before=size_before,
        size_after=size_after,
    )
    if args.json:
        print_json(msgspec.json.encode(summary))
    else:
        _print(summary)
    if args.older_than is None and args.max_size is None:
        _suggest(places)
    elif args.max_size is not None and summary.size_after > args.max_size:
        tell(f"{decimal(summary.size_after)} are left: in use, too recent, or impossible to rebuild")
    return 0


@dataclass(slots=True)
class _Basket:
    """A collector of items: it removes them, and counts those removed and those in use."""

    dry: bool
    numbers: dict[Kind, int] = field(default_factory=dict)
    sizes: dict[Kind, float] = field(default_factory=dict)
    in_use: int = 0

    @property
    def size(self) -> int:
        """Return the bytes of all that was taken."""
        return round(sum(self.sizes.values()))

    def take(self, items: Iterable[Item]) -> None:
        """Remove items, except those in use. A dry run only counts them."""
        for item in items:
            if self.dry or cleanup.remove(item):
                self.count(item.kind, item.size)
            else:
                self.in_use += 1

    def count(self, kind: Kind, size: float) -> None:
        """Count one thing that was removed."""
        self.numbers[kind] = self.numbers.get(kind, 0) + 1
        self.sizes[kind] = self.sizes.get(kind, 0) + size


def _pruned(places: cleanup.Places, basket: _Basket, size: int) -> int:
    """Let uv prune its cache. Return the bytes left in cache and state; files shared with environments free nothing."""
    folder = places.cache / "uv"
    if basket.dry or not folder.is_dir():
        return size
    # The time of this folder says when uv's cache was last of use, and pruning must not renew it.
    used = folder.stat().st_mtime
    uv_command.tidy("prune")
    os.utime(folder, (used, used))
    left = disk_usage(places.cache, places.state)
    if left < size:
        basket.count(Kind.UV, size - left)
    return left


# --- what is said ----------------------------------------------------------------------------------------------


def _print(summary: Collected) -> None:
    for removal in summary.removed:
        print(f"{removal.kind:<34} {removal.number:>6}  {decimal(removal.bytes):>9}")
    verb = "would be freed" if summary.dry_run else "freed"
    used = f"; {format_count(summary.in_use, 'thing')} in use were kept" if summary.in_use else ""
    print(f"{decimal(summary.freed)} {verb}, {decimal(summary.size_after)} left in cache and state{used}")


def _suggest(places: cleanup.Places) -> None:
    """Print how many bytes a limit would free."""
    items = cleanup.find(places)
    old = cleanup.select_items(items, 0, before=time() - EXAMPLE * DAY, most=None)
    could, would = (round(sum(item.size for item in some)) for some in (items, old))
    if could:
        tell(
            f"`--older-than {EXAMPLE:g}` would free {decimal(would)}, `--older-than 0` {decimal(could)};"
            " `--max-size 20GB` removes what was used least recently"
        )


def _days(text: str) -> float:
    try:
        days = float(text)
    except ValueError:
        days = math.nan
    if not 0 <= days < math.inf:
        message = f"{text!r} is not a number of days; write one such as 30"
        raise argparse.ArgumentTypeError(message)
    return days


def _size(text: str) -> int:
    parts = SIZE.fullmatch(text.strip())
    if not parts:
        message = f"{text!r} is not a size; write one such as 20GB or 500MB"
        raise argparse.ArgumentTypeError(message)
    return int(float(parts[1]) * UNITS[(parts[2] or "").lower()])
