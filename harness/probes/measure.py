"""Run one probe and keep its evidence. Nothing of it is judged, and no file that is kept names this machine."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from msgspec import Struct

from harness.machine import process
from harness.machine.store import now
from harness.model import Outcome, replace
from harness.model.hostile_data import Unreadable
from harness.model.vocabulary import DRAW, STEP
from harness.packages.environments import bytecode
from harness.probes import bare_start, launch, program, thumbnails
from harness.probes.evidence import (
    BANK,
    GIVEN,
    MOST_ARRAYS,
    OUTPUTS,
    PICTURE,
    PIXELS,
    PLAYED,
    REPLY,
    Host,
    ProbeRun,
    Request,
    RunEnd,
)
from harness.probes.vault import MOST_FILE, Vault, keep_files
from harness.standalone.failures.lines import normalise

MOST_EVIDENCE, MOST_FRAMES = 64 << 20, 16
"""Bytes of text, and frames, that are kept of one run."""

FINE = frozenset({Outcome.PASSED, Outcome.SKIPPED})


class Laboratory(Struct, frozen=True, kw_only=True):
    """All that the probes of one cell share: where they run, and what is noted beside each run.

    `site` makes the environment when one really has to run. `host` is what is known of the host before a run, `places`
    maps folders of this machine to the names that evidence gives them.
    """

    vault: Vault
    site: Callable[[], launch.Site]
    host: Host
    places: Mapping[str, str]

    def measure(self, request: Request, key: str) -> str:
        """Run a request, keep its evidence as an answer to a key, and return the name of the run."""
        assert request.case
        site = self.site()
        if request.recompiled:
            bytecode.forget(site.pycache)
        bank = self._bank(request)
        with launch.probe(site, request.case, request.limits, request.followers, bank) as ran:
            clean = _Cleaner({**self.places, **ran.places})
            texts = dict(_texts(ran, clean))
            texts |= {name: content for name, content in _pictures(ran) if name not in texts}
            texts |= _arrays(ran)
            if bank is not None:
                texts[GIVEN] = bank
            end = end_of(ran.completed, clean.line, overran=ran.overran, full=ran.full, lost=ran.lost)
            host = self._host(site, ran, clean)
        run = ProbeRun(
            request=request,
            program={name: program.digest(request.case.api, name) for name in (*request.limits, *request.followers)},
            end=end,
            host=host,
            files=keep_files(self.vault, texts),
            measured=now(),
        )
        return self.vault.put(run, key)

    def _bank(self, request: Request) -> bytes | None:
        """Return the bank of states that a request steps from or draws, None if it needs none."""
        name = request.case.bank if request.case and {STEP, DRAW} & request.limits.keys() else None
        return self.vault.content(name, MOST_FILE) if name else None

    def _host(self, site: launch.Site, ran: launch.ProbeResult, clean: _Cleaner) -> Host:
        """Return the facts of the host. If a run was not plainly good, check whether its environment still stands."""
        done, reply = ran.completed, ran.reply
        # A sandbox that seals brings a /dev/shm of its own.
        shared = done.sandbox != process.UNSEALED or os.access("/dev/shm", os.W_OK | os.X_OK)
        host = replace(self.host, shares_memory=shared)
        ours = done.shot or done.killed or done.timed_out or done.out_of_memory or ran.full
        # Facts come with the first record of a reply: where there are any, Python has started.
        bare = None if reply.facts or ours else bare_start.broken_by_packages(site)
        if bare is None and reply.checks and all(check.outcome in FINE for check in reply.checks):
            return host
        return replace(host, stood=site.stands(), bare_start=clean.line(bare) if bare else None)


def end_of(
    done: process.Completed,
    clean: Callable[[str], str],
    *,
    overran: float | None = None,
    full: bool = False,
    lost: str | None = None,
) -> RunEnd:
    """Return how a process ended, without this machine's paths."""
    return RunEnd(
        exit_code=done.exit_code,
        signal=done.signal,
        timed_out=done.timed_out,
        overran=overran,
        killed=clean(done.killed) if done.killed else None,
        out_of_memory=done.out_of_memory,
        full=full,
        lost=clean(lost) if lost else None,
        written=done.written,
        stray=done.stray,
        seconds=round(done.seconds, 4),
        peak_mb=done.peak_mb,
        starved=done.starved,
        least_room_mb=done.least_room_mb,
        sandbox=done.sandbox,
    )


class _Cleaner:
    """A filter that takes this machine's folders, and what changes from run to run, out of a text."""

    def __init__(self, places: Mapping[str, str]) -> None:
        self._places = places
        escaped = {json.dumps(path)[1:-1]: name for path, name in places.items()}
        self._in_json = {**places, **escaped}

    def line(self, text: str) -> str:
        """Return a text without these."""
        return normalise(text, self._places)

    def file(self, name: str, text: str) -> str:
        """Return the content of a file without these. In JSON, letters beyond ASCII are written otherwise."""
        return normalise(text, self._in_json if name.endswith(".jsonl") else self._places)


def _texts(ran: launch.ProbeResult, clean: _Cleaner) -> Iterator[tuple[str, bytes]]:
    """Yield the texts of a run by name, the reply first, as many as are kept."""
    left = MOST_EVIDENCE
    # Judging needs the reply most, so it comes before other texts can use up the room.
    for name, text in sorted(ran.texts(), key=lambda pair: pair[0] != REPLY):
        content = clean.file(name, text[:left]).encode(errors="replace")
        left = max(0, left - len(content))
        yield name, content


def _arrays(ran: launch.ProbeResult) -> dict[str, bytes]:
    """Return the arrays that the probe left, in a form that is equal for equal arrays; none that cannot be read."""
    arrays = {}
    for name in (OUTPUTS, BANK, PIXELS, PLAYED):
        with suppress(Unreadable):
            content = ran.left.head(name, MOST_ARRAYS + 1)
            from harness.probes import array_files  # noqa: PLC0415 - start-up: it takes numpy

            arrays[name] = array_files.encode(array_files.decode(content))
    return arrays


def _pictures(ran: launch.ProbeResult) -> Iterator[tuple[str, bytes]]:
    """Yield the frames of a run as small pictures."""
    drawn = dict.fromkeys(name for _, name in ran.reply.frames)
    for name in list(drawn)[:MOST_FRAMES]:
        with suppress(Unreadable):
            # One byte more than a frame may have is read, so that a longer file is refused, not cut.
            picture = thumbnails.thumbnail(ran.left.head(name, thumbnails.LARGEST + 1))
            if picture:
                yield f"{Path(name).stem}{PICTURE}", picture
