"""Identify the OpenGL context of a cell by the libraries that the cell has already loaded."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from harness.machine import display, gl_probe, this_machine
from harness.machine.process import Command, Limits, Profile, run
from harness.probes import launch

ASKING = """
import importlib.util, json, os, sys

def loaded(path, name):
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module

def libraries():
    with open("/proc/self/maps") as file:
        return {line.split()[-1] for line in file if ".so" in line}

context = loaded(sys.argv[1], "context")
before = context.current_context()
made = loaded(sys.argv[2], "probe").WAYS[sys.argv[3]]() if sys.argv[3] else {}
before_asking = libraries()
told = [before, made, context.current_context()]
assert libraries() == before_asking
with open(sys.argv[4], "w") as file:
    json.dump(told, file)
os._exit(0)
"""


@pytest.fixture(autouse=True)
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use an empty cache, so that the machine is examined again."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))


def contexts(folder: Path, way: str) -> list[dict[str, str]]:
    """Return the context seen before a context is made in this way, its maker's facts, and the context seen after."""
    files = (str(launch.INCELL / "cell_opengl_context.py"), str(Path(gl_probe.__file__)))
    command = Command(
        argv=(sys.executable, "-I", "-c", ASKING, *files, way, str(folder / "told.json")),
        cwd=folder,
        env={**this_machine.base_environment(), "DISPLAY": "virtual" if way == "display" else ""},
        limits=Limits(seconds=60),
        log=folder / "log.txt",
        profile=Profile.HOST,
    )
    with display.open_display(command, folder / "display") as seen:
        done = run(seen.command)
    assert done.exit_code == 0, done.log.read_text()
    return list(json.loads((folder / "told.json").read_text()))


@pytest.mark.parametrize(
    ("way", "api", "package"),
    [("egl", "egl", "libegl1"), ("osmesa", "osmesa", "libosmesa6"), ("display", "glx", "xvfb")],
)
def test_the_current_context_is_described(tmp_path: Path, way: str, api: str, package: str) -> None:
    """Vendor, renderer and version are those of the new context; the library is named, and none is loaded."""
    if way not in this_machine.facts().capabilities:
        pytest.skip(f"missing library: {package}")

    before, made, told = contexts(tmp_path, way)

    device = {"device": told.get("device")} if way == "egl" else {}
    assert before == {}
    assert told == {"api": api, **made, **device}
    assert device != {"device": None}


def test_no_library(tmp_path: Path) -> None:
    """If nothing draws, no context is reported and no library is loaded."""
    assert contexts(tmp_path, "") == [{}, {}, {}]
