"""Combinations as tools take them: commands, `environment.yml`, `pyproject.toml`, a Dockerfile."""

from __future__ import annotations

import shlex
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from harness.reports.answers.recommending import Combination
from harness.reports.install_texts import environment_files, install_commands

LOCK = "".join(
    f"{pin} \\\n    --hash=sha256:{'1' * 64}\n" for pin in ("gymnasium==1.4.0", "numpy==2.4.6", "torch==2.13.0+cpu")
)
DEBIAN = "Debian GNU/Linux 12 (bookworm)"


def combination(**more: Any) -> Combination:
    """Return a combination on Python 3.11 that sets MUJOCO_GL."""
    usual = {
        "versions": {"gymnasium": "1.4.0"}, "pythons": ["3.11.7"], "machines": ["here"], "measured": "2026-11-23",
        "cells": ["m/a"], "beside": {}, "cell": "m/a", "machine": "here", "python": "3.11.7", "phases": {},
        "unverified": [], "environments": ["Ant-v5"], "settings": {"MUJOCO_GL": "egl"}, "repaired": [], "brought": [],
        "lock_sha256": "", "lock": LOCK, "requirements": ["gymnasium[mujoco]==1.4.0", "torch==2.13.0"],
    }  # fmt: skip
    return msgspec.convert(usual | more, Combination)


def test_commands_quote_and_say_what_to_set() -> None:
    """Extras are quoted for the shell; Python and variables follow as a comment."""
    assert install_commands.command(combination()) == (
        "pip install 'gymnasium[mujoco]==1.4.0' torch==2.13.0  # Python 3.11, MUJOCO_GL=egl"
    )
    assert install_commands.command(combination(), "uv") == (
        "uv venv --python 3.11 && uv pip install 'gymnasium[mujoco]==1.4.0' torch==2.13.0  # Python 3.11, MUJOCO_GL=egl"
    )
    assert shlex.split(install_commands.command(combination()), comments=True)[2] == "gymnasium[mujoco]==1.4.0"


def test_a_display_is_no_variable() -> None:
    """`virtual` is our own word: it is said in words, and set nowhere; an empty variable is to be unset."""
    drawn = combination(settings={"DISPLAY": "virtual", "MUJOCO_GL": ""})

    assert install_commands.command(drawn).endswith("  # Python 3.11, MUJOCO_GL unset, a display")
    assert "virtual" not in environment_files.dockerfile(drawn, "", DEBIAN)
    assert "xvfb" in environment_files.dockerfile(drawn, "", DEBIAN)


def test_a_patched_wheel_is_written_with_its_lock() -> None:
    """No index has it, so the command writes the lock and the wheel."""
    repaired = combination(repaired=["gym 0.21.0"], versions={"gym": "0.21.0"})

    assert install_commands.command(repaired).startswith(
        "simmatrix recommend gym==0.21.0 --python 3.11 --lock-out requirements.txt  # Python 3.11"
    )


def test_conda_has_every_pin() -> None:
    """Python from conda, all packages of the lock by pip, the extras that were asked for, the variables."""
    read = yaml.safe_load(environment_files.conda(combination(), "# head\n"))

    python, pip, below = read["dependencies"]
    assert (python, pip) == ("python=3.11", "pip")
    assert below == {"pip": ["gymnasium[mujoco]==1.4.0", "numpy==2.4.6", "torch==2.13.0"]}
    assert read["variables"] == {"MUJOCO_GL": "egl"}


def test_a_project_declares_the_named_ones() -> None:
    """Requirements as they are pasted, for this minor version of Python alone."""
    project = tomllib.loads(environment_files.pyproject(combination(), "# head\n"))["project"]

    assert project["dependencies"] == ["gymnasium[mujoco]==1.4.0", "torch==2.13.0"]
    assert project["requires-python"] == "==3.11.*"


@pytest.mark.parametrize(
    ("more", "packages"),
    [
        ({}, ["libegl1", "libgl1", "libgl1-mesa-dri"]),
        ({"settings": {}, "drawn": ["osmesa"]}, ["libgl1", "libosmesa6"]),
        ({"settings": {}}, []),
        ({"settings": {}, "lock": LOCK.replace("torch", "opencv-python")}, ["libgl1", "libglib2.0-0"]),
    ],
    ids=["MUJOCO_GL", "drawn", "nothing drawn", "a package that loads them"],
)
def test_debian_packages_that_drawing_needs(more: dict[str, Any], packages: list[str]) -> None:
    """By the way in which it was drawn, and by what its packages load."""
    assert environment_files.debian_packages(combination(**more)) == packages


def test_a_dockerfile_installs_by_versions_or_by_the_lock() -> None:
    """Without a lock every pin is named; with one it is copied, with the folder of its patched wheels."""
    plain = environment_files.dockerfile(combination(), "# head\n", DEBIAN)
    locked = environment_files.dockerfile(combination(), "", DEBIAN, Path("some/lock.txt"))
    patched = environment_files.dockerfile(combination(repaired=["gym 0.21.0"]), "", "", Path("lock.txt"))

    assert plain.startswith("# head\nFROM python:3.11-slim-bookworm\nRUN apt-get update ")
    assert '\nENV MUJOCO_GL="egl"\n' in plain
    assert plain.endswith(
        "RUN pip install --no-cache-dir \\\n    'gymnasium[mujoco]==1.4.0' \\\n    numpy==2.4.6 \\\n    torch==2.13.0\n"
    )
    assert locked.endswith(
        'COPY ["lock.txt", "/tmp/"]\nRUN pip install --no-cache-dir --no-deps --require-hashes -r /tmp/lock.txt\n'
    )
    assert patched.startswith("FROM python:3.11-slim\n")
    assert 'COPY ["lock-wheels", "/tmp/lock-wheels"]\n' in patched
    assert "--require-hashes --find-links /tmp/lock-wheels -r /tmp/lock.txt\n" in patched
