"""The commands that install packages into an environment."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.standalone.installing import PIP, installer

PYTHON = "/e/bin/python"


@pytest.fixture
def with_uv(tmp_path: Path) -> dict[str, str]:
    """Return variables of a shell that finds uv."""
    (tmp_path / "uv").touch(mode=0o755)
    return {"PATH": str(tmp_path)}


def test_pip_where_it_is(with_uv: dict[str, str]) -> None:
    """An environment that has pip is served by it, whatever else is on PATH."""
    assert installer(PYTHON, {"pip", "gym"}, with_uv).installing(["numpy<2"]) == (f"{PYTHON} -m pip install 'numpy<2'",)


def test_uv_where_pip_is_missing(with_uv: dict[str, str]) -> None:
    """An environment without pip, as uv makes them, gets commands of uv."""
    found = installer(PYTHON, {"gym"}, with_uv)
    assert found.installing(["a", "b>1"]) == (f"uv pip install --python {PYTHON} a 'b>1'",)
    assert found.uninstalling(["gym"]) == (f"uv pip uninstall --python {PYTHON} gym",)


def test_neither_pip_nor_uv() -> None:
    """pip is brought first."""
    assert installer(PYTHON, {"gym"}, {"PATH": ""}).installing(["a"]) == (
        f"{PYTHON} -m ensurepip",
        f"{PYTHON} -m pip install a",
    )


def test_conda_brings_pip(tmp_path: Path) -> None:
    """An environment of conda's without pip is given it by conda."""
    (tmp_path / "conda-meta").mkdir()
    python = str(tmp_path / "bin" / "python")
    assert installer(python, {"gym"}, {"PATH": ""}).installing(["a"]) == (
        f"conda install --prefix {tmp_path} pip",
        f"{python} -m pip install a",
    )


def test_an_unknown_environment_is_taken_to_have_pip(with_uv: dict[str, str]) -> None:
    """Nothing says that it has none."""
    assert installer(None) == PIP
    assert installer(PYTHON, None, with_uv).install == f"{PYTHON} -m pip install"
