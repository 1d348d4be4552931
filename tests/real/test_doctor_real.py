"""`doctor` on environments of real packages that fail in known ways."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from uv import find_uv_bin

from harness.machine import interpreters

Make = Callable[..., Path]
AS_OF = "2026-11-20"


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Return a function that makes an environment of these requirements without the harness."""

    def make(python: str, *requirements: str) -> Path:
        found = interpreters.find(python)
        if found is None:
            pytest.skip(f"unavailable: python{python}")
        folder = tmp_path / "env"
        subprocess.run((find_uv_bin(), "venv", "-q", "--python", found.path, folder), check=True)
        install = ("pip", "install", "-q", "--python", folder, "--exclude-newer", AS_OF)
        if subprocess.run((find_uv_bin(), *install, *requirements), check=False).returncode:
            pytest.skip("unavailable: package index")
        return folder

    return make


def doctor_document(folder: Path, *arguments: str, **variables: str) -> dict[str, Any]:
    """Return the document of `doctor`, which must have changed nothing."""
    before = {path: path.lstat().st_mtime_ns for path in folder.rglob("*")}
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("MUJOCO", "PYOPENGL"))}
    argv = (sys.executable, "-m", "harness", "doctor", "--python", folder, "--json", *arguments)
    env = {**kept, "HARNESS_STATE": str(folder.parent / "state"), **variables}
    done = subprocess.run(argv, cwd=folder.parent, env=env, capture_output=True, text=True, check=False)
    assert {path: path.lstat().st_mtime_ns for path in folder.rglob("*")} == before
    assert done.returncode == 1, done.stderr
    return dict(json.loads(done.stdout))


def test_gym_beside_numpy_2(make: Make) -> None:
    """The first step fails in place; cause, remedy and a measured environment with numpy 1 are named."""
    made = doctor_document(make("3.11", "gym==0.26.2", "numpy==2.2.6"), "--env", "CartPole-v1")

    assert (
        made["decisive"]
        == "CartPole-v1 of gym 0.26.2: single failed: AttributeError: module 'numpy' has no attribute 'bool8'"
    )
    assert made["diagnoses"][0]["signature"] == "numpy2-bool8-gym-checker"
    assert [one["name"] for one in made["nearest"]["changes"]] == ["numpy"]
    assert made["nearest"]["changes"][0]["then"].startswith("1.")


def test_another_libmujoco(make: Make) -> None:
    """Another libmujoco on LD_LIBRARY_PATH is named, and so is the known failure of these versions in a window."""
    folder = make("3.10", "gymnasium[mujoco]==0.29.1", "mujoco==3.1.6", "numpy<2")
    (library,) = folder.glob("lib/python3.10/site-packages/mujoco/libmujoco.so.*")
    other = folder.parent / "lib"
    other.mkdir()
    shutil.copy(library, other)

    made = doctor_document(folder, LD_LIBRARY_PATH=str(other))

    (difference,) = made["differences"]
    assert (difference["kind"], difference["by"]) == ("libraries", ["LD_LIBRARY_PATH"])
    assert difference["as_it_is"] == str(other / library.name)
    assert "mujoco3-solver-iter" in [one["signature"] for one in made["lurking"]]
    assert {one["then"].partition(".")[0] for one in made["nearest"]["changes"] if one["name"] == "mujoco"} == {"2"}
