"""Releases that only hold the name of a package for later ones."""

from __future__ import annotations

from harness.history.api_history import MeasuredRelease, ReleaseEntry
from harness.history.making import PLACEHOLDER, without_placeholders
from harness.history.release_reader import ReleaseFacts

NAMES = tuple(f"name_{number}" for number in range(PLACEHOLDER * 4))


def release(version: str, *, names: int = 0, ran: int | None = None) -> MeasuredRelease:
    """Return a release with so many names, in Python and in machine code."""
    return MeasuredRelease(
        entry=ReleaseEntry(version=version, read=True),
        facts=ReleaseFacts(modules=("toy",), names={"toy": NAMES[:names]} if names else {}),
        ran=None if ran is None else ReleaseFacts(names={"toy": NAMES[:ran]}),
    )


def read(*releases: MeasuredRelease) -> list[str]:
    """Return the versions that count as read."""
    return [item.entry.version for item in without_placeholders([*releases]) if item.entry.read and item.facts]


def test_a_release_with_hardly_a_name_counts_as_not_read() -> None:
    """Else all names would seem to begin with the next one."""
    some = release("0.1", names=1), release("1.0", names=len(NAMES)), release("1.1", names=len(NAMES))
    assert read(*some) == ["1.0", "1.1"]


def test_names_in_machine_code_count() -> None:
    """A release may have nothing but a module in C; another may have it and yet no names."""
    some = release("0.0", ran=1), release("0.1", ran=len(NAMES)), release("1.0", names=len(NAMES), ran=len(NAMES))
    assert read(*some) == ["0.1", "1.0"]
