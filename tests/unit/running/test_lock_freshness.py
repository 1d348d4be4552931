"""Test which locks `--fresh` may keep."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
from builders import lock, pin

from harness.model import IndexSettings, Lock, Question
from harness.running.scheduler.lock_freshness import is_still_valid

NAME = "demo-1.0-py3-none-any.whl"


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Remove the user's settings."""
    for name in [name for name in os.environ if name.startswith(("UV_", "PIP_"))]:
        monkeypatch.delenv(name)
    for name in ("HOME", "XDG_CONFIG_HOME", "XDG_CONFIG_DIRS"):
        monkeypatch.setenv(name, str(tmp_path / "home"))


@pytest.fixture
def wheels(tmp_path: Path) -> Path:
    """Return a folder with one wheel."""
    folder = tmp_path / "my wheels"
    folder.mkdir()
    (folder / NAME).write_bytes(b"one")
    return folder


def locked(source: str, *escaped: str) -> Lock:
    """Return a lock of one package."""
    return lock(pin("demo", "1.0", source, NAME), instant="2026-01-01T00:00:00Z", escaped=escaped)


def question(*links: Path | str) -> Question:
    """Return a question whose packages come from these places."""
    return Question(requirements=("demo",), index=IndexSettings(find_links=tuple(map(str, links))))


def later() -> int:
    """Return a time in nanoseconds that lies clearly between earlier and later file changes."""
    time.sleep(0.02)
    now = time.time_ns()
    time.sleep(0.02)
    return now


def test_the_instant_decides(wheels: Path) -> None:
    """A lock to which its instant applied lasts, whatever lies in a folder."""
    assert is_still_valid(locked("https://files.example/demo.whl"), question(wheels / "absent"), 0)


def test_an_untouched_folder(wheels: Path) -> None:
    """A lock with a file from a folder lasts while the folder is unchanged."""
    assert is_still_valid(locked((wheels / NAME).as_uri(), "demo"), question(wheels), later())


@pytest.mark.parametrize("change", ["another", "overwritten", "removed", "link"])
def test_a_changed_folder(wheels: Path, tmp_path: Path, change: str) -> None:
    """An added or replaced wheel, a missing folder or a redirected link ends the lock."""
    link = tmp_path / "link"
    link.symlink_to(wheels)
    made = later()
    assert is_still_valid(locked((wheels / NAME).as_uri(), "demo"), question(link), made)

    if change == "another":
        (wheels / "demo-2.0-py3-none-any.whl").touch()
    elif change == "overwritten":
        (wheels / NAME).write_bytes(b"two")
    elif change == "removed":
        wheels.rename(tmp_path / "gone")
    else:
        link.unlink()
        link.symlink_to(wheels)

    assert not is_still_valid(locked((wheels / NAME).as_uri(), "demo"), question(link), made)


@pytest.mark.parametrize(
    ("source", "link"),
    [
        ("https://files.example/demo.whl", "WHEELS"),
        ("WHEELS", "https://files.example/links.html"),
        ("file:///elsewhere/demo.whl", "WHEELS"),
    ],
)
def test_locks_from_places_without_dates_are_resolved_again(wheels: Path, source: str, link: str) -> None:
    """Locks from an index without upload times, a page of links or another folder are resolved again."""
    source = (wheels / NAME).as_uri() if source == "WHEELS" else source
    place = wheels if link == "WHEELS" else link

    assert not is_still_valid(locked(source, "demo"), question(place), later())
