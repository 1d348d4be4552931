"""Explain builds of wheels that failed: what the build lacked or did not fit, and what replaces the package."""

from __future__ import annotations

import re
from typing import Any, Dict, Optional, Tuple

from ..versions import canonical, is_version
from . import missing_releases
from .scene import PACKAGE, Cause, Causes, Pattern, Scene

BUILT = Pattern(
    r"(?:Failed building (?:wheel|editable) for|Could not build wheels for|Failed to build(?: installable wheels for)?"
    r"(?: some pyproject\.toml based projects \()?|Failed to download and build|Encountered error while (?:trying to"
    r" install package|generating package metadata)\.?:?|Running setup\.py (?:install|bdist_wheel) for"
    r"|Building (?:wheel|editable) for)"
    r" `?({0})(?:==(\d[\w.]*))?".format(PACKAGE),
    "Failed building", "Could not build", "Failed to build", "Failed to download", "Encountered error",
    "Running setup.py", "Building ",
)  # fmt: skip
UNSUPPORTED = Pattern(r"(\w+) (\d[\d.]*\d) may not yet support Python", "may not yet support Python")
ERROR_ONLY = re.compile(r"\.\.\. error|did not run successfully|[Ff]ail|[Cc]ould not|Encountered error")
REPLACED: Dict[str, Tuple[str, Dict[str, Any]]] = {
    "atari-py": ("ale-py replaces it, with wheels", {"requirements": ["ale-py"], "uninstall": ["atari-py"]}),
    "box2d-py": ("the package `box2d` has the same module, and wheels", {"requirements": ["box2d"]}),
    "box2d-kengz": ("the package `box2d` has the same module, and wheels", {"requirements": ["box2d"]}),
    "mujoco-py": (
        "its build needs MuJoCo (1.50, 2.0 or 2.1, by its release), a C compiler and GL headers; `mujoco` replaces it",
        {"requirements": ["mujoco"], "text": "Ids of gymnasium that end in -v4 and -v5 use it."},
    ),
    "gym": ("gymnasium replaces it", {"build_constraints": ["setuptools<66", "wheel<0.40"], "requirements": ["gym"]}),
    "pybullet": (
        "it needs a C++ compiler and several minutes; conda-forge has a built package",
        {"text": "Type `conda install -c conda-forge pybullet`, or use a Python for which it has a wheel."},
    ),
    "egl-probe": (
        "CMake 4 rejects its CMakeLists.txt",
        {"requirements": ["cmake<4"], "text": "Or install `hf-egl-probe` instead."},
    ),
    "evdev": (
        "it needs the headers of the Linux kernel",
        {"text": "Type `apt-get install linux-libc-dev`, or install it by conda."},
    ),
    "mpi4py": (
        "it needs an MPI with its compiler, mpicc",
        {"text": "Type `apt-get install libopenmpi-dev`, or `conda install -c conda-forge mpi4py`."},
    ),
    "dm-tree": ("older releases need Bazel or CMake", {"requirements": ["dm-tree>=0.1.8"]}),
    "labmaze": ("it needs Bazel where it has no wheel", {"requirements": ["labmaze>=1.0.6"]}),
    "free-mujoco-py": ("it is a copy of mujoco-py, and `mujoco` replaces both", {"requirements": ["mujoco"]}),
    "pygame": ("older releases have no wheel for newer Pythons", {"requirements": ["pygame>=2.6"]}),
    "opencv-python": ("older releases have no wheel for newer Pythons", {"requirements": ["opencv-python>=4.5.5"]}),
}
"""The replacement of a package, and why it helps."""

HINTS = (
    (
        Pattern(r"noexcept|Cannot assign type '.*' to '.*nogil|_cython_\d.*PerformanceHint|legacy_implicit_noexcept",
                "noexcept", "Cannot assign type"),
        "cython", "the code was written for Cython 0.29, and Cython 3 rejects it",
        {"build_constraints": ["cython<3"], "requirements": ["cython<3"]},
    ),
    (
        Pattern(r"CompileError: \S*mujoco_py[/\\]cymj\.pyx", "cymj.pyx"),
        "cython", "mujoco-py was written for Cython 0.29, and Cython 3 rejects it",
        {"requirements": ["cython<3"], "text": "New code does not need mujoco-py: `pip install mujoco`."},
    ),
    (
        Pattern(r"'python_requires' must be a string containing valid version specifiers", "'python_requires' must"),
        "setuptools", "setuptools 67 and newer reject the `python_requires` of this setup.py",
        {"build_constraints": ["setuptools<67"], "requirements": ["setuptools<67"]},
    ),
    (
        Pattern(r"Compatibility with CMake < 3\.5 has been removed", "Compatibility with CMake"),
        "cmake", "CMake 4 rejects projects that require a CMake older than 3.5",
        {"requirements": ["cmake<4"], "text": "Or type `export CMAKE_POLICY_VERSION_MINIMUM=3.5`."},
    ),
    (
        Pattern(r"use_2to3 is invalid", "use_2to3"),
        "setuptools", "setuptools 58 removed `use_2to3`, which this package's setup.py uses",
        {"build_constraints": ["setuptools<58"], "requirements": ["setuptools<58"]},
    ),
    (
        Pattern(r"module 'pkgutil' has no attribute 'ImpImporter'", "ImpImporter"),
        "setuptools", "Python 3.12 removed `pkgutil.ImpImporter`, which setuptools before 66.1 uses",
        {"requirements": ["setuptools>=66.1"], "text": "If an old package pins setuptools, use Python 3.11."},
    ),
    (
        Pattern(r"requires? compiler and library support for the ISO C\+\+ (?:20)?\d\d", "ISO C++"),
        "compiler", "the compiler here is older than the C++ of the sources, or does not enable it by default",
        {"environment": {"CXXFLAGS": "-std=c++14"}, "text": "Or install a newer g++."},
    ),
    (
        Pattern(r"error: invalid command 'bdist_wheel'", "bdist_wheel"),
        "wheel", "the package `wheel` is missing where setup.py runs", {"requirements": ["wheel"]},
    ),
    (
        Pattern(r"longintrepr\.h: No such file|'PyThreadState' .*has no member named '(?:curexc|exc_)"
                r"|has no member named 'ob_digit'|'PyFrameObject'.* has no member|_PyUnicode_\w+' was not declared",
                "longintrepr", "has no member", "_PyUnicode"),
        "python", "an older Cython generated the C code, which does not fit this newer Python",
        {"text": "Install a newer release of the package, or an older Python (3.10 has longintrepr.h)."},
    ),
    (
        Pattern(r"'?cython_sources'?", "cython_sources"),
        "pyyaml", "PyYAML before 6.0.1 does not build with Cython 3", {"requirements": ["pyyaml>=6.0.1"]},
    ),
    (
        Pattern(r"Microsoft Visual C\+\+ 14\.0 or greater is required", "Microsoft Visual C++"),
        "visual-c++", "the package has no wheel for this Python on Windows, and its build needs Microsoft's compiler",
        {"text": "Use a Python for which it has a wheel, or install the Build Tools for Visual Studio (C++)."},
    ),
    (
        Pattern(r"unable to execute '[/\\]\S*(?:clang|gcc|g\+\+|cc)(?:-\d+)?'|error: command '/\S*(?:clang|gcc|g\+\+)'"
                r" failed: No such file", "unable to execute '/", "error: command '/"),
        "compiler", "the variable CC (or CXX), or the Python's own settings, name a compiler that is not installed",
        {"environment": {"CC": "", "CXX": ""}, "text": "Or install that compiler."},
    ),
    (
        Pattern(r"opencv-python>=3\.(?=[\s;'\"]|$)", "opencv-python>=3."),
        "gym", "gym 0.18 to 0.21 contain the invalid requirement `opencv-python>=3.`, which newer installers reject",
        {"build_constraints": ["setuptools<66", "wheel<0.40"], "text": "Use pip<24.1 for it, or a newer gym."},
    ),
    (
        Pattern(r"'?extras_require'? must be a dictionary", "extras_require"),
        "setuptools", "setuptools 67 rejects the `extras_require` of gym 0.21 and similar packages",
        {"build_constraints": ["setuptools<66", "wheel<0.40"], "requirements": ["setuptools<66"]},
    ),
)  # fmt: skip


NOT_FOUND = Pattern(
    r"Could not find a package configuration file provided by\s+\"([\w+-]+)\"|Could NOT find ([\w+-]+) \(",
    "Could not find a package", "Could NOT find",
)  # fmt: skip
DEBIAN = {
    "Boost": "libboost-all-dev", "BZip2": "libbz2-dev", "Bullet": "libbullet-dev", "Eigen3": "libeigen3-dev",
    "GLEW": "libglew-dev", "JPEG": "libjpeg-dev", "MPI": "libopenmpi-dev", "OpenCV": "libopencv-dev",
    "OpenGL": "libgl1-mesa-dev", "OpenSSL": "libssl-dev", "PNG": "libpng-dev", "PkgConfig": "pkg-config",
    "PythonLibs": "python3-dev", "SDL2": "libsdl2-dev", "X11": "libx11-dev", "ZLIB": "zlib1g-dev",
    "assimp": "libassimp-dev", "glfw3": "libglfw3-dev", "pybind11": "pybind11-dev", "yaml-cpp": "libyaml-cpp-dev",
}  # fmt: skip
"""Packages of Debian by the name under which CMake looks for what is in them."""


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where a line tells of a build that failed."""
    for pattern, subject, text, remedy in HINTS:
        if pattern.search(line):
            yield Cause(subject, text, remedy)
            return
    cause = _sought(line, scene) or _built(line, scene)
    if cause is not None:
        yield cause


def _sought(line: str, scene: Scene) -> Optional[Cause]:
    """Return the cause that CMake does not find a library; the name may stand in the line after."""
    match = NOT_FOUND.search(scene.failure.text) if "CMake Error" in line else NOT_FOUND.search(line)
    if match is None:
        return None
    name = next(filter(None, match.groups()))
    package = DEBIAN.get(name)
    way = (
        "Install it: `apt-get install {}` on Debian and Ubuntu.".format(package)
        if package
        else "Install its development files, or let {}_DIR or CMAKE_PREFIX_PATH name their folder.".format(name)
    )
    return Cause(package or name, "the build looks for {} by CMake, and does not find it".format(name), {"text": way})


def _built(line: str, scene: Scene) -> Optional[Cause]:
    match = BUILT.search(line)
    if match is None or not ERROR_ONLY.search(line):
        return None
    package = canonical(match.group(1))
    history = scene.load(package)
    unsupported = UNSUPPORTED.search(scene.failure.text)
    named = unsupported.group(2) if unsupported and canonical(unsupported.group(1)) == package else None
    version = match.group(2) or named or scene.versions.get(package)
    replaced = REPLACED.get(package)
    if history is not None and scene.python:
        cause = (
            missing_releases.of_version(history, version, scene.python, built=True)
            if version and is_version(version)
            else missing_releases.of_any(history, scene.python)
        )
        if cause is not None:
            return cause
    name = "{} {}".format(package, version) if version else package
    if replaced:
        return Cause(package, "{} was built from source, and that failed; {}".format(name, replaced[0]), replaced[1])
    if history is None or (version and scene.python and missing_releases.has_one(history, version, scene.python)):
        return None  # it has a wheel, at least for Linux: something else made the installer build it
    newest, pythons = missing_releases.last_with_wheels(history)
    if newest is None or not pythons:
        return None
    text = "{} has no wheel for this Python, and its build failed; {} has wheels for Python {}".format(
        name, newest, ", ".join(pythons)
    )
    return Cause(
        package, text, {"requirements": ["{}=={}".format(package, newest)], "text": "Use one of these Pythons."}
    )
