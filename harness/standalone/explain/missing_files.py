"""Tell which package of Debian or conda-forge has a library, header or program that is missing."""

from __future__ import annotations

import gzip
import json
import re
from functools import lru_cache
from typing import Any, Dict, Iterator, NamedTuple, Optional, Tuple

from ..adapters import carried_file
from .api_history import PLACES

LIBRARY = re.compile(r"\b(lib[\w+-]+\.so(?:\.\d+)*): cannot open shared object file: No such file or directory")
HEADER = re.compile(r"fatal error: '?((?:[\w.+-]+/)*[\w.+-]+\.h(?:pp)?)'?(?:: | file not found)")
"""Compilers say the rest in the language of their user."""

LINKED = re.compile(r"\bld: cannot find -l([\w+-]+)")
PROGRAM = re.compile(
    r"(?:/bin/sh: (?:\d+: )?|bash: (?:line \d+: )?|^)([\w.+-]+): (?:command )?not found"
    r"|unable to execute '([\w.+-]+)': No such file or directory"
    r"|error: command '([\w.+-]+)' failed: No such file or directory"
    r"|FileNotFoundError: \[Errno 2\] No such file or directory: '([\w.+-]+)'$"
)

CONDA = {
    "libEGL.so": "libegl", "libGL.so": "libgl", "libGLX.so": "libglx", "libGLEW.so": "glew", "libGLU.so": "libglu",
    "libOSMesa.so": "mesalib", "libOpenGL.so": "libopengl", "libSM.so": "xorg-libsm", "libX11.so": "xorg-libx11",
    "libXext.so": "xorg-libxext", "libXrender.so": "xorg-libxrender", "libffi.so": "libffi", "libglfw.so": "glfw",
    "libgomp.so": "libgomp", "Python.h": "python", "libstdc++.so": "libstdcxx-ng", "libvulkan.so": "libvulkan-loader",
    "GL/glew.h": "glew", "GL/osmesa.h": "mesalib", "GLFW/glfw3.h": "glfw", "cmake": "cmake", "ffmpeg": "ffmpeg",
    "g++": "cxx-compiler", "gcc": "c-compiler", "ninja": "ninja", "patchelf": "patchelf", "swig": "swig",
}  # fmt: skip
"""Packages of conda-forge, by the library without its version, the header or the program."""


class MissingFile(NamedTuple):
    """A missing file, `kind` in words, and the packages that have it, or with `other` another version of it."""

    kind: str
    name: str
    debian: Optional[str]
    conda: Optional[str]
    other: bool


def find(line: str) -> Optional[MissingFile]:
    """Return the missing file that a line names, if a package is known that has it."""
    for kind, table, name in _named(line):
        stem = re.sub(r"\.so[\d.]*$", ".so", name)
        files = _tables().get(table, {})
        exact = files.get(name)
        debian = exact or _of_stem(files, stem) if table == "libraries" else exact
        conda = CONDA.get(stem)
        if debian or conda:
            return MissingFile(kind, name, debian, conda, exact is None and stem != name)
    return None


def _named(line: str) -> Iterator[Tuple[str, str, str]]:
    for kind, table, pattern in (
        ("library", "libraries", LIBRARY),
        ("library", "links", LINKED),
        ("header", "headers", HEADER),
        ("program", "programs", PROGRAM),
    ):
        match = pattern.search(line)
        if match:
            name = next(filter(None, match.groups()))
            yield kind, table, "lib{}.so".format(name) if table == "links" else name


def _of_stem(files: Dict[str, str], stem: str) -> Optional[str]:
    """Return the package that has a library in whatever version."""
    return next((files[name] for name in sorted(files) if name.startswith(stem + ".")), None)


@lru_cache(maxsize=None)
def _tables() -> Dict[str, Any]:
    contents = (carried_file("{}/debian-files.json.gz".format(place)) for place in PLACES)
    content = next((one for one in contents if one is not None), None)
    tables: Dict[str, Any] = json.loads(gzip.decompress(content).decode("utf-8")) if content else {}
    return tables
