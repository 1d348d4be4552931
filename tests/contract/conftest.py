"""Imports of the modules that run in cells."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import harness


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Any]:
    """Return an import of the modules that run in cells, as the bootstrap names them."""
    package = ModuleType("_simmatrix_cell")
    package.__path__ = [str(Path(harness.__file__).parent / "incell")]
    monkeypatch.setitem(sys.modules, "_simmatrix_cell", package)
    yield lambda name: importlib.import_module(f"_simmatrix_cell.{name}")
    for name in [name for name in sys.modules if name.startswith("_simmatrix_cell.")]:
        del sys.modules[name]
