"""Test `doctor`, and the program that looks at an environment for it, under every Python from 3.7 to 3.14."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

import harness
from harness.machine import interpreters

STANDALONE = Path(harness.__file__).parent / "standalone"
SUPPORTED = ("3.7", "3.8", "3.9", "3.10", "3.11", "3.12", "3.13", "3.14")
DOCTOR = """
import json, os, sys
sys.path.insert(0, {folder!r})
from alone import running
from alone.doctor import doctor
known = doctor.Knowledge([], lambda: {{"cells": [], "locks": {{}}}})
made = doctor.document(doctor.Request({python!r}, None, dict(os.environ), os.getcwd()), running.run, known)
print(json.dumps([made["environment"]["version"], doctor.code(made), list(doctor.lines(made, str))]))
"""


def bare(version: str, folder: Path) -> Path:
    """Create an empty environment of this Python; return its interpreter."""
    found = interpreters.find(version)
    if found is None:
        pytest.skip(f"unavailable: python{version}")
    subprocess.run((found.path, "-m", "venv", "--without-pip", folder), check=True)
    return folder / "bin" / "python"


@pytest.mark.parametrize("version", SUPPORTED)
def test_looks(version: str, tmp_path: Path) -> None:
    """Facts come as one document on stdout, whatever `site` is worth; nothing of ours lies on the path."""
    python = bare(version, tmp_path / "env")

    for flags in ((), ("-I", "-S")):
        argv = (python, "-B", *flags, STANDALONE / "doctor" / "describe_environment.py")
        told = json.loads(subprocess.run(argv, capture_output=True, text=True, check=True, cwd=tmp_path).stdout)

        assert told["python"]["version"].startswith(version)
        assert (told["errors"], told["hidden"], told["distributions"]) == ([], [], [])
        assert not any("standalone" in entry for entry in told["path"])
        assert any(entry.endswith("site-packages") for entry in told["path"])


@pytest.mark.parametrize("version", SUPPORTED)
def test_imports(version: str, tmp_path: Path) -> None:
    """Every import is told when it starts and when it has ended; the working folder comes first."""
    python = bare(version, tmp_path / "env")
    (tmp_path / "mine.py").write_text("__version__ = '7'\n")
    target = tmp_path / "told"

    argv = (python, "-B", STANDALONE / "doctor" / "import_modules.py", target, "30", "mine", "json", "no_such_thing")
    subprocess.run(argv, check=True, cwd=tmp_path)

    told = [json.loads(line) for line in target.read_text().splitlines()]
    assert [(one["module"], one["started"]) for one in told[::2]] == [
        ("mine", True),
        ("json", True),
        ("no_such_thing", True),
    ]
    assert (told[1]["file"], told[1]["version"], told[1]["error"]) == (str(tmp_path / "mine.py"), "7", None)
    assert told[5]["error"] == "ModuleNotFoundError: No module named 'no_such_thing'"
    assert "Traceback" in told[5]["traceback"]


@pytest.mark.parametrize("version", SUPPORTED)
def test_doctor(version: str, tmp_path: Path) -> None:
    """The whole of it runs where no harness is, and finds nothing wrong with an environment of nothing."""
    python = bare(version, tmp_path / "env")
    shutil.copytree(STANDALONE, tmp_path / "alone", ignore=shutil.ignore_patterns("__pycache__"))

    script = DOCTOR.format(folder=str(tmp_path), python=str(python))
    done = subprocess.run((python, "-c", script), capture_output=True, text=True, check=False, cwd=tmp_path)

    assert done.stderr == ""
    found, code, lines = json.loads(done.stdout)
    assert (found.startswith(version), code) == (True, 0)
    assert lines[0] == f"{python} (Python {found}), named by --python"
