"""Read an sdist: unpack its source safely, and find what it asks to be built with."""

from __future__ import annotations

import tarfile
import tomllib
import zipfile
from dataclasses import dataclass
from email.parser import HeaderParser
from pathlib import Path

from harness.machine.files import guarded_files
from harness.model.errors import in_the_way
from harness.model.hostile_data import Absent, Unreadable, raise_unreadable

LEGACY_REQUIRES = ("setuptools>=40.8.0",)
LEGACY_BACKEND = "setuptools.build_meta:__legacy__"
"""What PEP 517 prescribes where pyproject.toml says nothing."""


MOST = 16 << 20
"""Bytes of a pyproject.toml."""


class BadSdist(Exception):
    """The sdist cannot be built, whoever tries: it cannot be unpacked, or its pyproject.toml cannot be read."""


@dataclass(frozen=True, kw_only=True, slots=True)
class BuildSystem:
    """The `build-system` table: requirements, backend, folders in the source that hold the backend."""

    requires: tuple[str, ...] = LEGACY_REQUIRES
    backend: str = LEGACY_BACKEND
    backend_path: tuple[str, ...] = ()


def unpack(archive: Path, folder: Path) -> Path:
    """Unpack below `folder`, never outside it; returns the one folder that an sdist holds. Raises BadSdist."""
    folder.mkdir(parents=True)
    try:
        if archive.suffix == ".zip":
            with zipfile.ZipFile(archive) as file:
                file.extractall(folder)
        else:
            with tarfile.open(archive) as tar:
                tar.extractall(folder, filter="data")
    except Exception as error:
        if in_the_way(error):  # a full disk says nothing of the archive
            raise
        why = str(error).partition("\n")[0].rstrip(":")
        message = f"{archive.name} cannot be unpacked: {why}"
        raise BadSdist(message) from None
    inside = [path for path in folder.iterdir() if path.is_dir()]
    if len(inside) != 1:
        message = f"{archive.name} is no sdist: it holds {len(inside)} folders where one is to be"
        raise BadSdist(message)
    return inside[0]


def build_system(source: Path) -> BuildSystem:
    """Read the `build-system` table of the source, or the legacy default if it has none. Raises BadSdist."""
    file = source / "pyproject.toml"
    try:
        content = guarded_files.text(file, MOST, follow=True)
        with raise_unreadable():
            table = tomllib.loads(content).get("build-system")
    except Absent:
        table = None
    except Unreadable as error:
        message = f"pyproject.toml cannot be read: {error}"
        raise BadSdist(message) from None
    if table is None:
        return BuildSystem()
    if not isinstance(table, dict):
        message = "pyproject.toml: `build-system` is not a table"
        raise BadSdist(message)
    backend = table.get("build-backend", LEGACY_BACKEND)
    if not isinstance(backend, str):
        message = "pyproject.toml: `build-system.build-backend` is not a string"
        raise BadSdist(message)
    requires, path = table.get("requires"), table.get("backend-path", [])
    return BuildSystem(
        requires=_texts(requires, "`build-system.requires` is not a list of requirements"),
        backend=backend,
        backend_path=_texts(path, "`build-system.backend-path` is not a list of folders"),
    )


def _texts(plain: object, wrong: str) -> tuple[str, ...]:
    if not isinstance(plain, list) or not all(isinstance(line, str) for line in plain):
        message = f"pyproject.toml: {wrong}"
        raise BadSdist(message)
    return tuple(plain)


def requires_dist(wheel: Path) -> tuple[str, ...]:
    """Return the requirements in a wheel's own metadata as they are written there, valid or not."""
    with zipfile.ZipFile(wheel) as archive:
        headers = HeaderParser().parsestr(about_wheel(archive, "METADATA"))
    return tuple(str(value) for value in headers.get_all("Requires-Dist", ()))


def about_wheel(archive: zipfile.ZipFile, name: str) -> str:
    """Return the text of a file in a wheel's `.dist-info` folder. Raises KeyError if there is none."""
    suffix = f".dist-info/{name}"
    place = next((entry for entry in archive.namelist() if entry.endswith(suffix) and entry.count("/") == 1), None)
    if place is None:
        message = f"it holds no {name}"
        raise KeyError(message)
    # Old tools wrote Latin-1 here, which must not end the run.
    return archive.read(place).decode("utf-8", "replace")
