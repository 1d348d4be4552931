"""What lies in an sdist: its source, unpacked safely, and what it asks to be built with."""

from __future__ import annotations

import tarfile
import tomllib
import zipfile
from dataclasses import dataclass
from email.parser import HeaderParser
from pathlib import Path

LEGACY_REQUIRES = ("setuptools>=40.8.0",)
LEGACY_BACKEND = "setuptools.build_meta:__legacy__"
"""What PEP 517 prescribes where pyproject.toml says nothing."""


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
    except (tarfile.TarError, zipfile.BadZipFile, EOFError) as error:
        why = str(error).partition("\n")[0].rstrip(":")
        message = f"{archive.name} cannot be unpacked: {why}"
        raise BadSdist(message) from None
    inside = [path for path in folder.iterdir() if path.is_dir()]
    if len(inside) != 1:
        message = f"{archive.name} is no sdist: it holds {len(inside)} folders where one is to be"
        raise BadSdist(message)
    return inside[0]


def build_system(source: Path) -> BuildSystem:
    """Read what builds the source. Raises BadSdist."""
    path = source / "pyproject.toml"
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8")).get("build-system") if path.exists() else None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        message = f"pyproject.toml cannot be read: {error}"
        raise BadSdist(message) from None
    if table is None:
        return BuildSystem()
    requires = table.get("requires")
    if not isinstance(requires, list) or not all(isinstance(line, str) for line in requires):
        message = "pyproject.toml: `build-system.requires` is not a list of requirements"
        raise BadSdist(message)
    return BuildSystem(
        requires=tuple(requires),
        backend=table.get("build-backend", LEGACY_BACKEND),
        backend_path=tuple(table.get("backend-path", ())),
    )


def requires_dist(wheel: Path) -> tuple[str, ...]:
    """Requirements in a wheel's own metadata, as they are written there, valid or not."""
    with zipfile.ZipFile(wheel) as file:
        name = next(name for name in file.namelist() if name.endswith(".dist-info/METADATA"))
        headers = HeaderParser().parsestr(file.read(name).decode("utf-8", "replace"))
    return tuple(str(value) for value in headers.get_all("Requires-Dist", ()))
