"""Collect the results of a camera on each pair of devices, by either way to the picture.

The cases are named `c0g1-tensor` and `c0g1-cpu`. The first way leaves pictures on the GPU, the second copies them to
the host, which is the known workaround if the first fails.
"""

from __future__ import annotations

import re
from enum import StrEnum

from msgspec import Struct

from harness.model import Outcome
from harness.model.report_types import CaseEntry, CellEntry
from harness.model.words import wording

CASE = re.compile(r"c(\d+)g(\d+)-(tensor|cpu)")
CHECK = "render.rgb_array"
NUMBER = re.compile(r" failed on .* with error (\d+)$")
NO_PICTURE, NO_CAMERA, BLACK = "isaacgym.no_picture", "isaacgym.no_camera", "render.blank"
"""The observations of a cell whose sentence is the decisive line of a failure in documents."""


class Seen(StrEnum):
    """The result of one way to the picture."""

    OK = "ok"
    ERROR = "CUDA error"
    NONE = "None"
    NO_CAMERA = "no camera"
    BLACK = "black"
    CRASH = "crash"
    HANG = "hang"
    FAILED = "another failure"
    ABSENT = "no such device"
    UNTOLD = "not told"


BAD = frozenset({Seen.ERROR, Seen.NONE, Seen.NO_CAMERA, Seen.BLACK, Seen.CRASH, Seen.HANG, Seen.FAILED})
ENDS = {
    Outcome.PASSED: Seen.OK,
    Outcome.CRASHED: Seen.CRASH,
    Outcome.TIMED_OUT: Seen.HANG,
    Outcome.SKIPPED: Seen.ABSENT,
}


class Way(Struct, frozen=True, kw_only=True):
    """One way to the picture: its result, the reason, and what native code printed besides.

    `error` is CUDA's number if the picture is None and a buffer could not be mapped or imported.
    """

    seen: Seen = Seen.UNTOLD
    why: str = ""
    native: tuple[str, ...] = ()
    error: int | None = None

    def __str__(self) -> str:
        """Return the result in words: `error 101`, `black`."""
        return f"error {self.error}" if self.seen is Seen.ERROR else self.seen.value


class Pair(Struct, frozen=True, kw_only=True):
    """A compute device and a graphics device, with the results of both ways."""

    compute: int
    graphics: int
    tensor: Way
    cpu: Way

    @property
    def proven(self) -> bool | None:
        """Return whether copying works where tensors fail.

        None if tensors do not fail on these devices, or copying has no result there.
        """
        if self.tensor.seen not in BAD or self.cpu.seen in {Seen.UNTOLD, Seen.ABSENT}:
            return None
        return self.cpu.seen is Seen.OK


def pairs(cell: CellEntry) -> tuple[Pair, ...]:
    """Return every pair of devices that a cell has cases for, in their order."""
    native = {
        case.case: tuple(one.text for one in cell.findings if one.check.endswith(".native") and case.case in one.cases)
        for case in cell.cases
    }
    by_devices: dict[tuple[int, int], dict[str, Way]] = {}
    for case in cell.cases:
        if named := CASE.fullmatch(case.case):
            devices = int(named[1]), int(named[2])
            by_devices.setdefault(devices, {})[named[3]] = classify_case(case, native[case.case])
    return tuple(
        Pair(compute=compute, graphics=graphics, tensor=ways.get("tensor", Way()), cpu=ways.get("cpu", Way()))
        for (compute, graphics), ways in sorted(by_devices.items())
    )


def classify_case(case: CaseEntry, native: tuple[str, ...] = ()) -> Way:
    """Classify the result of one case."""
    last = CHECK if CHECK in case.checks else next(reversed(case.checks), "")
    outcome, why = case.checks.get(last), case.reasons.get(last, "")
    # Nothing ran, or the import alone, which passed: nothing is known of the camera.
    if outcome is None or (last != CHECK and outcome is Outcome.PASSED):
        return Way(native=native)
    if outcome is not Outcome.FAILED:
        return Way(seen=ENDS.get(outcome, Seen.UNTOLD), why=why, native=native)
    number = next((int(match[1]) for line in native if (match := NUMBER.search(line))), None)
    if _says(NO_PICTURE, why):
        return Way(seen=Seen.NONE if number is None else Seen.ERROR, why=why, native=native, error=number)
    seen = Seen.NO_CAMERA if _says(NO_CAMERA, why) else Seen.BLACK if _says(BLACK, why) else Seen.FAILED
    return Way(seen=seen, why=why, native=native)


def _says(code: str, line: str) -> bool:
    """Return whether a line is the sentence of an observation code."""
    return re.search(wording(code), line) is not None
