"""Locks that `recommend` hands out install with plain uv, also one that holds a patched wheel."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import uv

from harness.machine import interpreters

UV = uv.find_uv_bin()


@pytest.mark.parametrize(
    ("asked", "python", "said"),
    [
        (["gym==0.21.0", "--python", "3.9"], "3.9", "(4,)"),
        (["gymnasium==1.4.0", "mujoco", "--python", "3.11"], "3.11", "1.4.0"),
    ],
    ids=["patched wheel", "wheels of the index"],
)
def test_the_lock_installs(tmp_path: Path, asked: list[str], python: str, said: str) -> None:
    """The commands of the lock's own header make an environment in which the package runs."""
    found = interpreters.find(python)
    if found is None:
        pytest.skip(f"unavailable: python{python}")
    environment = {**os.environ, "HARNESS_STATE": str(tmp_path / "state"), "HARNESS_CACHE": str(tmp_path / "cache")}

    done = subprocess.run(
        [sys.executable, "-m", "harness", "recommend", *asked, "--lock-out", "lock.txt"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if "could not be had" in done.stderr:
        pytest.skip("unavailable: package index")
    assert done.returncode == 0, done.stderr

    header = [line for line in (tmp_path / "lock.txt").read_text().splitlines() if line.startswith("#")]
    (command,) = [line.partition("install: ")[2] for line in header if "install: " in line]
    plain = {name: value for name, value in os.environ.items() if not name.startswith(("VIRTUAL_ENV", "UV_PYTHON"))}
    plain["PATH"] = os.pathsep.join([str(Path(UV).parent), str(Path(found.path).parent), plain["PATH"]])
    installed = subprocess.run(
        command, shell=True, cwd=tmp_path, env=plain, capture_output=True, text=True, check=False
    )
    assert installed.returncode == 0, installed.stderr
    script = {
        "gym==0.21.0": "import gym; print(gym.make('CartPole-v1').reset().shape)",
        "gymnasium==1.4.0": "import gymnasium; print(gymnasium.__version__)",
    }[asked[0]]
    ran = subprocess.run(
        [tmp_path / ".venv/bin/python", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ran.stdout.splitlines()[-1:] == [said], ran.stderr
