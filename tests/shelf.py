"""The few real wheels that the fakes and their suites need: downloaded once, then kept."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from harness.machine import interpreters
from harness.model import Lock, Question
from harness.model.errors import CouldNotTell
from harness.packages import index, resolver

REAL, AS_OF = ("gymnasium==1.2.3", "pytest==9.0.2"), "2026-01-01T00:00:00Z"
"""Packages of the real index, with all that they need themselves."""


class NoIndex(Exception):
    """The index does not answer, or does not have them."""


def download_wheels(storage: Path, cache: Path) -> Iterable[Path]:
    """Return the wheels, from a folder where they are kept; `cache` is the resolver's."""
    host = interpreters.find("host")
    assert host
    folder = storage / f"{'-'.join(REAL)}-{AS_OF[:10]}-{host.minor}"
    if not folder.exists():
        making = storage / "making"
        before = os.environ.get("HARNESS_CACHE")
        os.environ["HARNESS_CACHE"] = str(cache)
        try:
            question = Question(requirements=REAL, only_binary=(":all:",), snapshot=AS_OF)
            lock = resolver.resolve(question, host, cache.with_name("log"))
            if not isinstance(lock, Lock):
                raise NoIndex(str(lock))
            for pin in lock.pins:
                index.fetch(pin.artifact, making)
        except CouldNotTell as trouble:
            raise NoIndex(str(trouble)) from trouble
        finally:
            os.environ.pop("HARNESS_CACHE")
            os.environ.update({"HARNESS_CACHE": before} if before else {})
        making.rename(folder)
    return sorted(folder.glob("*/*.whl"))
