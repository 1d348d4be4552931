"""The changelog of a package beside a boundary: what it says, that it says nothing, or that it was not read."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.reports import changelogs
from harness.running import open_matrix


def test_only_what_was_read_is_claimed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A release that is not listed was not read; nothing is said of it."""
    (tmp_path / "changelogs").mkdir()
    up = '[[release]]\nversion = "1.1"\nsays = "Gravity points up."\n'
    text = f'source = "address"\n{up}[[release]]\nversion = "1.2"\nsays = ""\n'
    (tmp_path / "changelogs" / "sim.toml").write_text(text, encoding="utf-8")
    monkeypatch.setattr(open_matrix, "data_folder", lambda: tmp_path)
    assert changelogs.look_up("sim", ("1.1",)) == "The changelog of 1.1 says: Gravity points up."
    assert changelogs.look_up("sim", ("1.2", "1.3")) == (
        "Not in the changelog of 1.2. The changelog of 1.3 was not read."
    )


def test_the_changelog_of_a_package_without_a_file_was_not_read() -> None:
    """Nothing is claimed of it."""
    assert changelogs.look_up("no-such-package", ("1.0",)) == "The changelog of no-such-package was not read."


def test_packages_that_moved_with_a_release_have_their_say() -> None:
    """The changelog of another package that moved is read, if the axis has none of its own."""
    moved = {"dm-control": ("1.0.31", "1.0.36"), "mujoco": ("3.3.3", "3.4.0"), "zipp": ("1", "2")}
    said = changelogs.look_up_moved("release", ("dm-control-1.0.36",), moved)
    assert said == "The changelog of mujoco 3.4.0 says: Fixed a bug in the box-box distance computation."
    alone = changelogs.look_up_moved("release", ("dm-control-1.0.36",), {"dm-control": ("1.0.31", "1.0.36")})
    assert alone == "The changelog of dm-control was not read."


def test_a_release_may_name_its_package() -> None:
    """An axis of several packages has releases such as `mujoco-3.0.0`."""
    plain = changelogs.look_up("mujoco", ("3.0.0",))
    assert changelogs.look_up("mujoco", ("mujoco-3.0.0",)) == plain.replace("of 3.0.0", "of mujoco-3.0.0")


def test_the_committed_changelogs_can_be_read() -> None:
    """MuJoCo's is there, and says what mended the mid-phase."""
    assert "geom margin to be ignored" in changelogs.look_up("mujoco", ("3.0.0",))
