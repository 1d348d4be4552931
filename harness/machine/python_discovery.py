"""Find the places of Pythons on this machine with `findpython`; keep them as long as nothing it looked at changes."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec

from harness.machine.files import guarded_files
from harness.machine.store import cache_folder, write_atomic

VARIABLES = (
    "PATH", "HOME", "XDG_DATA_HOME", "PYENV_ROOT", "ASDF_DATA_DIR", "RYE_PY_ROOT", "UV_PYTHON_INSTALL_DIR",
)  # fmt: skip
"""By these `findpython` finds its folders."""


class _Discovery(msgspec.Struct, frozen=True):
    """Executables and their real paths, found under these marks."""

    marks: list[str]
    pythons: dict[str, str]


def candidates(managed: Path) -> tuple[Path, ...]:
    """Return the real paths of files that look like a Python 3, none of them started; `managed` is our uv folder."""
    memory, marks = cache_folder() / "candidates.json", _marks(managed)
    discovery = guarded_files.load(memory, _Discovery)
    # A link can lead elsewhere while the folder that holds it stays unchanged.
    if (
        discovery is None
        or discovery.marks != marks
        or any(os.path.realpath(at) != real for at, real in discovery.pythons.items())
    ):
        discovery = _Discovery(marks=marks, pythons=dict(_discovered(managed)))
        write_atomic(memory, msgspec.json.encode(discovery))
    return (Path(sys.executable), *map(Path, discovery.pythons.values()))


def _marks(managed: Path) -> list[str]:
    """Return marks that change whenever a Python comes or goes: variables, and the folders that `findpython` lists."""
    listed = [Path(folder).absolute() for folder in os.environ.get("PATH", "").split(os.pathsep) if folder]
    for root in (*_roots(), managed):
        folders = sorted(folder for folder in root.iterdir() if folder.is_dir()) if root.is_dir() else []
        # `bin` has a mark of its own: a long build makes the folder of a version well before its Python.
        inner = [place for folder in folders for place in (folder, folder / "bin", folder / "install/bin")]
        listed += [root, *inner]
    return [
        *(f"{name}={os.environ.get(name)}" for name in VARIABLES),
        *(f"{folder} {_changed(folder)}" for folder in listed),
    ]


def _roots() -> Iterator[Path]:
    """Yield folders with a folder for each Python, as the providers of `findpython` know them."""
    data = os.environ.get("XDG_DATA_HOME") or "~/.local/share"
    for name, usual, inside in (
        ("PYENV_ROOT", "~/.pyenv", "versions"),
        ("ASDF_DATA_DIR", "~/.asdf", "installs/python"),
        ("RYE_PY_ROOT", "~/.rye/py", ""),
        ("UV_PYTHON_INSTALL_DIR", f"{data}/uv/python", ""),
    ):
        yield Path(os.path.expandvars(os.environ.get(name, usual))).expanduser() / inside


def _changed(folder: Path) -> int | None:
    try:
        return folder.stat().st_mtime_ns
    except OSError:
        return None


def _discovered(managed: Path) -> Iterator[tuple[str, str]]:
    from findpython import Finder  # noqa: PLC0415 - start-up
    from findpython.providers.uv import UvProvider  # noqa: PLC0415 - start-up

    providers = [*Finder().setup_providers(), UvProvider(managed)]
    seen = set()
    for python in (python for provider in providers for python in provider.find_pythons()):
        real = python.executable.resolve()
        if real not in seen and not real.name.startswith(("python2", "pypy2")) and not _is_shim(python.executable):
            seen.add(real)
            yield str(python.executable), str(real)


def _is_shim(path: Path) -> bool:
    """Return whether this is a shim of pyenv or asdf: a script that refuses versions not switched on.

    findpython lists the Pythons behind such scripts.
    """
    if path.parent.name != "shims":
        return False
    with path.open("rb") as file:
        return file.read(2) == b"#!"
