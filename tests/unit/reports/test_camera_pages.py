"""Isaac Gym: what becomes of a camera, what native code prints, the stand-in's refusals, and the matrix itself."""

from __future__ import annotations

import importlib
import itertools
import json
import shutil
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import files
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from harness.judging.runs import native_errors
from harness.model import Outcome
from harness.model.report_types import CaseEntry
from harness.reports.text import camera_pages
from harness.reports.text.camera_pages import Pair, Seen, Way

ROOT = Path(__file__).parents[3]
STANDIN = ROOT / "tests" / "standins" / "isaacgym" / "python"
MAPPED = "[Error] [carb.gym.plugin] cudaExternamMemoryGetMappedBuffer failed on optical flow buffer with error 101"
IMPORTED = "[Error] [carb.gym.plugin] cudaImportExternalMemory failed on rgbImage buffer with error 999"
NONE = "ContractViolation: camera image is None: get_camera_image_gpu_tensor() of environment 0"


def case(outcome: Outcome, why: str = "", check: str = camera_pages.CHECK) -> CaseEntry:
    """Return a case whose import passed and whose check ended with this outcome."""
    checks = {"import.modules": Outcome.PASSED, check: outcome}
    reasons = {check: why} if why else {}
    return CaseEntry(
        case="c0g0-tensor", env=None, api="isaacgym", phases={}, checks=checks, frames=(), decisive=why, reasons=reasons
    )


@pytest.mark.parametrize(
    ("entry", "native", "expected"),
    [
        (case(Outcome.PASSED), (), "ok"),
        (case(Outcome.FAILED, NONE), (MAPPED,), "error 101"),
        (case(Outcome.FAILED, NONE), (IMPORTED, "*** Can't create empty tensor"), "error 999"),
        (case(Outcome.FAILED, NONE), ("[Error] [carb.windowing-glfw.plugin] GLFW initialization failed.",), "None"),
        (case(Outcome.FAILED, "ContractViolation: blank frame: every pixel is [0, 0, 0]"), (MAPPED,), "black"),
        (case(Outcome.FAILED, "ContractViolation: no camera: create_camera_sensor() returned -1"), (), "no camera"),
        (case(Outcome.FAILED, "RuntimeError: something else"), (MAPPED,), "another failure"),
        (case(Outcome.CRASHED, "killed by SIGSEGV"), (MAPPED,), "crash"),
        (case(Outcome.TIMED_OUT, "no end within 240 s"), (), "hang"),
        (case(Outcome.TIMED_OUT, "no end within 240 s", "import.modules"), (), "hang"),
        (case(Outcome.FAILED, "ImportError: libpython3.8.so.1.0", "import.modules"), (), "another failure"),
        (case(Outcome.SKIPPED, "no compute device 3: CUDA sees 1"), (), "no such device"),
        (case(Outcome.PASSED, check="import.modules"), (), "not told"),
        (case(Outcome.INFRA, "no room left on the disk"), (), "not told"),
        (case(Outcome.UNAVAILABLE, "no OpenGL"), (), "not told"),
    ],
)
def test_the_result_of_a_camera_in_a_word(entry: CaseEntry, native: tuple[str, ...], expected: str) -> None:
    """A picture, each way to have none, and what says nothing of the camera, are told apart."""
    assert str(camera_pages.classify_case(entry, native)) == expected


@pytest.mark.parametrize(
    ("tensor", "cpu", "proven"),
    [
        (Seen.OK, Seen.OK, None),
        (Seen.OK, Seen.CRASH, None),
        (Seen.ABSENT, Seen.ABSENT, None),
        (Seen.ERROR, Seen.OK, True),
        (Seen.HANG, Seen.OK, True),
        (Seen.ERROR, Seen.BLACK, False),
        (Seen.CRASH, Seen.UNTOLD, None),
        (Seen.UNTOLD, Seen.OK, None),
    ],
)
def test_a_workaround_is_proven_only_against_a_failure(tensor: Seen, cpu: Seen, proven: bool | None) -> None:
    """Only a picture where there was none proves it; where one side was not tried nothing is said."""
    assert Pair(compute=0, graphics=0, tensor=Way(seen=tensor), cpu=Way(seen=cpu)).proven is proven


def test_native_code_is_heard_among_other_output() -> None:
    """Its errors are lines of their own, each told once, at most ten of them."""
    tensor = "Failed to fill rigid body state tensor"
    log = f"Not connected to PVD\n{MAPPED}\n{MAPPED}\nphysics: [Error] no line of its own\n{tensor}\n"

    assert native_errors.errors(log) == (MAPPED, tensor)
    assert len(native_errors.errors("\n".join(f"[Error] [carb] number {n}" for n in range(50)))) == native_errors.MOST


# --- the stand-in ----------------------------------------------------------------------------------------------------


@pytest.fixture
def gymapi(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Yield the stand-in's API, imported from a folder that has the stubs."""
    package = Path(shutil.copytree(STANDIN, tmp_path / "python")) / "isaacgym"
    stubs = next(path for path in files("isaacgym-stubs") or () if path.name == "gymapi.pyi")
    shutil.copy(str(stubs.locate()), package / "gymapi.pyi")
    (package / "machine.json").write_text("{}")
    monkeypatch.syspath_prepend(tmp_path / "python")
    yield importlib.import_module("isaacgym.gymapi")
    for name in [name for name in sys.modules if name.partition(".")[0] == "isaacgym"]:
        del sys.modules[name]


def test_names_missing_in_the_stubs_are_refused(gymapi: ModuleType) -> None:
    """A name, a method, an attribute to be read or set, and arguments that do not fit."""
    gym, properties = gymapi.acquire_gym(), gymapi.CameraProperties()
    refused: list[tuple[Any, str]] = [
        (lambda: gymapi.UP_AXIS_W, "isaacgym.gymapi has no 'UP_AXIS_W' in the stubs"),
        (lambda: gym.render_cameras, "Gym has no 'render_cameras' in the stubs"),
        (lambda: properties.enable_tensor, "CameraProperties has no 'enable_tensor' in the stubs"),
        (lambda: setattr(properties, "hight", 3), "CameraProperties has no 'hight' in the stubs"),
        (lambda: gymapi.SimParams().physx.use_gpus, "PhysXParams has no 'use_gpus' in the stubs"),
        (gym.simulate, "simulate(arg0): called with 0 arguments and []"),
        (lambda: gym.create_sim(0, device=0), "create_sim(compute_device, graphics_device, type, params): called"),
        (lambda: gymapi.Vec3(1.0, 2.0, 3.0, 4.0), "__init__(x, y, z): called with 4 arguments and []"),
        (lambda: gym.create_viewer(1, properties), "the stand-in does not play Gym.create_viewer"),
    ]
    for use, message in refused:
        with pytest.raises((AttributeError, TypeError, NotImplementedError)) as caught:
            use()
        assert str(caught.value).startswith(message)


def test_only_what_is_documented_can_be_played(gymapi: ModuleType) -> None:
    """The stand-in cannot be given a method that the stubs do not have."""
    documented = importlib.import_module("isaacgym.documented")
    with pytest.raises(AttributeError, match="Gym has no 'render' in the stubs"):
        documented.played(gymapi.STUBS.classes["Gym"], {"render": print})


def test_pytorch_comes_after_isaac_gym(gymapi: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stand-in refuses to be imported after torch, in the words of Isaac Gym."""
    monkeypatch.setitem(sys.modules, "torch", ModuleType("torch"))
    del sys.modules["isaacgym.gymapi"]
    with pytest.raises(ImportError, match="PyTorch was imported before isaacgym modules"):
        importlib.import_module("isaacgym.gymapi")


def test_every_failure_that_is_played_names_its_source() -> None:
    """Each failure that the stand-in plays has its source and its report; the harness recognises each native line."""
    played = json.loads((STANDIN / "isaacgym" / "failures.json").read_text(encoding="utf-8"))
    printed = [
        line
        for failure in played.values()
        for way in ("tensor", "cpu")
        for lines in failure.get(way, {}).values()
        if isinstance(lines, list)
        for line in lines
    ]

    assert [name for name, failure in played.items() if not failure["source"].startswith("https://")] == []
    assert [name for name, failure in played.items() if not failure["says"] or "reported" not in failure] == []
    assert native_errors.errors("\n".join(printed)) == tuple(dict.fromkeys(printed))


# --- the matrix ------------------------------------------------------------------------------------------------------


def test_every_pair_of_devices_is_tried_both_ways() -> None:
    """Four by four devices, each way a case and so a process of its own, on devices that the case names."""
    table = tomllib.loads((ROOT / "matrices" / "isaac-gym.toml").read_text(encoding="utf-8"))
    found = {one["id"]: one["kwargs"] for one in table["cases"]}
    expected = {f"physics-c{compute}": {"compute_device": compute} for compute in range(4)}
    for compute, graphics, path in itertools.product(range(4), range(4), ("tensor", "cpu")):
        kwargs = {"compute_device": compute, "graphics_device": graphics, "path": path}
        expected[f"c{compute}g{graphics}-{path}"] = kwargs

    assert found == expected
    assert len(table["cases"]) == len(expected)
    assert (table["needs"], list(table["bring"])) == (["gpu"], ["isaac-gym"])
