"""Share one shelf of wheels, one cache and one run over all defects among the tests of the command line."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path

import pytest
import shelf
import wheelhouse as fakes
from commandline import SMALL, CommandResult, Desk, DeskRun
from filelock import FileLock


@pytest.fixture(scope="session")
def together(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder that all workers of this session share, empty at its start."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base) / "spine"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def wheels(together: Path, pytestconfig: pytest.Config) -> Path:
    """Return a folder with the fakes and the few real wheels that they need.

    The real wheels are downloaded once, then kept in pytest's own cache.
    """
    folder = together / "wheels"
    with FileLock(together / "wheels.lock"):
        if not folder.exists():
            making = fakes.make(together / "making")
            for wheel in _downloaded(pytestconfig.cache.mkdir("wheels"), together):  # type: ignore[union-attr]
                shutil.copy(wheel, making)
            making.rename(folder)
    return folder


def _downloaded(storage: Path, together: Path) -> Iterable[Path]:
    try:
        return shelf.download_wheels(storage, together / "downloads")
    except shelf.NoIndex:
        pytest.skip("unavailable: package index")


@pytest.fixture
def desk(together: Path, wheels: Path, tmp_path: Path) -> Desk:
    """Return a working folder with an empty state."""
    return Desk(folder=tmp_path, cache=together / "cache", wheels=wheels)


@pytest.fixture(scope="session")
def once(together: Path, wheels: Path) -> Callable[[str, Callable[[Desk], CommandResult]], DeskRun]:
    """Return a function that runs something once for all workers of the session; the others read its result."""

    def once(name: str, measure: Callable[[Desk], CommandResult]) -> DeskRun:
        desk = Desk(folder=together / name, cache=together / "cache", wheels=wheels)
        path = together / f"{name}.json"
        with FileLock(together / f"{name}.lock"):
            if not path.exists():
                desk.folder.mkdir()
                path.write_text(json.dumps(asdict(measure(desk))), encoding="utf-8")
        return DeskRun(desk=desk, ran=CommandResult(**json.loads(path.read_text(encoding="utf-8"))))

    return once


@pytest.fixture(scope="session")
def small(once: Callable[[str, Callable[[Desk], CommandResult]], DeskRun]) -> DeskRun:
    """Return a run of the small matrix, which has a cell that works and one that is red."""
    return once("small", lambda desk: desk.run("run", desk.matrix("small", SMALL.read_text()), "--json"))


@pytest.fixture
def desk_with_results(desk: Desk, small: DeskRun) -> Desk:
    """Return a working folder in which the small matrix was run before."""
    shutil.copytree(small.desk.state, desk.state)
    desk.matrix("small", SMALL.read_text())
    return desk


@pytest.fixture(scope="session")
def defects(once: Callable[[str, Callable[[Desk], CommandResult]], DeskRun]) -> DeskRun:
    """Return a run of every defect that shows at run time."""
    text = (Path(__file__).parent / "defects.toml").read_text(encoding="utf-8")
    return once("defects", lambda desk: desk.run("run", desk.matrix("defects", text), "--json", "-j", "2"))


@pytest.fixture(scope="session")
def verdicts(once: Callable[[str, Callable[[Desk], CommandResult]], DeskRun]) -> DeskRun:
    """Return a run of the verdicts that no run-time defect leads to.

    Each failure is confirmed by `--verify`; the cell `left-out` is not run.
    """

    def measure(desk: Desk) -> CommandResult:
        matrices = [
            desk.matrix(path.stem, path.read_text(encoding="utf-8"))
            for path in sorted(Path(__file__).parent.glob("verdict-*.toml"))
        ]
        return desk.run("run", *matrices, "--verify", "-k", "*[!t]", "--json", "-j", "2", UV_HTTP_RETRIES="0")

    return once("verdicts", measure)
