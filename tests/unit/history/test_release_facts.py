"""Facts of an unpacked release, by its files and by its source."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from harness.history import release_reader
from harness.history.release_reader import ReleaseFacts

SOURCES = {
    "toy/__init__.py": """
import numpy as np
from typing import TYPE_CHECKING, Any
from toy._private import Space, Hidden as Shown
if TYPE_CHECKING:
    from toy.heavy import Heavy
def make(name, *, render_mode=None): ...
""",
    "toy/_private.py": """
class Space:
    def sample(self, mask=None): ...
    def _draw(self): ...
class Hidden:
    def step(self, action): ...
class Unseen:
    def reset(self): ...
""",
    "toy/heavy.py": "class Heavy:\n    def lift(self): ...\n",
    "toy/lazy.py": "_NAMES = {'Heavy': 'toy.heavy'}\ndef __getattr__(name): ...\n",
    "toy/attached.py": "from lazy_loader import attach\n__getattr__, __dir__, __all__ = attach(__name__, ['Other'])\n",
    "toy/dynamic.py": "here = 1\nfor name in 'ab':\n    globals()[name] = name\n",
    "toy/tests/__init__.py": "",
    "toy/test.py": "def run(): ...\n",
    "toy/_vendor/six.py": "class Six: ...\n",
}


@pytest.fixture(autouse=True)
def without_git(monkeypatch: pytest.MonkeyPatch) -> None:
    """Griffe asks git about each package that it loads: here it is not installed."""

    def run(*_: object, **__: object) -> None:
        raise FileNotFoundError

    monkeypatch.setattr(subprocess, "run", run)


def read(folder: Path) -> ReleaseFacts:
    """Return what the release with these sources offers."""
    for name, source in SOURCES.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(source)
    return release_reader.read(folder, ("toy",))


def test_public_names_are_what_a_module_defines_or_hands_on(tmp_path: Path) -> None:
    """Names from other packages are kept apart; what type checkers alone import is not there."""
    facts = read(tmp_path)
    assert {"Space", "Shown", "make"} <= {*facts.names["toy"]}
    assert {"Heavy", "np", "Any"}.isdisjoint(facts.names["toy"])
    assert {"np", "Any"} <= {*facts.imported["toy"]}


def test_a_private_class_counts_where_a_public_module_hands_it_on(tmp_path: Path) -> None:
    """Private modules have no names of their own."""
    facts = read(tmp_path)
    assert "toy._private" not in facts.names
    assert facts.members["toy._private.Space"] == ("sample",)
    assert facts.signatures["toy._private.Hidden.step"] == "self, action"
    assert facts.signatures["toy.make"] == "name, *, render_mode="
    assert "toy._private.Unseen" not in facts.members
    assert "toy._private.Space._draw" not in facts.signatures


def test_a_lazy_module_has_the_names_in_its_texts(tmp_path: Path) -> None:
    """Its `__getattr__` may bring any of them; a module that makes names as it runs is marked."""
    facts = read(tmp_path)
    assert "Heavy" in facts.names["toy.lazy"]
    assert "Other" in facts.names["toy.attached"]
    assert facts.dynamic == ("toy.dynamic",)


def test_modules_are_all_but_tests_and_the_inside_of_copies(tmp_path: Path) -> None:
    """A module called `test` counts, a folder of tests does not."""
    modules = read(tmp_path).modules
    assert {"toy.test", "toy._private", "toy._vendor.six"} <= {*modules}
    assert "toy.tests" not in modules


def test_files_of_a_wheel_are_modules_where_they_get_installed(tmp_path: Path) -> None:
    """Machine code is marked, a library beside it is no module."""
    files = (
        "toy-1.0.data/purelib/extra.py", "toy/core.cpython-311-x86_64-linux-gnu.so", "toy/libtoy.so", "toy/__init__.py",
        "toy.libs/libgcc-1234.so.1", "tests/__init__.py", "setup.py", "toy/stub.pyi", "_hidden.py",
    )  # fmt: skip
    facts = release_reader.read_listing(tmp_path, files=files)
    assert facts.modules == ("extra", "toy", "toy.core")
    assert facts.natives == ("toy.core",)
