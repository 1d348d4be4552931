"""Isaac Gym's cameras, driven against a stand-in: what became of each pair of devices, and what mends it.

Nothing of NVIDIA's runs here. The stand-in has the calls that the published stubs have, and plays what was reported.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from importlib.metadata import files
from pathlib import Path

import msgspec
import pytest
from commandline import Desk, Measured, Ran
from filelock import FileLock

from harness import cameras, index, interpreters, uv
from harness.cameras import Pair
from harness.errors import CouldNotTell
from harness.model import Lock, Question
from harness.reporttypes import CellEntry

STANDINS = Path(__file__).parents[2] / "standins"
NUMPY, AS_OF = ("numpy<1.24",), "2026-01-01T00:00:00Z"
GPUS = 5
REPORTED = {
    "c1g0": "error-101",
    "c0g1": "lavapipe",
    "c2g3": "error-801",
    "c3g4": "black",
    "c4g5": "no-camera",
    "c3g0": "none",
}
"""Pairs of devices of the server, and how they fail."""

pytestmark = [
    pytest.mark.skipif(interpreters.find("3.8") is None, reason="unavailable: python3.8"),
    pytest.mark.skipif(shutil.which("cc") is None, reason="unavailable: a C compiler"),
]


@pytest.fixture(scope="session")
def numpy(together: Path, pytestconfig: pytest.Config) -> Path:
    """A numpy for Python 3.8: downloaded once, then kept in pytest's own cache."""
    kept = pytestconfig.cache.mkdir("wheels") / f"numpy-{AS_OF[:10]}-3.8"  # type: ignore[union-attr]
    python = interpreters.find("3.8")
    assert python
    with FileLock(together / "numpy.lock"), pytest.MonkeyPatch.context() as patch:
        if not kept.exists():
            patch.setenv("HARNESS_CACHE", str(together / "downloads"))
            question = Question(requirements=NUMPY, only_binary=(":all:",), snapshot=AS_OF)
            lock = uv.resolve(question, python, together / "log")
            try:
                for pin in lock.pins if isinstance(lock, Lock) else ():
                    index.fetch(pin.artifact, together / "numpy")
            except CouldNotTell:
                pytest.skip("unavailable: package index")
            if not isinstance(lock, Lock):
                pytest.skip("unavailable: package index")
            shutil.copytree(together / "numpy", kept)
    return next(kept.rglob("*.whl")).parent


@pytest.fixture(scope="session")
def measured(once: Callable[[str, Callable[[Desk], Ran]], Measured], numpy: Path) -> Measured:
    """Two machines, both run once."""

    def measure(desk: Desk) -> Ran:
        drivers(desk.folder / "drivers")
        server = archive(desk.folder / "server", REPORTED)
        locked = archive(desk.folder / "locked", {"gymtorch": "locked"})
        text = Path(__file__).with_name("isaac-gym.toml").read_text(encoding="utf-8")
        matrix = desk.matrix("isaac-gym", text.replace("@NUMPY@", str(numpy)))
        return desk.run(
            "run", matrix, "--json", "-j", "2", ISAACGYM_PATH=str(server / "python"), ISAACGYM_PATH_LOCKED=str(locked)
        )

    return once("isaac-gym", measure)


def archive(folder: Path, machine: dict[str, str]) -> Path:
    """Put the stand-in, with the stubs in it, where a user would have unpacked Isaac Gym."""
    shutil.copytree(STANDINS / "isaacgym", folder, ignore=shutil.ignore_patterns("__pycache__"))
    stubs = next(path for path in files("isaacgym-stubs") or () if path.name == "gymapi.pyi")
    package = folder / "python" / "isaacgym"
    shutil.copy(str(stubs.locate()), package / "gymapi.pyi")
    (package / "machine.json").write_text(json.dumps(machine))
    return folder


def drivers(folder: Path) -> None:
    """Compile the stand-ins of both drivers."""
    folder.mkdir()
    for name in ("libcuda", "libvulkan"):
        source = STANDINS / "drivers" / f"{name}.c"
        target = folder / f"{name}.so.1"
        subprocess.run(("cc", "-shared", "-fPIC", f"-DGPUS={GPUS}", "-o", target, source), check=True)


def pairs(measured: Measured, machine: str) -> dict[str, Pair]:
    """Every pair of devices of a machine, by a name such as `c0g1`."""
    cell = msgspec.convert(measured.ran.cells("machine")[machine], CellEntry)
    return {f"c{pair.compute}g{pair.graphics}": pair for pair in cameras.pairs(cell)}


def test_each_pair_has_its_class(measured: Measured) -> None:
    """Every failure is told from the others, on its own devices and by its own way to the picture."""
    assert {name: (str(pair.tensor), str(pair.cpu)) for name, pair in pairs(measured, "server").items()} == {
        "c0g0": ("ok", "ok"),
        "c0g1": ("crash", "crash"),
        "c0g6": ("no such device", "no such device"),
        "c1g0": ("error 101", "ok"),
        "c2g3": ("crash", "ok"),
        "c3g0": ("None", "ok"),
        "c3g4": ("black", "ok"),
        "c4g5": ("no camera", "no camera"),
        "c5g0": ("no such device", "no such device"),
    }
    locked = pairs(measured, "locked")
    assert [(str(pair.tensor), str(pair.cpu)) for pair in locked.values()] == [("hang", "ok")]
