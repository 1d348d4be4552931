"""Decide how many probes run at a time: as many as there are slots, and memory for."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from harness.machine.capacity import Reading


class Room:
    """Slots, and memory where it counts; one probe is always let in."""

    def __init__(self, slots: int, reading: Callable[[], Reading] | None) -> None:
        self.slots, self._reading = slots, reading

    def admits(self, needed_mb: int, admitted_mb: Sequence[int]) -> bool:
        """Return whether one more probe may start beside those admitted, by what each is expected to hold at most.

        What they have not taken yet is spoken for: the largest expectation goes with the largest holder.
        """
        if not admitted_mb:
            return True
        if len(admitted_mb) >= self.slots:
            return False
        now = self._reading() if self._reading else None
        if now is None or now.free_mb is None:
            return True
        # A reading does not tell which probe holds what, and one that was just let in may not be in it yet.
        held = sorted(now.held_mb, reverse=True) + [0] * len(admitted_mb)
        promised = sum(max(0, need - has) for need, has in zip(sorted(admitted_mb, reverse=True), held, strict=False))
        return now.free_mb - promised - needed_mb > 0
