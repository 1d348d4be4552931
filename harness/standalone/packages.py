"""Read the packages of an interpreter from its folders, without running it."""

from __future__ import annotations

import os
import re
from typing import Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence

from .versions import canonical

PYTHON = re.compile(r"^(?:python|pypy)[\d.]*(?:\.exe)?$", re.IGNORECASE)
FOLDER = re.compile(r"^(?:python|pypy)(\d+\.\d+)$")
# Installers write the form with `exec` where the interpreter's path is too long for the kernel's first line.
SHEBANG = re.compile(rb"^#!\s*(\S+)(?:[ \t]+([^\r\n]*))?|^'''exec' \"?([^\"]+?)\"? \"\$0\"", re.MULTILINE)
RELEASE = re.compile(r"^version(?:_info)?\s*=\s*(\d+\.\d+(?:\.\d+)?)", re.MULTILINE)
READ = 4096


class Packages(NamedTuple):
    """The path of an interpreter, its version if that can be determined, and installed versions by name."""

    python: str
    version: Optional[str]
    installed: Dict[str, str]


def of_command(argv: Sequence[str], variables: Mapping[str, str], folder: str) -> Optional[Packages]:
    """Return the packages of the interpreter that a command runs; None if it cannot be determined."""
    # Wrappers may stand before the interpreter: `timeout 10 python train.py`, `env A=1 python`.
    for word in argv:
        python = _interpreter(word, variables, folder)
        if python:
            return of_interpreter(python, variables, folder)
    return None


def of_interpreter(python: str, variables: Mapping[str, str], folder: str = ".") -> Optional[Packages]:
    """Return the packages of an interpreter, or of an environment's folder; None if no interpreter lies there."""
    path = os.path.join(folder, os.path.expanduser(python))
    if os.path.isdir(path):
        names = (("bin", "python"), ("bin", "python3"), ("Scripts", "python.exe"), ("python.exe",))
        path = next((one for one in (os.path.join(path, *name) for name in names) if os.path.isfile(one)), path)
    path = _behind_shim(path, variables, folder)
    if not os.path.isfile(path):
        return None
    version, entries = _entries(path, variables)
    installed: Dict[str, str] = {}
    for entry in entries:
        for name, candidate in _distributions(entry):
            installed.setdefault(name, candidate)
    return Packages(path, version, installed)


def requirements_of(python: str, variables: Mapping[str, str], folder: str = ".") -> Dict[str, List[str]]:
    """Return what each package of an interpreter requires, as its metadata says."""
    requirements: Dict[str, List[str]] = {}
    _, entries = _entries(os.path.join(folder, python), variables)
    for entry in entries:
        for name, _, headers in _metadata(entry):
            if name not in requirements:
                requirements[name] = re.findall(r"^Requires-Dist:[ \t]*(\S[^\r\n]*)", headers, re.MULTILINE)
    return requirements


def _interpreter(word: str, variables: Mapping[str, str], folder: str) -> Optional[str]:
    """Return the interpreter that a word of a command line is, or that the first line of its script names."""
    path = _find_executable(word, variables, folder)
    if path is None or PYTHON.match(os.path.basename(path)):
        return path
    try:
        with open(path, "rb") as file:
            head = file.read(READ)
    except OSError:
        return None
    for shebang, rest, executed in SHEBANG.findall(head) if head.startswith(b"#!") else ():
        words = [os.fsdecode(one) for one in (executed, shebang, *rest.split()) if one]
        for part in words:
            if PYTHON.match(os.path.basename(part)):
                return _find_executable(part, variables, folder)
    return None


def _find_executable(word: str, variables: Mapping[str, str], folder: str) -> Optional[str]:
    """Return the file that a shell runs for a word; None if there is none."""
    if os.sep in word:
        path = os.path.join(folder, os.path.expanduser(word))
        return path if os.path.isfile(path) else None
    places = variables.get("PATH", os.defpath).split(os.pathsep)
    paths = (os.path.join(folder, place, word) for place in places if place)
    return next((path for path in paths if os.path.isfile(path) and os.access(path, os.X_OK)), None)


def _behind_shim(path: str, variables: Mapping[str, str], folder: str) -> str:
    """Return the interpreter that one of pyenv's shims starts here; other paths are returned unchanged."""
    place, name = os.path.split(path)
    root = os.path.dirname(place)
    if os.path.basename(place) != "shims" or not os.path.isdir(os.path.join(root, "versions")):
        return path
    chosen = variables.get("PYENV_VERSION") or _near(folder) or _text(os.path.join(root, "version"))
    for version in re.split(r"[:\s]+", chosen.strip()):
        interpreter = os.path.join(root, "versions", version, "bin", name)
        if version and os.path.isfile(interpreter):
            return interpreter
    return path


def _near(folder: str) -> str:
    here = os.path.abspath(folder)
    while True:
        content = _text(os.path.join(here, ".python-version"))
        if content or os.path.dirname(here) == here:
            return content
        here = os.path.dirname(here)


# --- where packages lie ----------------------------------------------------------------------------------------


def _entries(path: str, variables: Mapping[str, str]) -> "tuple[Optional[str], List[str]]":
    """Return the version of an interpreter, and the folders that it imports from, the first one first."""
    extra = [one for one in variables.get("PYTHONPATH", "").split(os.pathsep) if one]
    # Links are not followed here: `python` in an environment is a link to the base Python outside it.
    root = os.path.dirname(os.path.dirname(os.path.abspath(path)))
    settings = _text(os.path.join(root, "pyvenv.cfg")) or _text(os.path.join(os.path.dirname(path), "pyvenv.cfg"))
    match = RELEASE.search(settings)
    if settings:
        own = list(_folders(root, match.group(1) if match else None))
        shared = re.search(r"^include-system-site-packages\s*=\s*true", settings, re.MULTILINE | re.IGNORECASE)
        base = list(_base(os.path.realpath(path), variables)) if shared else []
        return match.group(1) if match else _version(own), [*extra, *own, *base]
    own = list(_base(os.path.realpath(path), variables))
    return _release(os.path.realpath(path)) or _version(own), [*extra, *own]


def _base(path: str, variables: Mapping[str, str]) -> Iterator[str]:
    """Yield the package folders of an interpreter outside environments: the user's own, its own, Debian's."""
    root = os.path.dirname(os.path.dirname(path))
    named = re.search(r"(\d+\.\d+)(?:\.exe)?$", os.path.basename(path))
    own = list(_folders(root, named.group(1) if named else None))
    minor = named.group(1) if named else _version(own)
    home = variables.get("HOME", os.path.expanduser("~"))
    if minor and not variables.get("PYTHONNOUSERSITE"):
        yield from _folders(os.path.join(home, ".local"), minor)
    if root == "/usr":
        yield from _folders("/usr/local", minor)
    yield from own
    yield from (one for one in [os.path.join(root, "lib", "python3", "dist-packages")] if os.path.isdir(one))


def _folders(root: str, version: Optional[str]) -> Iterator[str]:
    """Yield the folders of packages below a prefix; of this Python, if that is known."""
    minor = ".".join(version.split(".")[:2]) if version else None
    for library in ("lib", "lib64", "Lib"):
        place = os.path.join(root, library)
        inner = [os.path.join(place, name) for name in _names(place) if _fits(name, minor)]
        # On Windows (`Lib`) packages lie without a folder named after the version.
        for folder in [place, *inner] if library == "Lib" else inner:
            for kind in ("site-packages", "dist-packages"):
                path = os.path.join(folder, kind)
                # lib64 is often a link to lib, whose folders are listed already.
                if os.path.isdir(path) and not os.path.islink(place):
                    yield path


def _fits(name: str, minor: Optional[str]) -> bool:
    match = FOLDER.match(name)
    return bool(match) and (minor is None or match.group(1) == minor) if match else False


def _version(entries: Sequence[str]) -> Optional[str]:
    """Return the version that the folders of an interpreter are named after; None if they name several."""
    versions = {
        match.group(1)
        for entry in entries
        for match in [FOLDER.match(os.path.basename(os.path.dirname(entry)))]
        if match
    }
    return versions.pop() if len(versions) == 1 else None


def _release(path: str) -> Optional[str]:
    """Return the whole version, if a folder is named after it (pyenv, uv) or conda has noted it."""
    root = os.path.dirname(os.path.dirname(path))
    named = re.match(r"(?:c?python-)?(\d+\.\d+\.\d+)(?:-|$)", os.path.basename(root))
    notes = (re.match(r"python-(\d+\.\d+\.\d+)-", name) for name in _names(os.path.join(root, "conda-meta")))
    first_match = named or next((match for match in notes if match), None)
    return first_match.group(1) if first_match else None


# --- what lies there -------------------------------------------------------------------------------------------


def _distributions(entry: str) -> "Iterator[tuple[str, str]]":
    """Yield name and version of everything installed in a folder."""
    return ((name, version) for name, version, _ in _metadata(entry))


def _metadata(entry: str) -> "Iterator[tuple[str, str, str]]":
    """Yield name, version and the headers of the metadata of everything installed in a folder."""
    for name in sorted(_names(entry)):
        stem, dot, kind = name.rpartition(".")
        if kind not in {"dist-info", "egg-info"} or not dot:
            continue
        path = os.path.join(entry, name)
        file = path if os.path.isfile(path) else os.path.join(path, "METADATA" if kind == "dist-info" else "PKG-INFO")
        # The description below the headers may hold lines of the same form.
        headers = _text(file).partition("\n\n")[0]
        metadata = dict(re.findall(r"^(Name|Version):[ \t]*(\S+)", headers, re.MULTILINE))
        parts = stem.split("-")
        title, version = metadata.get("Name", parts[0]), metadata.get("Version", parts[1] if len(parts) > 1 else "")
        if version:
            yield canonical(title), version, headers


def _names(folder: str) -> List[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []


def _text(path: str) -> str:
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return file.read(200000)
    except OSError:
        return ""
