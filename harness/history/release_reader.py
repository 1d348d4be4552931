"""Read what one release of a package offers from its wheel or sdist. Nothing of it is run."""

from __future__ import annotations

import tarfile
import zipfile
from collections.abc import Iterable, Iterator
from email.parser import HeaderParser
from pathlib import Path
from typing import Any

import msgspec

from harness.history import module_names
from harness.history.module_names import PASSED_OVER, TESTS, VENDORED, PackageNames

NATIVE = (".so", ".pyd")
AT_THE_TOP = PASSED_OVER | {"build", "doc", "scripts", "setup", "test_utils", "tools"}
"""Names of top-level modules that got into a file by mistake, or that only its build uses."""


class ReleaseFacts(msgspec.Struct, frozen=True, kw_only=True):
    """The modules, names and requirements of one release.

    `modules` are the modules that can be imported; `names` the public names of each, those imported from elsewhere in
    the package too; `members` the public names in each class; `signatures` the parameters of each function and method
    by the path at which it is defined. `imported` are names that a module has from other packages. `natives` are
    modules of machine code, whose names only running tells, `dynamic` those of source that makes names as it runs.
    `failed` are packages that could not be read, with the reason.
    """

    modules: tuple[str, ...] = ()
    natives: tuple[str, ...] = ()
    dynamic: tuple[str, ...] = ()
    names: dict[str, tuple[str, ...]] = {}
    imported: dict[str, tuple[str, ...]] = {}
    members: dict[str, tuple[str, ...]] = {}
    signatures: dict[str, str] = {}
    requires: tuple[str, ...] = ()
    requires_python: str | None = None
    extras: tuple[str, ...] = ()
    entry_points: tuple[str, ...] = ()
    failed: dict[str, str] = {}


def is_source(member: str) -> bool:
    """Return whether a file of a wheel has names to read: source outside of tests and copies of other packages.

    A stub has none: a release that adds one for a module of machine code adds no names to it.
    """
    return member.endswith(".py") and (TESTS | VENDORED).isdisjoint(member.split("/")[:-1])


def is_metadata(member: str) -> bool:
    """Return whether a file of a wheel holds its metadata."""
    folder, _, name = member.partition("/")
    return folder.endswith(".dist-info") and name in {"METADATA", "entry_points.txt"}


def is_library(member: str) -> bool:
    """Return whether a file of a wheel is machine code, or a part of one."""
    return member.endswith(NATIVE) or ".so." in member


def unpack(archive: Path, folder: Path) -> None:
    """Unpack a wheel or an sdist into a folder; of an sdist without the folder that holds everything."""
    if archive.suffix in {".whl", ".zip"}:
        with zipfile.ZipFile(archive) as file:
            file.extractall(folder)
    else:
        with tarfile.open(archive) as tar:
            tar.extractall(folder, filter="data")
    inner = [path for path in folder.iterdir() if path.is_dir()]
    if archive.suffix != ".whl" and len(inner) == 1 and not (folder / "PKG-INFO").exists():
        moved = folder.with_name(f"{folder.name}-inner")
        inner[0].rename(moved)
        folder.rmdir()
        moved.rename(folder)


def read(folder: Path, imports: tuple[str, ...] = (), files: Iterable[str] | None = None) -> ReleaseFacts:
    """Return what the unpacked release in a folder offers.

    `imports` are its top-level modules if they are known, `files` all its files where only some are in the folder.
    """
    root, listed = source_root(folder), read_listing(folder, imports, files)
    offered, failed = PackageNames(), {}
    for top in sorted({module.partition(".")[0] for module in {*listed.modules} - {*listed.natives}}):
        try:
            more = module_names.read(root, top)
        except Exception as error:  # whatever a file holds, the others are read
            failed[top] = f"{type(error).__name__}: {error}"[:200]
            continue
        offered.dynamic += more.dynamic
        for field in ("names", "imported", "members", "signatures"):
            getattr(offered, field).update(getattr(more, field))
    return msgspec.structs.replace(listed, failed=failed, **msgspec.structs.asdict(offered))


def read_listing(folder: Path, imports: tuple[str, ...] = (), files: Iterable[str] | None = None) -> ReleaseFacts:
    """Return what the names of files and the metadata tell of an unpacked release; arguments are those of `read`."""
    modules, natives = set(), set()
    if files is None:
        root = source_root(folder)
        files = [path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()]
    for file in map(_installed, files):
        parts, native = _module(file)
        if not parts or (parts[0] not in imports if imports else parts[0].startswith("_") or parts[0] in AT_THE_TOP):
            continue
        if PASSED_OVER.isdisjoint(file.split("/")[:-1]) and VENDORED.isdisjoint(parts[:-2]) and parts[-1] != "conftest":
            modules.add(".".join(parts))
            if native:
                natives.add(".".join(parts))
    return ReleaseFacts(modules=tuple(sorted(modules)), natives=tuple(sorted(natives)), **_metadata(folder))


def _module(file: str) -> tuple[list[str], bool]:
    """Return the parts of the name by which a file is imported, none if it is not; and whether it is machine code."""
    *folders, name = file.split("/")
    stem, _, end = name.partition(".")
    native = name.endswith(NATIVE) and not (end == "so" and stem.startswith("lib"))
    parts = [*folders, *(() if stem == "__init__" else (stem,))]
    return (parts if (native or end == "py") and all(part.isidentifier() for part in parts) else []), native


def source_root(folder: Path) -> Path:
    """Return the folder below which the modules of an unpacked release lie."""
    src = folder / "src"
    return src if src.is_dir() and not (src / "__init__.py").exists() else folder


def _installed(file: str) -> str:
    """Return where a file of a wheel lies once it is installed."""
    top, _, rest = file.partition("/")
    return rest.partition("/")[2] if top.endswith(".data") and rest.startswith(("purelib/", "platlib/")) else file


# --- metadata --------------------------------------------------------------------------------------------------


def _metadata(folder: Path) -> dict[str, Any]:
    files = [*folder.glob("*.dist-info/METADATA"), *folder.glob("PKG-INFO"), *folder.glob("*.egg-info/PKG-INFO")]
    if not files:
        return {}
    head = HeaderParser().parsestr(files[0].read_text(encoding="utf-8", errors="replace"))
    requires = head.get_all("Requires-Dist") or _egg_requires(folder)
    return {
        "requires": tuple(requires),
        "requires_python": head.get("Requires-Python"),
        "extras": tuple(head.get_all("Provides-Extra") or ()),
        "entry_points": tuple(_entry_points(files[0].parent)),
    }


def _egg_requires(folder: Path) -> list[str]:
    """Return what an sdist's `requires.txt` asks for, as a wheel says it."""
    requires, section = [], ""
    for file in folder.glob("*.egg-info/requires.txt"):
        for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
            text = line.strip()
            if text.startswith("["):
                section = text.strip("[]")
            elif text:
                extra, _, marker = section.partition(":")
                both = [part for part in (f'extra == "{extra}"' if extra else "", marker) if part]
                requires.append(f"{text}; {' and '.join(both)}" if both else text)
    return requires


def _entry_points(folder: Path) -> Iterator[str]:
    file, group = folder / "entry_points.txt", ""
    for line in file.read_text(encoding="utf-8", errors="replace").splitlines() if file.is_file() else ():
        text = line.strip()
        if text.startswith("["):
            group = text.strip("[]")
        elif "=" in text:
            yield f"{group}: {text}"
