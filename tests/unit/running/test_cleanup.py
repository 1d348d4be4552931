"""Test which files may be removed and which stay, over real folders; nothing here starts a process."""

import json
import os
from pathlib import Path

import pytest

from harness.model import replace
from harness.probes.evidence import Host, ProbeRun, Request, RunEnd, folder_of
from harness.probes.vault import Vault
from harness.running import cleanup
from harness.running.cleanup import DAY, Item, Kind, Places, disk_usage

NOW = 1_800_000_000.0


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Places:
    """Return an empty cache, state and temporary folder."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    for name in ("cache", "state", "temporary"):
        (tmp_path / name).mkdir()
    return Places(cache=tmp_path / "cache", state=tmp_path / "state", temporary=tmp_path / "temporary")


def put(path: Path, text: str = "x" * 5000, days: float = 10) -> Path:
    """Write a file, and make it and its folder so many days old."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    for each in (path, path.parent):
        os.utime(each, (NOW - days * DAY, NOW - days * DAY))
    return path


def environment(places: Places, key: str, days: float, *, whole: bool = True) -> Path:
    """Make an environment that was last used so many days ago; return its folder."""
    folder = places.cache / "environments" / key
    put(folder / "lib.py", days=days)
    if whole:
        put(folder / "stamp.json", "{}", days=days)
    return folder


def removable(places: Places) -> dict[str, Item]:
    """Return the removable items, by the name of their first folder or file."""
    return {item.paths[0].name: item for item in cleanup.find(places, NOW)}


def waste(places: Places) -> set[str]:
    """Return the names of items that are waste."""
    return {name for name, item in removable(places).items() if item.waste}


class TestCache:
    def test_an_environment_goes_with_its_bytecode(self, places: Places) -> None:
        """Both are one thing, as old as the last use; without a stamp it is waste, and so is bytecode left behind."""
        environment(places, "used", 3)
        environment(places, "unfinished", 3, whole=False)
        put(places.cache / "pycache/used/a.pyc", days=50)
        put(places.cache / "pycache/removed/a.pyc")

        known = removable(places)

        assert known["used"].paths == (places.cache / "environments/used", places.cache / "pycache/used")
        assert known["used"].used == NOW - 3 * DAY
        assert waste(places) == {"unfinished", "removed"}

    def test_other_caches_go_by_age(self, places: Places) -> None:
        """Wheels, metadata, clones, copies and downloads go by age; interpreters, and what requests led to, never."""
        put(places.cache / "wheels/key/a.whl")
        put(places.cache / "wheels/requests/asked.txt", "key")
        put(places.cache / "uv-builds/asked/wheels/x")
        put(places.cache / "repositories/mirror/HEAD")
        put(places.cache / "repositories/mirror.lock")
        put(places.cache / "brought/state/copied/tree/a.py")
        put(places.cache / "brought/state.lock")
        put(places.cache / "uv/archive-v0/x/a.py")
        put(places.cache / "pythons/cpython-3.8/bin/python3.8")
        put(places.cache / "machine.json")

        assert {name: item.kind for name, item in removable(places).items()} == {
            "key": Kind.WHEEL,
            "asked": Kind.METADATA,
            "mirror": Kind.REPOSITORY,
            "state": Kind.BROUGHT,
            "uv": Kind.UV,
        }
        assert waste(places) == set()


class TestScratch:
    def test_old_folders_that_nobody_speaks_of(self, places: Places) -> None:
        """A day after a process was killed; what is younger, a file, a link, or another program's, stays."""
        for name in ("simmatrix-kzqwxold", "tmp-kzqwx-another"):
            put(places.temporary / name / "log.txt")
        put(places.temporary / "simmatrix-kzqwxnew" / "log.txt", days=0.9)
        put(places.temporary / "simmatrix-kzqwxfile")
        (places.temporary / "simmatrix-kzqwxlink").symlink_to(places.state)
        put(places.cache / "tmp/tmpkzqwxold/uv.log")

        assert waste(places) == {"simmatrix-kzqwxold", "tmpkzqwxold"}

    def test_a_living_process_keeps_its_folder(self, places: Places, monkeypatch: pytest.MonkeyPatch) -> None:
        """One whose working folder lies inside is this test's own."""
        put(places.temporary / "simmatrix-kzqwxmine" / "log.txt")
        monkeypatch.chdir(places.temporary / "simmatrix-kzqwxmine")

        assert waste(places) == set()


class TestState:
    @pytest.fixture
    def state(self, places: Places) -> Path:
        """Return a state with a cell, its lock and install, a lock and logs of no cell, and old results."""
        lock, key = "a" * 64, "b" * 32
        cell = {"lock": f"locks/{lock[:16]}.txt", "lock_sha256": lock, "key": key, "cases": ["evidence/probe-1/x.png"]}
        state = places.state
        put(state / "cells/linux/m/cell.json", json.dumps(cell))
        put(state / "results/11/mine.json", json.dumps({"evidence": "evidence/probe-1"}))
        put(state / "locks/cc" / f"{'c' * 30}.json", json.dumps({"sha256": lock}))
        put(state / "locks/dd" / f"{'d' * 30}.json", json.dumps({"sha256": "e" * 64}))
        put(state / "installed/11/one.json", json.dumps({"key": key}))
        for name in (lock[:16], "e" * 16, "f" * 16):
            put(state / f"locks/{name}.txt")
        for name in ("probe-1", "probe-3", f"install-{key}", f"lock-{'c' * 16}", f"lock-{'f' * 16}"):
            put(state / "evidence" / name / "log.txt")
        put(places.cache / "wheels/requests/kept.txt")
        put(state / "evidence/build-kept/hook.log")
        put(state / "evidence/build-gone/hook.log")
        return state

    def test_logs_without_a_record_are_waste(self, places: Places, state: Path) -> None:
        """Logs of cells, locks, installs and builds that are known stay; results that nobody reads any more do not."""
        assert waste(places) == {"probe-3", f"lock-{'f' * 16}", "build-gone", f"{'f' * 16}.txt", "results"}

    def test_records_that_no_cell_leads_to_go_by_age(self, places: Places, state: Path) -> None:
        """A lock that some cell shows never goes."""
        records = {name for name, item in removable(places).items() if item.kind is Kind.RECORD and not item.waste}

        assert records == {f"{'d' * 30}.json"}

    def test_probe_runs_go_only_where_they_are_asked_for(self, places: Places) -> None:
        """Of those the ones that no cell has; what one that stays shares with them stays, too."""
        vault = Vault(places.state)
        shared, alone = vault.keep(b"shared"), vault.keep(b"alone")
        mine, other = (
            vault.put(
                ProbeRun(request=Request(), program={}, end=RunEnd(seconds=at), host=Host(), files=files, measured=""),
                key,
            )
            for at, key, files in (
                (1.0, "1" * 32, {"log.txt": shared}),
                (2.0, "2" * 32, {"log.txt": shared, "a.png": alone}),
            )
        )
        put(places.state / "cells/linux/m/cell.json", json.dumps({"cases": [f"{folder_of(mine)}/a.png"]}))
        for path in places.state.rglob("*"):
            os.utime(path, (NOW - 10 * DAY, NOW - 10 * DAY))

        assert {item.kind for item in cleanup.find(places, NOW)} == {Kind.EVIDENCE}  # of `other`: only links
        asked = cleanup.find(replace(places, evidence=True), NOW)
        gone = {item.paths[0] for item in asked if item.kind is Kind.RUN}
        assert gone == {
            vault.folder / "ac" / "22" / ("2" * 30),
            *(vault.folder / "cas" / name[:2] / name[2:] for name in (other, alone)),
        }

    def test_nothing_young_is_touched(self, places: Places, state: Path) -> None:
        """It may belong to a cell whose record is still to come."""
        for path in state.rglob("*"):
            os.utime(path, (NOW - 0.9 * DAY, NOW - 0.9 * DAY))

        assert removable(places) == {}

    def test_no_state(self, tmp_path: Path, places: Places) -> None:
        """A missing state folder is no error, and is not created."""
        assert cleanup.find(Places(cache=places.cache, state=tmp_path / "none"), NOW) is not None
        assert not (tmp_path / "none").exists()


class TestSizes:
    def test_shared_files_count_once(self, places: Places) -> None:
        """A file with several names counts in equal parts for each, and once for all."""
        first, second = (environment(places, key, days) for key, days in (("first", 9), ("second", 3)))
        (second / "shared.bin").write_bytes(b"x" * 1_000_000)
        (first / "shared.bin").hardlink_to(second / "shared.bin")
        one, two = cleanup.find(places, NOW)

        assert 500_000 < one.size < 600_000
        assert 500_000 < two.size < 600_000
        assert disk_usage(first, second) < 1_100_000

    def test_oldest_first_until_it_fits(self, places: Places) -> None:
        """A size limit removes waste first, then the least recently used, and no more than needed."""
        for key, days in (("c", 1), ("a", 9), ("b", 5)):
            folder = environment(places, key, days)
            (folder / "data.bin").write_bytes(b"x" * 1_000_000)
            os.utime(folder, (NOW - days * DAY, NOW - days * DAY))
        environment(places, "unfinished", 0, whole=False)
        items = cleanup.find(places, NOW)
        size = disk_usage(places.cache)

        def names(**limits: float | int | None) -> list[str]:
            asked = {"before": None, "most": None} | limits
            chosen = cleanup.select_items(items, size, before=asked["before"], most=asked["most"])  # type: ignore[arg-type]
            return [item.paths[0].name for item in chosen]

        assert names() == ["unfinished"]
        assert names(most=2_500_000) == ["unfinished", "a"]
        assert names(most=1_500_000) == ["unfinished", "a", "b"]
        assert names(most=0) == ["unfinished", "a", "b", "c"]
        assert names(before=NOW - 4 * DAY) == ["a", "b", "unfinished"]
        assert names(before=NOW - 4 * DAY, most=0) == ["a", "b", "unfinished", "c"]
