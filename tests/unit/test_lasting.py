"""Which locks `--fresh` may keep."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
from builders import lock, pin

from harness.model import IndexSettings, Lock, Question
from harness.running.scheduler.lasting import lasts

NAME = "demo-1.0-py3-none-any.whl"


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No settings of the user's."""
    for name in [name for name in os.environ if name.startswith(("UV_", "PIP_"))]:
        monkeypatch.delenv(name)
    for name in ("HOME", "XDG_CONFIG_HOME", "XDG_CONFIG_DIRS"):
        monkeypatch.setenv(name, str(tmp_path / "home"))


@pytest.fixture
def wheels(tmp_path: Path) -> Path:
    """A folder with one wheel."""
    folder = tmp_path / "my wheels"
    folder.mkdir()
    (folder / NAME).write_bytes(b"one")
    return folder


def locked(source: str, *escaped: str) -> Lock:
    """A lock of one package."""
    return lock(pin("demo", "1.0", source, NAME), instant="2026-01-01T00:00:00Z", escaped=escaped)


def question(*links: Path | str) -> Question:
    """A question whose answer lies in these places."""
    return Question(requirements=("demo",), index=IndexSettings(find_links=tuple(map(str, links))))


def later() -> int:
    """An instant, and the clock of the file system beyond it."""
    time.sleep(0.02)
    now = time.time_ns()
    time.sleep(0.02)
    return now


def test_the_instant_decides(wheels: Path) -> None:
    """A lock to which its instant applied lasts, whatever lies in a folder."""
    assert lasts(locked("https://files.example/demo.whl"), question(wheels / "absent"), 0)


def test_an_untouched_folder(wheels: Path) -> None:
    """What came from a folder lasts while the folder is as it was."""
    assert lasts(locked((wheels / NAME).as_uri(), "demo"), question(wheels), later())


@pytest.mark.parametrize("change", ["another", "overwritten", "removed", "link"])
def test_a_changed_folder(wheels: Path, tmp_path: Path, change: str) -> None:
    """A wheel more, another one of the same name, no folder any more, or a link that leads elsewhere now."""
    link = tmp_path / "link"
    link.symlink_to(wheels)
    made = later()
    assert lasts(locked((wheels / NAME).as_uri(), "demo"), question(link), made)

    if change == "another":
        (wheels / "demo-2.0-py3-none-any.whl").touch()
    elif change == "overwritten":
        (wheels / NAME).write_bytes(b"two")
    elif change == "removed":
        wheels.rename(tmp_path / "gone")
    else:
        link.unlink()
        link.symlink_to(wheels)

    assert not lasts(locked((wheels / NAME).as_uri(), "demo"), question(link), made)


@pytest.mark.parametrize(
    ("source", "link"),
    [
        ("https://files.example/demo.whl", "WHEELS"),
        ("WHEELS", "https://files.example/links.html"),
        ("file:///elsewhere/demo.whl", "WHEELS"),
    ],
)
def test_what_cannot_be_watched(wheels: Path, source: str, link: str) -> None:
    """An index without upload times, a page of links, a file that lies in no such folder: asked again."""
    source = (wheels / NAME).as_uri() if source == "WHEELS" else source
    place = wheels if link == "WHEELS" else link

    assert not lasts(locked(source, "demo"), question(place), later())
