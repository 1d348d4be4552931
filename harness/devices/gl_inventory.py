"""Ask each way to draw in the caller's own environment: every EGL device, OSMesa and the display, one by one."""

from __future__ import annotations

import os
import sys

import msgspec

from harness.devices.egl_rules import Device
from harness.machine.files import guarded_files
from harness.machine.files.scratch_folders import scratch_folder
from harness.machine.process import Command, Limits, Profile, run
from harness.machine.this_machine import PROBE

SECONDS = 60.0
MOST_DEVICES = 32

Answer = dict[str, str]
"""What a way of drawing says of itself, or `missing`: why there is none."""


class RenderingWays(msgspec.Struct, frozen=True, kw_only=True):
    """The ways to draw: EGL's devices in EGL's order, or why there are none, and the two other ways."""

    devices: tuple[Answer, ...]
    egl_missing: str | None
    osmesa: Answer
    display: Answer

    def as_devices(self) -> tuple[Device, ...]:
        """Return the devices as `egl_rules` describes them."""
        numbers = (int(one["cuda"]) if "cuda" in one else None for one in self.devices)
        return tuple(
            Device(cuda=number, works="missing" not in one) for number, one in zip(numbers, self.devices, strict=True)
        )


def ways() -> RenderingWays:
    """Ask everything that could draw, each in a process of its own, with the caller's variables."""
    first = _ask("device:0")
    count = min(int(first.get("count", "0")), MOST_DEVICES)
    devices = [first, *(_ask(f"device:{place}") for place in range(1, count))] if count else []
    # An EGL without devices answers with a count of 0; no count at all means that there is no EGL.
    missing = None if devices else "EGL lists no device" if "count" in first else first["missing"]
    answers = tuple({name: text for name, text in one.items() if name != "count"} for one in devices)
    return RenderingWays(devices=answers, egl_missing=missing, osmesa=_ask("osmesa"), display=_ask("display"))


def _ask(way: str) -> Answer:
    """Run the probe for one way and return its answer; `missing` says how its driver crashed or hung."""
    with scratch_folder() as folder:
        answer = folder / "answer.json"
        command = Command(
            argv=(sys.executable, "-I", "-S", str(PROBE), way, str(answer)),
            cwd=folder,
            env=dict(os.environ),
            limits=Limits(seconds=SECONDS),
            log=folder / "log",
            profile=Profile.HOST,
        )
        done = run(command)
        reply = guarded_files.load(answer, Answer)
    if reply is not None:
        return reply
    how = f"crashed with signal {done.signal}" if done.signal else "did not answer"
    # A driver that crashed gave no count, and without one it would pass for a machine without EGL.
    count = {"count": str(int(way.partition(":")[2]) + 1)} if way.startswith("device:") else {}
    return {**count, "missing": f"its driver {how}"}
