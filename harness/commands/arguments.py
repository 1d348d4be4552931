"""Declare the options that several verbs share."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from harness.machine.capacity import AUTO, default_jobs
from harness.running import shards

FAIL_ON = ("unexpected", "stale", "inconclusive", "unavailable", "not_run")
DEFAULT_FAIL_ON = ("unexpected", "stale")


def matrix(parser: argparse.ArgumentParser) -> None:
    """Add the name of one matrix."""
    parser.add_argument("matrix", metavar="MATRIX", help="a matrix file, or the name of a built-in matrix")


def jobs(parser: argparse.ArgumentParser) -> None:
    """Add `--jobs`."""
    meaning = "measure N combinations at a time; `auto`: as many as cores and memory allow (default: one per core)"
    parser.add_argument("-j", "--jobs", type=_jobs, default=default_jobs(), metavar="N", help=meaning)


def _jobs(text: str) -> int:
    """Return the value of `--jobs`: a number of at least 1, or AUTO for `auto`."""
    if text == "auto":
        return AUTO
    if not text.isdigit() or int(text) < 1:
        message = f"{text!r} is neither a number of at least 1 nor `auto`"
        raise argparse.ArgumentTypeError(message)
    return int(text)


def shard(parser: argparse.ArgumentParser) -> None:
    """Add `--shard`."""
    parser.add_argument(
        "--shard", type=_shard, metavar="I/N", help="measure part I of N only; all parts take about equally long"
    )


def _shard(text: str) -> shards.Shard:
    """Return the shard that the value of `--shard` (I/N) names."""
    try:
        return shards.Shard.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def durations(parser: argparse.ArgumentParser) -> None:
    """Add `--durations`."""
    meaning = "balance the shards by the times in this report.json (default: the committed report); may be repeated"
    parser.add_argument("--durations", type=Path, metavar="FILE", action="append", default=[], help=meaning)


def offline(parser: argparse.ArgumentParser) -> None:
    """Add `--offline`."""
    parser.add_argument("--offline", action="store_true", help="use the caches only, never the network")


def verify(parser: argparse.ArgumentParser) -> None:
    """Add `--verify`."""
    meaning = "run each check in a process of its own, repeat failures, compare installed files with their hashes"
    parser.add_argument("--verify", action="store_true", help=meaning)


def fail_on(parser: argparse.ArgumentParser, default: Sequence[str] = DEFAULT_FAIL_ON) -> None:
    """Add `--fail-on`."""
    kinds = ", ".join(FAIL_ON)
    meaning = f"exit with status 1 for results that are {kinds}; separate with commas (default: {','.join(default)})"
    parser.add_argument("--fail-on", type=fail_kinds, default=default, metavar="KINDS", help=meaning)


def fail_kinds(text: str) -> tuple[str, ...]:
    """Parse the value of `--fail-on`. Raises ArgumentTypeError for an unknown kind."""
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    unknown = [name for name in names if name not in FAIL_ON]
    if unknown:
        message = f"unknown kind {unknown[0]!r}; choose from {', '.join(FAIL_ON)}"
        raise argparse.ArgumentTypeError(message)
    return names
