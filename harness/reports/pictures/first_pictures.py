"""Tell whether cells drew different first pictures, from the digests in their replies: numpy takes long to import."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import MsgspecError, Struct

from harness.model import CaseRecord, CellRecord, decoding
from harness.model.hostile_data import Unreadable
from harness.model.vocabulary import DRAW
from harness.probes.evidence import PIXELS, REPLY
from harness.probes.vault import MOST_FILE, Vault

RENDER = "render.rgb_array"


class _Picture(Struct, frozen=True):
    sha256: str
    shape: tuple[int, ...]


class _Facts(Struct, frozen=True):
    pictures: dict[str, _Picture] = {}


class _Line(Struct, frozen=True):
    kind: str
    check: str = ""
    facts: _Facts = _Facts()


def may_differ(records: Iterable[CellRecord], vault: Vault) -> bool:
    """Return whether `boundaries` may find a difference: False only where each case drew one and the same picture.

    Pictures of the states of a bank are arrays, which are not looked at here.
    """
    seen: dict[tuple[str, str], set[_Picture]] = {}
    for record in records:
        drawn = {case.id for case in record.cell.cases if {DRAW, RENDER} & {*case.checks}}
        for case in (case for case in record.cases if case.case in drawn):
            try:
                pictures = _first_pictures(case, vault)
            except (Unreadable, MsgspecError):  # `boundaries` knows what to do with damaged evidence
                pictures = None
            of_case = seen.setdefault((record.cell.matrix, case.case), set())
            of_case.update(pictures or ())
            if pictures is None or len(of_case) > 1:
                return True
    return False


def _first_pictures(case: CaseRecord, vault: Vault) -> set[_Picture] | None:
    """Return what the runs of a case say of the first picture after a reset; None if they drew states of a bank."""
    read, pictures = decoding.decoder(_Line).decode, set()
    for run in case.runs:
        files = vault.files(run)
        if PIXELS in files:
            return None
        for line in vault.content(files[REPLY], MOST_FILE).splitlines() if REPLY in files else ():
            if b'"pictures"' in line and (record := read(line)).check == RENDER and "first" in record.facts.pictures:
                pictures.add(record.facts.pictures["first"])
    return pictures
