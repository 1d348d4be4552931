"""Feeds a target with seeded inputs, and holds it to its promises: a sentence, ten seconds, its own folder."""

from __future__ import annotations

import os
import random
import shutil
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from fuzzing.targets import Target

LONGEST, WAITING = 10.0, 60.0
"""Seconds of CPU that an input may take, and seconds that it may wait."""

TIMERS = {signal.ITIMER_PROF: signal.SIGPROF, signal.ITIMER_REAL: signal.SIGALRM}
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
CHANGES = {"os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate", "shutil.rmtree"}
FOREIGN = {"subprocess.Popen", "os.exec", "os.posix_spawn", "os.fork", "os.system", "socket.connect"}


@dataclass
class FuzzResult:
    """The results of a target's inputs: their number, exit codes, the slowest, and broken promises."""

    name: str
    count: int = 0
    slowest: float = 0.0
    codes: Counter[int] = field(default_factory=Counter)
    broken: list[str] = field(default_factory=list)


class HungError(BaseException):
    """An input took too long."""


class ForeignError(BaseException):
    """Something was done that no input may lead to."""


_watched: list[Path] = []
_hooked: list[bool] = []


def fuzz(target: Target, count: int, folder: Path, seed: int = 0) -> FuzzResult:
    """Feed a target with so many inputs, the same for the same seed; at most five broken promises are kept."""
    result = FuzzResult(name=target.name)
    for number in range(count):
        chance = random.Random(f"{target.name} {seed} {number}")
        with _workplace(folder):
            words = target.make(chance)
            began = time.process_time()
            try:
                with _watching(folder):
                    result.codes[target.run(words)] += 1
            except (Exception, HungError, ForeignError):
                trace = traceback.format_exc()[-3500:]
                result.broken.append(f"{target.name} {seed} {number}: {words!r:.500}\n{trace}")
                copy_folder = folder.parent / "broken" / f"{target.name}-{seed}-{number}"
                shutil.rmtree(copy_folder, ignore_errors=True)
                shutil.copytree(folder, copy_folder)
            result.slowest = max(result.slowest, time.process_time() - began)
        result.count += 1
        if len(result.broken) >= 5:
            break
    return result


@contextmanager
def _workplace(folder: Path) -> Iterator[None]:
    """Run a block in an empty working folder, with its own state and caches."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    before, variables = Path.cwd(), dict(os.environ)
    os.chdir(folder)
    os.environ |= {"HARNESS_STATE": str(folder / "state"), "HARNESS_CACHE": str(folder / "cache")}
    try:
        yield
    finally:
        os.chdir(before)
        os.environ.clear()
        os.environ.update(variables)


@contextmanager
def _watching(folder: Path) -> Iterator[None]:
    if not _hooked:
        sys.addaudithook(_audit)
        _hooked.append(True)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)}
    before = {number: signal.signal(number, _hung) for number in TIMERS.values()}
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    signal.setitimer(signal.ITIMER_REAL, WAITING)
    _watched.append(folder.resolve())
    try:
        yield
    finally:
        _watched.clear()
        for timer in TIMERS:
            signal.setitimer(timer, 0)
        for number, handler in (handlers | before).items():
            signal.signal(number, handler)


def _hung(number: int, frame: FrameType | None) -> None:
    msg = f"no end within {LONGEST:g} s of CPU, or {WAITING:g} s"
    raise HungError(msg)


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuse what no input may lead to: processes, connections, and writing anywhere else."""
    if not _watched:
        return
    if event in FOREIGN:
        msg = f"{event} {arguments!r:.300}"
        raise ForeignError(msg)
    writes = event == "open" and isinstance(arguments[2], int) and arguments[2] & WRITING
    if writes or event in CHANGES:
        path = arguments[0]
        if isinstance(path, str | bytes | os.PathLike) and not _allowed(Path(os.fsdecode(path))):
            msg = f"{event} {path!r}"
            raise ForeignError(msg)


def _allowed(path: Path) -> bool:
    place = path if path.is_absolute() else Path.cwd() / path
    normal = Path(os.path.normpath(place))
    return normal.is_relative_to(_watched[0]) or str(normal) == os.devnull or "__pycache__" in normal.parts
