"""Detect the capabilities of this machine by examining the machine itself."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from harness.machine import display, process, this_machine

NO_DISPLAY = "no X display here: install Debian's xvfb and libgl1-mesa-dri, or run where DISPLAY names an X server"


@pytest.fixture(autouse=True)
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Examine the machine again in each test, with a cache of its own."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("DISPLAY", raising=False)
    this_machine.forget()
    yield
    this_machine.forget()


@pytest.fixture
def egl() -> None:
    """Skip the test if Mesa's EGL is missing."""
    if "egl" not in this_machine.facts().capabilities:
        pytest.skip("missing library: libegl1")


@pytest.fixture
def xvfb() -> None:
    """Skip the test if Xvfb, an X server without a screen, is missing."""
    if display.program() is None:
        pytest.skip("missing library: xvfb")


class TestFacts:
    def test_id_is_a_readable_class(self) -> None:
        """The id names system, architecture, C library and GL driver, and nothing that only this machine has."""
        found = this_machine.facts()

        assert re.fullmatch(r"linux-[a-z0-9_]+-[a-z]+[\d.]+(-[a-z0-9.]+)+", found.id)
        assert os.uname().nodename not in found.id
        assert found.facts["cpus"] >= 1
        assert found.facts["memory_mb"] > 100

    @pytest.mark.usefixtures("egl")
    def test_egl_tells_its_driver(self) -> None:
        """EGL is claimed only where a context was made, and the driver's own words are kept."""
        said = this_machine.facts().facts["egl"]

        assert set(said) == {"vendor", "renderer", "version"}
        assert all(said.values())

    def test_driver_that_is_not_there(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Without a driver there is no EGL, though the library loads, and the reason is kept."""
        monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere.json")

        found = this_machine.facts()

        assert "egl" not in found.capabilities
        assert set(found.facts["egl"]) == {"missing"}

    @pytest.mark.parametrize("variable", this_machine.VULKAN)
    def test_vulkan_driver_that_is_not_there(self, variable: str, monkeypatch: pytest.MonkeyPatch) -> None:
        """Without a Vulkan driver, or without Vulkan's library, nothing draws with it, and the reason is kept."""
        monkeypatch.setenv(variable, "/nowhere.json")

        found = this_machine.facts()

        assert "vulkan" not in found.capabilities
        assert found.facts["vulkan"]["missing"] in {"no libvulkan.so.1", "no driver makes a Vulkan instance"}
        assert (this_machine.describe_missing(("vulkan",)) or "").startswith("no Vulkan device here (no ")

    @pytest.mark.usefixtures("xvfb")
    def test_display_of_our_own_comes_first(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """The renderer of a display is found on a virtual display, even if the user has one."""
        monkeypatch.setenv("DISPLAY", ":4077")

        said = this_machine.facts().facts["display"]

        assert said["server"] == "virtual"
        assert said.keys() == {"server", "vendor", "renderer", "version"}

    @pytest.mark.usefixtures("xvfb")
    def test_the_user_s_own_display(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Without Xvfb the user's own display is used, with the user's cookie."""
        with display.open_display(_command(tmp_path, DISPLAY="virtual"), tmp_path / "display") as seen:
            for name in ("DISPLAY", "XAUTHORITY"):
                monkeypatch.setenv(name, seen.command.env[name])
            monkeypatch.setenv("PATH", str(tmp_path))

            found = this_machine.facts()

        assert found.facts["display"]["server"] == "own"
        assert this_machine.choose_variables({"MUJOCO_GL": "glfw"}) == {"DISPLAY": "own", "SDL_VIDEODRIVER": "dummy"}

    def test_display_that_does_not_answer(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """A DISPLAY at which no server answers is no display."""
        monkeypatch.setenv("DISPLAY", ":4077")
        monkeypatch.setenv("PATH", str(tmp_path))

        assert this_machine.facts().facts["display"] == {"missing": "no Xvfb, and nothing answers at DISPLAY=:4077"}

    def test_remembered_until_something_changes(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A second call starts no process (it would be refused here); another driver setting makes it examine again."""
        code = "from harness.machine import this_machine; print(this_machine.facts().id)"
        first = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

        monkeypatch.setenv(process.FORCED, "no such sandbox")
        again = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        monkeypatch.setenv("LIBGL_DRIVERS_PATH", "/nowhere")
        changed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)

        assert again.stdout == first.stdout
        assert "there is no 'no such sandbox'" in changed.stderr

    def test_broken_memory(self, tmp_path: Path) -> None:
        """A cache file that cannot be read is as good as none."""
        first = this_machine.facts()
        this_machine.forget()
        (tmp_path / "cache/machine.json").write_text("{")

        assert this_machine.facts() == first


class TestGpu:
    def test_from_the_driver(self, tmp_path: Path) -> None:
        """Models and version come from the driver's files."""
        cards = tmp_path / "proc/driver/nvidia/gpus"
        for number in range(2):
            (cards / f"0000:0{number}:00.0").mkdir(parents=True)
            (cards / f"0000:0{number}:00.0/information").write_text("Model: \t\t NVIDIA H200\nIRQ:   \t\t 18\n")
        (tmp_path / "proc/driver/nvidia/version").write_text(
            "NVRM version: NVIDIA UNIX Open Kernel Module for x86_64  570.86.15  Release Build\nGCC version:  12.2.0\n"
        )
        (tmp_path / "dev").mkdir()
        (tmp_path / "dev/nvidia0").touch()

        gpu, certain = this_machine.find_gpus(tmp_path)

        assert (gpu, certain) == ({"models": "NVIDIA H200, NVIDIA H200", "driver": "570.86.15"}, True)
        parts = {"egl": {"missing": "no libEGL"}, "osmesa": {"missing": "no libOSMesa.so.8"}, "gpu": gpu}
        assert this_machine.label(parts) == "nogl-nvidia-h200-driver570.86"

    @pytest.mark.parametrize(
        ("script", "expected"),
        [
            ("echo 'NVIDIA RTX A2000, 551.23'", {"models": "NVIDIA RTX A2000", "driver": "551.23"}),
            ("echo 'NVIDIA-SMI has failed, because'; exit 9", {"missing": "nvidia-smi names none"}),
        ],
    )
    def test_from_the_tool(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, expected: dict[str, str]
    ) -> None:
        """If the driver has no files, `nvidia-smi` is used; if that fails, no model is named."""
        tool = tmp_path / "nvidia-smi"
        tool.write_text(f"#!/bin/sh\n{script}\n")
        tool.chmod(0o755)
        monkeypatch.setenv("PATH", str(tmp_path))

        assert this_machine.find_gpus(tmp_path) == (expected, True)


@pytest.mark.parametrize(
    ("version", "renderer", "label"),
    [
        ("4.5 (Compatibility Profile) Mesa 22.3.6", "llvmpipe (LLVM 15.0.6, 256 bits)", "mesa22.3"),
        (
            "4.6 (Compatibility Profile) Mesa 25.2.0-devel",
            "Mesa Intel(R) UHD 620 (KBL)",
            "mesa25.2-mesa-intel-r-uhd-620-kbl",
        ),
        ("4.6.0 NVIDIA 570.86.15", "NVIDIA H200/PCIe/SSE2", "nvidia570.86"),
    ],
)
def test_gl_label(version: str, renderer: str, label: str) -> None:
    """The GL label has the driver, its minor version and the rendering hardware."""
    egl = {"vendor": "someone", "renderer": renderer, "version": version}
    parts = {"egl": egl, "osmesa": {"missing": "no libOSMesa.so.8"}, "gpu": {"missing": "no driver of NVIDIA's"}}

    assert this_machine.label(parts) == label


class TestSupplied:
    @pytest.mark.parametrize(
        ("given", "expected"),
        [
            ({}, {"MUJOCO_GL": "egl", "SDL_VIDEODRIVER": "dummy"}),
            ({"MUJOCO_GL": "glfw", "SDL_VIDEODRIVER": "x11", "DISPLAY": ":1"}, {}),
            ({"MUJOCO_GL": "", "SDL_VIDEODRIVER": "", "DISPLAY": ""}, {}),
            ({"MUJOCO_GL": "osmesa"}, {"PYOPENGL_PLATFORM": "osmesa", "SDL_VIDEODRIVER": "dummy"}),
            ({"MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": ""}, {"SDL_VIDEODRIVER": "dummy"}),
        ],
    )
    def test_with_egl(self, given: dict[str, str], expected: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
        """Variables for rendering are supplied, but never over a given value, not even an empty one."""
        _pretend_parts(monkeypatch, egl={}, display={"server": "virtual"})

        assert this_machine.choose_variables(given) == expected

    @pytest.mark.parametrize(
        ("given", "needs", "packages", "shown"),
        [
            ({"MUJOCO_GL": "glfw"}, (), {}, True),
            ({"MUJOCO_GL": "GLX"}, (), {}, True),
            ({"MUJOCO_GL": ""}, (), {}, True),
            ({"SDL_VIDEODRIVER": "x11"}, (), {}, True),
            ({"MUJOCO_GL": "egl"}, ("display",), {}, True),
            ({"MUJOCO_GL": "egl"}, (), {"pyglet": "1.5.27"}, True),
            ({"MUJOCO_GL": "egl"}, ("gpu",), {"pygame": "2.1.0"}, False),
            ({"MUJOCO_GL": "glfw", "DISPLAY": ""}, ("display",), {"pyglet": "1.5.27"}, False),
        ],
    )
    def test_a_display(
        self,
        given: dict[str, str],
        needs: tuple[str, ...],
        packages: dict[str, str],
        shown: bool,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        """A display is supplied if something draws on one, under a name that is the same on every machine."""
        _pretend_parts(monkeypatch, egl={}, display={"server": "virtual"})

        assert this_machine.choose_variables(given, needs, packages).get("DISPLAY") == ("virtual" if shown else None)

    def test_without_any(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """If nothing can render, no way of rendering is supplied."""
        _pretend_parts(monkeypatch)

        assert this_machine.choose_variables({"MUJOCO_GL": "glfw"}) == {"SDL_VIDEODRIVER": "dummy"}

    def test_with_a_display_alone(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Without EGL and OSMesa, MuJoCo draws on the display."""
        _pretend_parts(monkeypatch, display={"server": "virtual"})

        expected = {"MUJOCO_GL": "glfw", "SDL_VIDEODRIVER": "dummy", "DISPLAY": "virtual"}
        assert this_machine.choose_variables({}) == expected


class TestEnvironment:
    def test_is_an_allow_list(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A cell sees only those of the user's variables that it needs, and those that locate GL drivers."""
        monkeypatch.setattr(os, "environ", os.environ.copy())
        os.environ.clear()
        os.environ.update(
            {"PYTHONPATH": "/x", "LD_LIBRARY_PATH": "/x", "PIP_INDEX_URL": "x", "PATH": "/x", "LANG": "xx"}
        )
        os.environ.update({"CUDA_VISIBLE_DEVICES": "3", "DISPLAY": ":1", "LIBGL_DRIVERS_PATH": "/drivers"})
        os.environ["VK_ICD_FILENAMES"] = "/vulkan.json"
        always = {"PATH": this_machine.ENVIRONMENT["PATH"], "LANG": "C.UTF-8", "LIBGL_DRIVERS_PATH": "/drivers"}

        assert this_machine.base_environment() == always
        vulkan = {"VK_ICD_FILENAMES": "/vulkan.json"}
        assert this_machine.base_environment(("vulkan",)) == always | vulkan
        assert this_machine.base_environment(("gpu",)) == always | {"CUDA_VISIBLE_DEVICES": "3"} | vulkan
        assert this_machine.base_environment(("display",)) == always


class TestMissing:
    @pytest.mark.usefixtures("egl")
    def test_nothing(self) -> None:
        """A need that is met is not mentioned."""
        assert this_machine.describe_missing(()) is None
        assert this_machine.describe_missing(("egl",)) is None

    def test_says_why_and_what_to_do(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Each missing need is named with its reason and a remedy."""
        monkeypatch.setenv("PATH", str(tmp_path))
        monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nowhere.json")
        this_machine.forget()
        reason = this_machine.facts().facts["egl"]["missing"]

        assert this_machine.describe_missing(("display", "egl", "gpus")) == (
            "no X display here (no Xvfb): install Debian's xvfb and libgl1-mesa-dri, "
            "or run where DISPLAY names an X server; "
            f"no EGL here ({reason}): install Debian's libegl1 and libgl1-mesa-dri, or the GPU vendor's driver; "
            "unknown need 'gpus'; choose from egl, osmesa, display, glu, vulkan, gpu"
        )


@pytest.mark.parametrize(
    ("variables", "packages", "capabilities", "told"),
    [
        ({"MUJOCO_GL": "egl"}, {}, {"egl"}, {}),
        ({"MUJOCO_GL": "osmesa"}, {}, {"egl"}, {"": "no OSMesa here: install Debian's libosmesa6"}),
        ({"MUJOCO_GL": "glfw"}, {}, {"egl", "osmesa"}, {"": NO_DISPLAY}),
        ({"MUJOCO_GL": ""}, {}, {"egl", "osmesa"}, {"": NO_DISPLAY}),
        ({}, {}, {"egl"}, {}),
        ({}, {}, set(), {"": "no EGL here: install Debian's libegl1 and libgl1-mesa-dri, or the GPU vendor's driver"}),
        ({"MUJOCO_GL": "egl"}, {"pyglet": "1.5.27"}, {"egl", "glu"}, {"pyglet": NO_DISPLAY}),
        ({}, {"pyglet": "1.3.2"}, {"egl", "display"}, {"pyglet": "no GLU here: install Debian's libglu1-mesa"}),
        ({}, {"pyglet": "2.0.1"}, {"egl", "display"}, {}),
    ],
)
def test_a_missing_way_of_drawing_is_the_machines_fault(
    variables: dict[str, str],
    packages: dict[str, str],
    capabilities: set[str],
    told: dict[str, str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A way of drawing that the variables or the packages choose and the machine lacks is the machine's fault."""
    _pretend_parts(monkeypatch, **{name: {} for name in capabilities})

    assert this_machine.explain_undrawable(variables, packages) == told


def _pretend_parts(monkeypatch: pytest.MonkeyPatch, **parts: dict[str, str]) -> None:
    """Pretend that this machine has these parts and no other."""
    here = this_machine.Machine(id="here", facts=parts, capabilities=frozenset(parts))
    monkeypatch.setattr(this_machine, "facts", cache(lambda: here))


def _command(folder: Path, **variables: str) -> process.Command:
    return process.Command(
        argv=("/bin/true",),
        cwd=folder,
        env=variables,
        limits=process.Limits(seconds=20),
        log=folder / "log.txt",
        profile=process.Profile.HOST,
    )
