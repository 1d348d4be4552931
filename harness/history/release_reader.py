"""Read what one release of a package offers from its wheel or sdist. Nothing of it is run."""

from __future__ import annotations

import tarfile
import zipfile
from collections.abc import Iterator
from email.parser import HeaderParser
from pathlib import Path
from typing import Any

import msgspec

NATIVE = (".so", ".pyd")
PASSED_OVER = frozenset({"tests", "test", "testing", "conftest", "setup", "docs", "examples", "benchmarks", "_pytest"})
"""Names of modules that nobody who uses a package imports."""


class ReleaseFacts(msgspec.Struct, frozen=True, kw_only=True):
    """The modules, names and requirements of one release.

    `modules` are the modules that can be imported; `names` the public names of each, those imported from elsewhere in
    the package too; `members` the public names in each class; `signatures` the parameters of each function and method
    by the path at which it is defined. `natives` are modules of machine code, whose names only running tells.
    `failed` are packages that could not be read, with the reason.
    """

    modules: tuple[str, ...] = ()
    natives: tuple[str, ...] = ()
    names: dict[str, tuple[str, ...]] = {}
    members: dict[str, tuple[str, ...]] = {}
    signatures: dict[str, str] = {}
    requires: tuple[str, ...] = ()
    requires_python: str | None = None
    extras: tuple[str, ...] = ()
    entry_points: tuple[str, ...] = ()
    failed: dict[str, str] = {}


def unpack(archive: Path, folder: Path) -> None:
    """Unpack a wheel or an sdist into a folder; of an sdist without the folder that holds everything."""
    if archive.suffix in {".whl", ".zip", ".egg"}:
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


def read(folder: Path, imports: tuple[str, ...] = ()) -> ReleaseFacts:
    """Return what the unpacked release in a folder offers; `imports` are its top-level modules if they are known."""
    tops = [name for name in imports if _place(folder, name)] or [*_tops(folder)]
    modules, natives = _modules(folder, tops)
    names: dict[str, tuple[str, ...]] = {}
    members: dict[str, tuple[str, ...]] = {}
    signatures: dict[str, str] = {}
    failed = {}
    for top in tops:
        try:
            _read_package(_root(folder, top), top, names, members, signatures)
        except Exception as error:  # whatever a file holds, the others are read
            failed[top] = f"{type(error).__name__}: {error}"[:200]
    return ReleaseFacts(
        modules=tuple(sorted(modules)),
        natives=tuple(sorted(natives)),
        names=names,
        members=members,
        signatures=signatures,
        failed=failed,
        **_metadata(folder),
    )


# --- files -----------------------------------------------------------------------------------------------------


def _place(folder: Path, name: str) -> bool:
    return any((root / name).is_dir() or (root / f"{name}.py").is_file() for root in (folder, folder / "src"))


def _root(folder: Path, top: str) -> Path:
    src = folder / "src"
    return src if (src / top).is_dir() or (src / f"{top}.py").is_file() else folder


def _tops(folder: Path) -> Iterator[str]:
    """Yield the top-level packages and modules of an unpacked release."""
    for root in (folder, folder / "src"):
        for path in sorted(root.iterdir()) if root.is_dir() else ():
            name = path.name.partition(".")[0]
            if not name.isidentifier() or name in PASSED_OVER or name.startswith("_"):
                continue
            if (path.is_dir() and any(path.rglob("*.py"))) or path.suffix in {".py", *NATIVE}:
                yield name


def _modules(folder: Path, tops: list[str]) -> tuple[set[str], set[str]]:
    modules, natives = set(), set()
    for top in tops:
        root = _root(folder, top)
        for path in [*(root / top).rglob("*"), *root.glob(f"{top}.*")]:
            parts = path.relative_to(root).parts
            name = path.name.partition(".")[0]
            if path.suffix not in {".py", *NATIVE} or not all(part.isidentifier() for part in (*parts[:-1], name)):
                continue
            dotted = ".".join((*parts[:-1], *(() if name == "__init__" else (name,))))
            if PASSED_OVER.isdisjoint(dotted.split(".")[1:]):
                modules.add(dotted)
                if path.suffix in NATIVE:
                    natives.add(dotted)
    return modules, natives


# --- names -----------------------------------------------------------------------------------------------------


def _read_package(
    root: Path, top: str, names: dict[str, Any], members: dict[str, Any], signatures: dict[str, str]
) -> None:
    import griffe  # noqa: PLC0415 - only the maker of the history needs it

    module: Any = griffe.load(
        top, search_paths=[root], allow_inspection=False, resolve_aliases=True, find_stubs_package=False
    )
    waiting = [module]
    while waiting:
        place = waiting.pop()
        public = []
        for name, member in place.members.items():
            if member.is_alias:
                if not name.startswith("_") and _target(member).partition(".")[0] == top:
                    public.append(name)
                continue
            if member.is_module and not PASSED_OVER.intersection({name}):
                waiting.append(member)
            if member.is_function:
                signatures[member.path] = _parameters(member)
            if member.is_class:
                _read_class(member, members, signatures)
            if not name.startswith("_"):
                public.append(name)
        names[place.path] = tuple(sorted(public))


def _target(alias: Any) -> str:
    """Return the path that a name was imported from; empty where that is not to be found."""
    try:
        return str(alias.target_path)
    except Exception:  # an alias of a module that is not there raises an error of its own
        return ""


def _read_class(place: Any, members: dict[str, Any], signatures: dict[str, str]) -> None:
    public = []
    for name, member in place.members.items():
        if not name.startswith("_") or name in {"__init__", "__new__", "__call__"}:
            if not name.startswith("_"):
                public.append(name)
            if not member.is_alias and member.is_function:
                signatures[member.path] = _parameters(member)
        if not member.is_alias and member.is_class:
            _read_class(member, members, signatures)
    members[place.path] = tuple(sorted(public))


def _parameters(function: Any) -> str:
    """Return the parameters of a function as in its definition, without annotations; a default is `=`."""
    texts, star = [], False
    for place in function.parameters:
        kind = place.kind.value
        mark = {"variadic positional": "*", "variadic keyword": "**"}.get(kind, "")
        if kind == "keyword-only" and not star:
            texts.append("*")
            star = True
        star = star or mark == "*"
        texts.append(f"{mark}{place.name}{'=' if place.default is not None and not mark else ''}")
    return ", ".join(texts)


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
