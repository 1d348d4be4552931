"""A probe run is kept for ever, by its content; nothing that was kept is altered."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest
from readings import CASE, GOOD, HERE, lines, passed

from harness.machine import process
from harness.model import replace
from harness.model.errors import CouldNotTell
from harness.model.hostile_data import Unreadable
from harness.probes.evidence import LOG, REPLY, ProbeRun, Request
from harness.probes.vault import Vault, keep_files

KEY = "0123456789abcdef0123456789abcdef"
REQUEST = Request(case=CASE, limits={"import.modules": 120.0})


def run(vault: Vault, text: bytes = b"hello\n", **files: bytes) -> ProbeRun:
    """Return a run whose files are kept."""
    texts = {REPLY: lines(passed("import.modules")), LOG: text, **files}
    return ProbeRun(
        request=REQUEST,
        program={"import.modules": "a"},
        end=GOOD,
        host=HERE,
        files=keep_files(vault, texts),
        measured="2026-11-23T12:00:00Z",
    )


def contents(folder: Path) -> dict[str, bytes]:
    """Return every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_run_comes_back_as_it_was_kept(tmp_path: Path) -> None:
    """A stored run comes back with its texts and its parsed reply."""
    vault = Vault(tmp_path)
    made = run(vault)
    name = vault.put(made, KEY)

    found = vault.reading(name)
    assert vault.runs(KEY) == (name,)
    assert (found.name, found.run) == (name, made)
    assert found.printed == "hello\n"
    assert [check.check for check in found.reply.checks] == ["import.modules"]


def test_a_run_that_the_user_stopped_is_not_kept(tmp_path: Path) -> None:
    """Its last check failed for no reason of its own: the next run would reuse that, and call the cell good."""
    vault = Vault(tmp_path)
    stopped = replace(run(vault), end=replace(GOOD, killed=process.INTERRUPTED))

    with pytest.raises(CouldNotTell, match="interrupted"):
        vault.put(stopped, KEY)
    assert vault.runs(KEY) == ()


def test_a_second_measurement_is_a_second_run(tmp_path: Path) -> None:
    """A second run stands beside the first, whose bytes do not change."""
    vault = Vault(tmp_path)
    first = vault.put(run(vault), KEY)
    before = contents(tmp_path)
    second = vault.put(run(vault, b"other\n"), KEY)
    after = contents(tmp_path)

    assert vault.runs(KEY) == (first, second)
    claim = next(name for name in before if name.startswith("vault/ac/"))
    assert {name: after[name] for name in before if name != claim} == {k: v for k, v in before.items() if k != claim}
    assert after[claim].startswith(before[claim])


def test_the_same_run_is_named_once(tmp_path: Path) -> None:
    """Two processes that kept the same are one answer."""
    vault = Vault(tmp_path)
    names = {vault.put(run(vault), KEY), vault.put(run(vault), KEY)}

    assert set(vault.runs(KEY)) == names
    assert len(vault.runs(KEY)) == 1


def test_people_find_the_files_of_a_run_by_name(tmp_path: Path) -> None:
    """A run has its own folder of named files, which cannot be changed by mistake."""
    vault = Vault(tmp_path)
    name = vault.put(run(vault, **{"first.png": b"picture"}), KEY)
    folder = tmp_path / vault.reading(name).folder

    assert {path.name for path in folder.iterdir()} == {LOG, REPLY, "first.png"}
    assert (folder / LOG).read_bytes() == b"hello\n"
    assert not (folder / LOG).stat().st_mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH)


@pytest.mark.parametrize("damage", ["cut", "changed", "gone", "link"])
def test_a_damaged_file_is_refused(tmp_path: Path, damage: str) -> None:
    """A damaged file is refused, and is stored anew when it comes again."""
    vault = Vault(tmp_path)
    made = run(vault)
    name = vault.put(made, KEY)
    sha = made.files[LOG]
    path = vault.folder / "cas" / sha[:2] / sha[2:]
    path.chmod(0o644)
    if damage == "gone":
        path.unlink()
    elif damage == "link":
        path.unlink()
        path.symlink_to("/etc/hostname")
    else:
        path.write_bytes(b"hel" if damage == "cut" else b"hullo\n")

    with pytest.raises(Unreadable):
        vault.reading(name)
    assert list(vault.readings([name])) == []
    run(vault)
    assert vault.reading(name).run == made


def test_a_claim_that_was_damaged_names_what_is_left_of_it(tmp_path: Path) -> None:
    """A line that is no name of a run is passed over."""
    vault = Vault(tmp_path)
    name = vault.put(run(vault), KEY)
    with (vault.folder / "ac" / KEY[:2] / KEY[2:]).open("ab") as file:
        file.write(b"cut sh\n../../etc/passwd\n" + b"0" * 63 + b"\n")

    assert vault.runs(KEY) == (name,)


def test_nothing_is_known_of_a_key_that_nobody_claimed(tmp_path: Path) -> None:
    """An unknown key has no runs, and asking for it writes nothing."""
    assert Vault(tmp_path).runs(KEY) == ()
    assert not (tmp_path / "vault").exists()


def test_a_run_says_how_its_process_ended(tmp_path: Path) -> None:
    """Every fact about the end comes back."""
    vault = Vault(tmp_path)
    end = replace(GOOD, signal=11, exit_code=None, overran=2.0, full=True, lost="x", written=("a",), least_room_mb=3)
    name = vault.put(replace(run(vault), end=end), KEY)

    assert vault.reading(name).run.end == end
