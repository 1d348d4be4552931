"""`doctor --env` makes and steps an environment in place; `--prove` tries the nearest known-good in a copy."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest
import wheelhouse
from commandline import Desk
from uv import find_uv_bin

from harness.model import Interpreter, replace

ENV = "fake_world:Healthy-v0"
CODE = (wheelhouse.FAKES / "healthy" / "fake_healthy.py").read_text()


@pytest.fixture
def shelf(desk: Desk) -> Desk:
    """Return a desk whose wheels have a `metaworld` that works, and a newer one whose first step fails."""
    own = desk.folder / "wheels"
    shutil.copytree(desk.wheels, own)
    broken = CODE.replace("self.steps += 1", "self.steps += numpy.no_such_name")
    for version, code in (("1.0", CODE), ("2.0", broken)):
        files = {"fake_world.py": code, "metaworld.py": "import fake_world\n"}
        wheelhouse.wheel(own, version, files, {"name": "metaworld", "requires": ["gymnasium"]})
    return replace(desk, wheels=own)


def environment(desk: Desk, host: Interpreter, *requirements: str) -> Path:
    """Return the folder of an environment of the user's own, made without the harness."""
    folder = desk.folder / "env"
    quiet = {name: value for name, value in os.environ.items() if not name.startswith("UV_")}
    uv = (find_uv_bin(), "--offline", "--no-config", "--cache-dir", str(desk.folder / "uv"))
    subprocess.run((*uv, "venv", "-q", "--python", host.path, str(folder)), env=quiet, check=True)
    found = ("--no-index", "--find-links", str(desk.wheels), "--python", str(folder))
    subprocess.run((*uv, "pip", "install", "-q", *found, *requirements), env=quiet, check=True)
    return folder


def test_an_environment_in_place(shelf: Desk, host: Interpreter) -> None:
    """`doctor --env` makes and steps an environment with the installed packages, and changes none of their files.

    The failure is the decisive line.
    """
    folder = environment(shelf, host, "metaworld==2.0")
    before = {path: path.lstat().st_mtime_ns for path in folder.rglob("*")}

    red = shelf.run("doctor", "--python", folder, "--env", ENV, "--json").document

    error = f"{ENV} of gymnasium 1.2.3: single failed: AttributeError: module 'numpy' has no attribute 'no_such_name'"
    assert (red["decisive"], red["tried"]["phases"]) == (error, {"import": "passed", "single": "failed"})
    assert {path: path.lstat().st_mtime_ns for path in folder.rglob("*")} == before


def test_the_changes_are_proven_in_a_copy(shelf: Desk, host: Interpreter) -> None:
    """The nearest combination measured here is proposed and proven in a copy; the original environment stays.

    The copy with the change works, and the one without it fails.
    """
    settings = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(shelf.wheels)}
    assert shelf.run("try", "metaworld==1.0", "--env", ENV, "--python", "host", **settings).code == 0
    folder = environment(shelf, host, "metaworld==2.0")
    before = {path: path.lstat().st_mtime_ns for path in folder.rglob("*")}

    made = shelf.run("doctor", "--python", folder, "--env", ENV, "--prove", "--json", **settings).document

    assert [(one["name"], one["now"], one["then"]) for one in made["nearest"]["changes"]] == [
        ("metaworld", "2.0", "1.0")
    ]
    assert (made["proof"]["proven"], made["proof"]["left_out"]) == (True, [])
    assert (made["proof"]["before"]["verdict"], made["proof"]["after"]["verdict"]) == ("broken", "works")
    assert {path: path.lstat().st_mtime_ns for path in folder.rglob("*")} == before
