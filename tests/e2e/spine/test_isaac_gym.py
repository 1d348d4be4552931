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
import numpy
import pytest
from commandline import CommandResult, Desk, DeskRun
from filelock import FileLock
from PIL import Image

from harness.machine import interpreters
from harness.model import Lock, Question
from harness.model.errors import CouldNotTell
from harness.model.report_types import CellEntry, Document
from harness.packages import index, resolver
from harness.reports.tables import tables
from harness.reports.text import author_pages, camera_pages
from harness.reports.text.camera_pages import Pair

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
def numpies(together: Path, pytestconfig: pytest.Config) -> Path:
    """Return a folder with a numpy for Python 3.8: downloaded once, then kept in pytest's own cache."""
    kept = pytestconfig.cache.mkdir("wheels") / f"numpy-{AS_OF[:10]}-3.8"  # type: ignore[union-attr]
    python = interpreters.find("3.8")
    assert python
    with FileLock(together / "numpy.lock"), pytest.MonkeyPatch.context() as patch:
        if not kept.exists():
            patch.setenv("HARNESS_CACHE", str(together / "downloads"))
            question = Question(requirements=NUMPY, only_binary=(":all:",), snapshot=AS_OF)
            lock = resolver.resolve(question, python, together / "log")
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
def measured(once: Callable[[str, Callable[[Desk], CommandResult]], DeskRun], numpies: Path) -> DeskRun:
    """Return a run of the cells of two machines."""

    def measure(desk: Desk) -> CommandResult:
        drivers(desk.folder / "drivers")
        server = archive(desk.folder / "server", REPORTED)
        locked = archive(desk.folder / "locked", {"gymtorch": "locked"})
        text = Path(__file__).with_name("isaac-gym.toml").read_text(encoding="utf-8")
        matrix = desk.matrix("isaac-gym", text.replace("@NUMPY@", str(numpies)))
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


def pairs(measured: DeskRun, machine: str) -> dict[str, Pair]:
    """Return every pair of devices of a machine, by a name such as `c0g1`."""
    cell = msgspec.convert(measured.ran.cells("machine")[machine], CellEntry)
    return {f"c{pair.compute}g{pair.graphics}": pair for pair in camera_pages.pairs(cell)}


def test_each_pair_has_its_class(measured: DeskRun) -> None:
    """Each pair of devices gets the class of its own failure, for the GPU picture and for the copied one."""
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


def test_the_way_round_is_proven_on_the_same_devices(measured: DeskRun) -> None:
    """If a picture cannot stay on the GPU, copying it is tried on the same pair of devices, and reported."""
    assert {name: pair.proven for name, pair in pairs(measured, "server").items()} == {
        "c0g0": None,
        "c0g1": False,
        "c0g6": None,
        "c1g0": True,
        "c2g3": True,
        "c3g0": True,
        "c3g4": True,
        "c4g5": False,
        "c5g0": None,
    }


def test_the_line_says_what_python_saw_and_native_code_is_heard(measured: DeskRun) -> None:
    """The reason is the picture that is None; native output without an exception is shown and matched beside it."""
    cell = measured.ran.cells("machine")["server"]
    tensor = pairs(measured, "server")["c1g0"].tensor

    assert cell["decisive"] == tensor.why == (
        "ContractViolation: camera image is None: get_camera_image_gpu_tensor() of environment 0"
    )  # fmt: skip
    buffer = "[Error] [carb.gym.plugin] cudaExternamMemoryGetMappedBuffer failed on {} buffer with error 101"
    assert tensor.native == (
        *(buffer.format(kind) for kind in ("rgbImage", "depthImage", "segmentationImage", "optical flow")),
        "*** Can't create empty tensor",
        "[Error] [carb.gym.plugin] Failed to fill rigid body state tensor",
    )
    named = [known["signature"] for known in cell["diagnoses"]]
    assert named[:3] == ["isaacgym-map-external-memory-101", "isaacgym-lavapipe", "isaacgym-import-external-memory-801"]
    assert named[3:] == ["isaacgym-camera-none-masking"]  # what is only printed hides nothing


def test_a_device_that_is_not_there_is_no_failure(measured: DeskRun) -> None:
    """A pair with a missing device is skipped, with the number of devices that its driver reports."""
    seen = pairs(measured, "server")

    assert seen["c5g0"].tensor.why == "no compute device 5: CUDA sees 5"
    assert seen["c0g6"].cpu.why == "no graphics device 6: Vulkan sees 6"


def test_devices_are_listed_with_their_equals(measured: DeskRun) -> None:
    """Each device is listed with its equals: from Mesa's software device on, Vulkan's numbers differ from CUDA's."""
    told = [case for case in measured.ran.cells("machine")["server"]["cases"] if case["case"] == "physics-c0"]

    assert told[0]["told"]["single.loop"] == {
        "compute": ["Stand-in GPU"] * 5,
        "graphics": ["Stand-in GPU", "llvmpipe (software)", *["Stand-in GPU"] * 4],
        "same": [0, 2, 3, 4, 5],
        "version": "1.0",
    }


def test_a_picture_is_the_same_by_both_ways(measured: DeskRun) -> None:
    """Bodies fall between the first and the last picture, which show the same whether left on the GPU or copied."""
    cell = measured.ran.cells("machine")["server"]
    frames = {case["case"]: [measured.desk.folder / name for name in case["frames"]] for case in cell["cases"]}
    (first, last), copied = (
        [numpy.asarray(Image.open(name)) for name in frames[f"c0g0-{way}"]] for way in ("tensor", "cpu")
    )

    assert not (first == last).all()
    assert ((first == copied[0]).all(), (last == copied[1]).all()) == (True, True)


def test_the_page_tells_every_pair(measured: DeskRun) -> None:
    """The page of the matrix shows classes, proof and what native code printed, from the document alone."""
    page = Path(__file__).parents[3] / "matrices" / "pages" / "isaac-gym.md.j2"
    document = msgspec.convert(measured.ran.document, Document)
    shown = author_pages.render(page.read_text(encoding="utf-8"), document, tables.report(document))

    assert "No NVIDIA software was run" not in shown
    assert "| 1 | 0 | error 101 | ok | proven | [Error] [carb.gym.plugin] cudaExternamMemoryGetMappedBuffer" in shown
    assert "| 0 | 1 | crash | crash | does not help | WARNING: lavapipe is not" in shown
    assert "| 0 | 0 | hang | ok | proven |" in shown
    assert "CUDA's 1 is Vulkan's 2" in shown


def test_the_stand_in_is_no_part_of_the_matrix(desk: Desk) -> None:
    """Without an archive the matrix of the harness is unavailable, and says what to do; nothing is resolved."""
    ran = desk.run("run", "isaac-gym", "--json", ISAACGYM_PATH="")
    page = (desk.state / "reports" / "isaac-gym" / "README.md").read_text(encoding="utf-8")

    assert [(cell["verdict"], cell["phases"]["resolve"]) for cell in ran.document["cells"]] == [
        ("unavailable", "unavailable")
    ] * 2
    told = "isaac-gym is not here, and ISAACGYM_PATH names no place of it: download Isaac Gym (Preview 4)"
    assert all(cell["decisive"].startswith(told) for cell in ran.document["cells"])
    assert "**No NVIDIA software was run for this page**" in page
