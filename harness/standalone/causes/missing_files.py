"""Tell which package has a library, header or program that is missing, or which module is another file than meant."""

from __future__ import annotations

import gzip
import json
import re
from functools import lru_cache
from typing import Any, Dict, Iterator, NamedTuple, Optional, Tuple

from ..adapters import carried_file
from ..explain.api_history import PLACES
from .api_causes import ATTRIBUTE, places_of
from .scene import Cause, Causes, Pattern, Scene, requirement_remedy

LIBRARY = Pattern(
    r"\b(lib[\w+-]+\.so(?:\.\d+)*)\W*(?:: )?(?:cannot open shared object file|not found|No such file|\(no such file)"
    r"|(?:[Ll]ibrary|load|find) [`'\"]?(lib[\w+-]+\.so(?:\.\d+)*)|Library \"(\w+)\" not found",
    ".so", "Library ",
)  # fmt: skip
HEADER = Pattern(
    r"fatal error: '?((?:[\w.+-]+/)*[\w.+-]+\.h(?:pp)?)'?(?:: | file not found)|The '([\w/]+\.h)' .*are missing",
    "fatal error: ", "are missing",
)  # fmt: skip
"""Compilers say the rest in the language of their user."""

LINKED = Pattern(r"cannot find -l([\w+-]+)|library not found for -l([\w+-]+)", " -l")
PROGRAM = Pattern(
    r"(?:/bin/sh: (?:\d+: )?|bash: (?:line \d+: )?|zsh: |^)([\w.+-]+): (?:command )?not found"
    r"|unable to execute '([\w.+-]+)': No such file or directory"
    r"|error: command '([\w.+-]+)' failed: No such file or directory"
    r"|FileNotFoundError: \[Errno 2\] No such file or directory: '([\w.+-]+)'$",
    "not found", "No such file or directory",
)  # fmt: skip
ERROR = re.compile(r"[Ee]rror|rror:|not found|[Nn]o such file|cannot|[Cc]ould not|[Uu]nable|[Ff]ail|missing")

CONDA = {
    "libEGL.so": "libegl", "libGL.so": "libgl", "libGLX.so": "libglx", "libGLEW.so": "glew", "libGLU.so": "libglu",
    "libOSMesa.so": "mesalib", "libOpenGL.so": "libopengl", "libSM.so": "xorg-libsm", "libX11.so": "xorg-libx11",
    "libXext.so": "xorg-libxext", "libXrender.so": "xorg-libxrender", "libffi.so": "libffi", "libglfw.so": "glfw",
    "libgomp.so": "libgomp", "Python.h": "python", "libstdc++.so": "libstdcxx-ng", "libvulkan.so": "libvulkan-loader",
    "GL/glew.h": "glew", "GL/osmesa.h": "mesalib", "GLFW/glfw3.h": "glfw", "cmake": "cmake", "ffmpeg": "ffmpeg",
    "g++": "cxx-compiler", "gcc": "c-compiler", "ninja": "ninja", "patchelf": "patchelf", "swig": "swig",
}  # fmt: skip
"""Packages of conda-forge, by the library without its version, the header or the program."""


OF_TORCH = ("libtorch", "libc10")
"""Libraries inside the package torch: Debian's own are for other programs."""

BESIDE = {"mpi.h": "libopenmpi-dev"}
"""Headers that Debian has in a folder of their own."""

VENDORS = {
    "libcoppeliaSim.so": (
        "coppeliasim",
        "Install CoppeliaSim, and set COPPELIASIM_ROOT and LD_LIBRARY_PATH to its folder. PyRep wants a link there:"
        " `ln -s libcoppeliaSim.so libcoppeliaSim.so.1`.",
    ),
    "libv_rep.so": (
        "coppeliasim",
        "PyRep of that time needs V-REP 3: set VREP_ROOT and LD_LIBRARY_PATH to its folder, and type"
        " `ln -s libv_rep.so libv_rep.so.1` there. A newer PyRep uses CoppeliaSim.",
    ),
}
"""Libraries of programs that no package brings, by the name without a version: the program, and what to do."""


class MissingFile(NamedTuple):
    """A missing file, `kind` in words, and the packages that have it, or with `other` another version of it."""

    kind: str
    name: str
    debian: Optional[str]
    conda: Optional[str]
    other: bool


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where a line names a library, header or program that some package has."""
    library = LIBRARY.search(line)
    stem = re.sub(r"\.so[\d.]*$", ".so", next(filter(None, library.groups()))) if library else ""
    file = find(line)
    if "Could not load libtorchcodec" in line:
        way = "`conda install -c conda-forge ffmpeg` or `apt-get install ffmpeg`; else the torchcodec for your torch."
        yield Cause(
            "ffmpeg", "torchcodec finds no FFmpeg that it supports, or was built for another torch", {"text": way}
        )
        return
    if stem in VENDORS and ERROR.search(line):
        program, way = VENDORS[stem]
        yield Cause(program, "`{}` belongs to {}, and the loader does not find it".format(stem, program), {"text": way})
    elif file is not None:
        yield _headers_of_python() if file.name == "Python.h" else _cause(file)


def _cause(file: MissingFile) -> Cause:
    ways = []
    if file.debian:
        ways.append("`apt-get install {}` on Debian and Ubuntu".format(file.debian))
    if file.conda:
        ways.append("`conda install -c conda-forge {}`".format(file.conda))
    version = ", perhaps in another version" if file.other else ""
    text = "the {} `{}` is not on this machine, or not where it is looked for".format(file.kind, file.name)
    return Cause(file.name, text, {"text": "Install it{}: {}.".format(version, " or ".join(ways))})


def _headers_of_python() -> Cause:
    return Cause(
        "python-headers",
        "the Python that runs the build has no headers (Python.h); a Python inside an application never has them",
        {
            "text": "For the system's Python: `apt-get install python3-dev` (python3.N-dev of the same N). Else build"
            " with a Python of conda, uv or python.org."
        },
    )


def find(line: str) -> Optional[MissingFile]:
    """Return the missing file that a line names, if a package is known that has it."""
    for kind, table, name in _named(line):
        if name.startswith(OF_TORCH):
            continue
        stem = re.sub(r"\.so[\d.]*$", ".so", name)
        files = _tables().get(table, {})
        exact = files.get(name) or BESIDE.get(name)
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
        if match and ERROR.search(line):
            name = next(filter(None, match.groups()))
            yield kind, table, name if "." in name or table in {"headers", "programs"} else "lib{}.so".format(name)


def _of_stem(files: Dict[str, str], stem: str) -> Optional[str]:
    """Return the package that has a library in whatever version."""
    return next((files[name] for name in sorted(files) if name.startswith(stem + ".")), None)


@lru_cache(maxsize=None)
def _tables() -> Dict[str, Any]:
    contents = (carried_file("{}/debian-files.json.gz".format(place)) for place in PLACES)
    content = next((one for one in contents if one is not None), None)
    tables: Dict[str, Any] = json.loads(gzip.decompress(content).decode("utf-8")) if content else {}
    return tables


NAMING = frozenset({"jax"})
"""Packages whose modules name in their source what they removed: it does not tell what is there."""


def shadowed(line: str, scene: Scene) -> Causes:
    """Yield the cause that something else bears the name of a module, all of whose releases have what was asked for."""
    match = ATTRIBUTE.search(line)
    if match is None or "." in match.group(1) or "partially initialized" in line:
        return
    module, name = match.groups()
    history = scene.history_with(module)
    spans = history.spans("names", module, name) if history else None
    if (
        history is None
        or not spans
        or history.package in NAMING
        or history.spans("modules", "{}.{}".format(module, name))
    ):
        return  # a module of its own may be missing while the package is being imported
    if not set(history.read) <= set(places_of(spans)):
        return
    text = (
        "every release of {} has `{}.{}`: what is imported as `{}` is another file, a folder, or a rest of it".format(
            history.package, module, name, module
        )
    )
    way = "`python -c 'import {0}; print({0})'` shows it: rename it or leave its folder, then install {1} again."
    yield Cause("file", text, {"text": way.format(module, history.package)})


# --- files of an old MuJoCo ----------------------------------------------------------------------------------

FOLDERS = {"131": "mjpro131", "140": "mjpro140", "150": "mjpro150", "200": "mujoco200", "210": "mujoco210"}
"""The folder below ~/.mujoco by the number of a MuJoCo release."""

NUMBERED = Pattern(
    r"missing MuJoCo\.? .*(?:mjpro|mujoco)(\d{3})\b|cannot find -lmujoco(\d{3})\b|libmujoco(\d{3})\w*\.(?:so|dylib)"
    r".*(?:cannot open|No such file|image not found|not found)|Could not find .*\.mujoco/(?:mujoco|mjpro)(\d{3})\b"
    r"|No such file or directory: .*\.mujoco[/\\]+(?:mujoco|mjpro)(\d{3})\b",
    "ujoco", "mjpro", "MuJoCo",
)  # fmt: skip
UNNAMED = Pattern(
    r"missing MuJoCo\b|fatal error: '?(?:mujoco|mjmodel|mjdata|mjrender|mjui|mjvisualize|mujoco/mujoco)\.h\b"
    r"|cannot find -lglew(?:osmesa|egl)\b|libglew(?:osmesa|egl)\.so: cannot open",
    "MuJoCo", "glew", "fatal error",
)  # fmt: skip
OF_DM_CONTROL = Pattern(r"Cannot find MuJoCo library at", "Cannot find MuJoCo")
KEY = Pattern(
    r"(?:missing a )?[Ll]icense [Kk]ey for mujoco|mjkey\.txt|Invalid activation key", "mujoco", "mjkey", "key"
)
PATH = Pattern(
    r"Missing path to your environment variable|add following line to (?:\.bashrc|.*LD_LIBRARY_PATH)"
    r"|export LD_LIBRARY_PATH=\S*\.mujoco", "LD_LIBRARY_PATH", "Missing path",
)  # fmt: skip
WINDOWS = Pattern(r"DLL load failed while importing cymj", "cymj")


def of_mujoco(line: str, scene: Scene) -> Causes:
    """Yield the cause where a line says that files of a MuJoCo before 2.1.2 are missing, or are not found."""
    if OF_DM_CONTROL.search(line):
        text = "dm_control before 1.0 loads MuJoCo from a folder, and it is not there; later releases include it"
        yield Cause("dm-control", text, requirement_remedy("dm-control>=1.0"))
        return
    named, unnamed = NUMBERED.search(line), UNNAMED.search(line)
    if named or unnamed:
        number = next(filter(None, named.groups())) if named else None
        yield _missing(number)
    elif KEY.search(line) and "key" in line.lower():
        yield _key()
    elif PATH.search(line):
        yield Cause(
            "mujoco-binaries",
            "mujoco-py finds MuJoCo's libraries only if LD_LIBRARY_PATH names their folder, before Python starts",
            {"text": 'Type `export LD_LIBRARY_PATH="$LD_LIBRARY_PATH:$HOME/.mujoco/mujoco210/bin:/usr/lib/nvidia"`.'},
        )
    elif WINDOWS.search(line):
        yield Cause(
            "mujoco-binaries",
            "since Python 3.8 Windows looks for libraries only in folders that were named: MuJoCo's bin folder was not",
            {"text": "Call `os.add_dll_directory` with the bin folder of mujoco210 first, or use the package mujoco."},
        )


def _missing(number: Optional[str]) -> Cause:
    number = number or "210"
    version = "{}.{}".format(number[0], number[1:] if number[0] == "1" else number[1])
    folder = FOLDERS.get(number, "mujoco{}".format(number))
    source = "github.com/google-deepmind/mujoco/releases/tag/2.1.0" if number == "210" else "roboti.us/download.html"
    return Cause(
        "mujoco-{}-binaries".format(version),
        "mujoco-py needs the files of MuJoCo {} in ~/.mujoco/{}, and does not find them".format(version, folder),
        {
            "text": "Unpack them from {0} to ~/.mujoco/{1}, and type `export LD_LIBRARY_PATH="
            "$LD_LIBRARY_PATH:$HOME/.mujoco/{1}/bin`. New code needs none of this: `pip install mujoco`.".format(
                source, folder
            )
        },
    )


def _key() -> Cause:
    return Cause(
        "mujoco-key",
        "MuJoCo before 2.1 needs a licence file, ~/.mujoco/mjkey.txt; it is free now, and 2.1 needs none",
        {
            "requirements": ["mujoco-py>=2.1"],
            "text": "Or put the free key from roboti.us/license.html into ~/.mujoco/mjkey.txt.",
        },
    )
