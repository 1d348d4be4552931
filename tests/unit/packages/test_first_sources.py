"""The list of sources that first runs need: its sections, and that it names what is here."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from harness.model.vocabulary import INCELL
from harness.packages.environments import first_sources

PYTHON = Path("/usr/bin/python3.11")


def test_only_the_sections_of_packages_that_are_there() -> None:
    """An environment without a simulator compiles nothing for it; what it does not have is left out."""
    there = {"lib/python3.11/site-packages/gymnasium/__init__.py", "/usr/lib/python3.11/enum.py"}
    assert first_sources.load(PYTHON, lambda name: name in there) == there
    assert first_sources.load(PYTHON, lambda name: name == "/usr/lib/python3.11/enum.py") == set()


def test_a_section_is_written_beside_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sources of the three places are written, whatever the interpreter; others are of no use elsewhere."""
    monkeypatch.setattr(first_sources, "FILE", tmp_path / "list")
    first_sources.FILE.write_text("[other]\nstandard/os.py\n[simulator]\npackages/gone.py\n")
    theirs = ("lib/python3.11/site-packages/simulator/a.py", "/x.py")
    first_sources.write("simulator", [(PYTHON, (*theirs, "/usr/lib/python3.11/re.py", f"{INCELL}/cell_run.py"))])
    assert first_sources.read() == {
        "other": ["standard/os.py"],
        "simulator": ["incell/cell_run.py", "packages/simulator/a.py", "standard/re.py"],
    }


def test_the_committed_list() -> None:
    """The sections name files of ours and of the standard library that there are, and those of the package."""
    standard = Path(sys.base_prefix, "lib", f"python{sys.version_info.major}.{sys.version_info.minor}")
    sections = first_sources.read()
    assert sections.keys() == {"gym", "gymnasium", "mujoco", "pybullet_data", "robosuite"}
    for package, lines in sections.items():
        assert package == "pybullet_data" or f"packages/{package}/__init__.py" in lines
        assert [line for line in lines if line.startswith("incell/") and not (INCELL.parent / line).is_file()] == []
        named = [line.removeprefix("standard/") for line in lines if line.startswith("standard/")]
        assert sum((standard / name).is_file() for name in named) > len(named) * 2 // 3
