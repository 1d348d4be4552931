"""Explain compiled code that does not fit: NumPy's binary interface, libstdc++, glibc, symbols of MuJoCo."""

from __future__ import annotations

import re
from typing import Dict, Optional

from .scene import Cause, Causes, Pattern, Scene

ABI = Pattern(
    r"_ARRAY_API not found|compiled against ABI version 0x1\w* but this version of numpy is 0x2"
    r"|compiled using NumPy 1\.x cannot be run in\b|compiled using NumPy 1\.x",
    "_ARRAY_API", "ABI version", "NumPy 1.x",
)  # fmt: skip
API = Pattern(r"compiled against API version (0x\w+) but this version of numpy is (0x\w+)", "API version")
SIZE = Pattern(
    r"numpy\.(dtype|ndarray|ufunc|\w+) size changed,? may indicate binary incompatibility\.? Expected (\d+) from C"
    r" header, got (\d+)", "size changed",
)  # fmt: skip
LIBSTDCXX = Pattern(
    r"(?:libstdc\+\+|libstdcxx)\S*: version `?(GLIBCXX_[\d.]+|CXXABI_[\d.]+)'? not found", "GLIBCXX_", "CXXABI_"
)
GLIBC = Pattern(r"version `?GLIBC_(\d[\d.]*)'? not found(?: \(required by ([^)\s]+)\)?)?", "GLIBC_")
LICENCE = Pattern(
    r"libmujoco\S*: undefined symbol: mj\w*[cC]ert\w*|undefined symbol: mj_(?:cert\w*|activate|deactivate)\b",
    "undefined symbol: mj",
)
PYTHON = Pattern(r"(?:libpython(3\.\d+)\w*\.so[.\d]*): cannot open", "libpython3")
MACHINE = Pattern(
    r"(?:mach-o file, but is an |have |wrong architecture.*)incompatible architecture|incompatible architecture \(have",
    "incompatible architecture",
)
BOUNDS = Pattern(r"OverflowError: Python integer -?\d+ out of bounds for u?int\d+", "out of bounds for")
ANOTHER_NUMPY = Pattern(r"expected np\.ndarray \(got numpy\.ndarray\)", "got numpy.ndarray")
RAGGED = Pattern(r"requested array has an inhomogeneous shape after \d+ dimensions(?!.*\(2,\))", "inhomogeneous shape")
PROTOBUF = Pattern(r"Descriptors cann?ot (?:not )?be created directly", "Descriptors ")
GENERATOR = Pattern(
    r"numpy\.random\._generator\.Generator' object has no attribute '(?:rand|randint|randn|random_sample)'",
    "Generator'",
)
UFUNC_OF_122 = 232
"""Bytes of a ufunc since NumPy 1.22."""

NUMPY_OF_API: Dict[int, str] = {
    0xA: "1.10", 0xB: "1.13", 0xC: "1.14", 0xD: "1.16", 0xE: "1.20", 0xF: "1.22", 0x10: "1.23", 0x11: "1.25",
    0x12: "2.0", 0x13: "2.1", 0x14: "2.3",
}  # fmt: skip
"""The first release of NumPy with each version of its C API (numpy/core/code_generators/cversions.txt)."""


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where a line says that compiled parts do not fit."""
    for rule in (_numpy, _numpy_values, _protobuf, _system, _mujoco):
        cause = rule(line, scene)
        if cause is not None:
            yield cause
            return


def random_numbers(line: str, scene: Scene) -> Causes:
    """Yield the second package that began to hand out a Generator; the first one, gym, is a known issue."""
    if GENERATOR.search(line) and not scene.speaks_of("gymnasium") and scene.is_pasted:
        text = "ale-py 0.7.5 and newer give `np_random` as a Generator of NumPy, which has `integers`, not `randint`"
        yield Cause("ale-py", text, {"requirements": ["ale-py<0.7.5"], "text": "For Atari games; else it is gym."})


def _numpy(line: str, scene: Scene) -> Optional[Cause]:
    api, size = API.search(line), SIZE.search(line)
    if api:
        wanted, there = int(api.group(1), 16), int(api.group(2), 16)
        first = NUMPY_OF_API.get(wanted)
        if first and wanted > there:
            text = "a package was compiled with NumPy {} or newer, and the installed NumPy is older".format(first)
            return Cause("numpy", text, {"requirements": ["numpy>={}".format(first)]})
    if size:
        return _of_size(size.group(1), int(size.group(2)), int(size.group(3)))
    if ABI.search(line):
        text = "a package that was compiled with NumPy 1 was loaded with NumPy 2; the traceback above names it"
        way = "Or install a release of that package for NumPy 2."
        return Cause("numpy", text, {"requirements": ["numpy<2"], "text": way})
    return None


def _numpy_values(line: str, scene: Scene) -> Optional[Cause]:
    if BOUNDS.search(line):
        text = "since NumPy 2 a Python integer that is combined with an array has to fit into its type"
        way = "Or convert first: `int(value)`, or an array of a wider type."
        return Cause("numpy", text, {"requirements": ["numpy<2"], "text": way})
    if ANOTHER_NUMPY.search(line):
        text = "torch before 2.3 was compiled with NumPy 1, and NumPy 2 is installed"
        return Cause("numpy", text, {"requirements": ["numpy<2"], "text": "Or `torch>=2.3`."})
    if RAGGED.search(line):
        text = (
            "NumPy 1.24 and newer make no array from rows of different lengths; older releases made an array of objects"
        )
        way = "Or make the rows alike, or write `dtype=object`."
        return Cause("numpy", text, {"requirements": ["numpy<1.24"], "text": way})
    return None


def _protobuf(line: str, scene: Scene) -> Optional[Cause]:
    if not PROTOBUF.search(line):
        return None
    text = "protobuf 4 and newer reject code that protoc before 3.19 generated"
    way = "Or install a newer release of the package that contains the generated code (a file *_pb2.py)."
    return Cause("protobuf", text, {"requirements": ["protobuf<3.21"], "text": way})


def _of_size(kind: str, expected: int, size: int) -> Optional[Cause]:
    """Return the side that the sizes of a structure tell: NumPy 2 made `dtype` smaller, all else only grew."""
    if kind == "dtype":
        if expected > size:
            text = "a package that was compiled with NumPy 1 was loaded with NumPy 2"
            way = "Or install a release of that package for NumPy 2."
            return Cause("numpy", text, {"requirements": ["numpy<2"], "text": way})
        text = "a package that was compiled with NumPy 2 was loaded with NumPy 1"
        return Cause("numpy", text, {"requirements": ["numpy>=2"], "text": "Or install a release of it for NumPy 1."})
    if expected > size:
        first = "1.20" if kind == "ndarray" else "1.22" if expected == UFUNC_OF_122 else ""
        text = "a package was compiled with a newer NumPy{} than the one that is installed".format(
            " ({} or later)".format(first) if first else ""
        )
        return Cause("numpy", text, {"requirements": ["numpy>={}".format(first) if first else "numpy"]})
    return None


def _system(line: str, scene: Scene) -> Optional[Cause]:
    newer, glibc, python = LIBSTDCXX.search(line), GLIBC.search(line), PYTHON.search(line)
    if newer:
        text = "a library needs {} of a newer libstdc++ than the one that was loaded".format(newer.group(1))
        way = (
            "With conda: `conda install -c conda-forge libstdcxx-ng`, and put $CONDA_PREFIX/lib first in"
            " LD_LIBRARY_PATH; elsewhere upgrade the system's libstdc++6."
        )
        return Cause("libstdcxx-ng", text, {"text": way})
    if glibc:
        asker = re.sub(r".*[/\\]", "", glibc.group(2) or "").rstrip("):") or "a compiled file"
        text = "`{}` was built for a system with glibc {} or newer, and this system's is older".format(
            asker, glibc.group(1)
        )
        way = "Install an older release of it, build it here, install it by conda, or move to a newer Linux."
        return Cause("glibc", text, {"text": way})
    if python:
        text = "`{}` is the shared library of Python {}, and the loader does not find it".format(
            python.group(0).split(":")[0], python.group(1)
        )
        way = (
            "With conda: `export LD_LIBRARY_PATH=$CONDA_PREFIX/lib`; on Ubuntu: `apt-get install libpython{}`.".format(
                python.group(1)
            )
        )
        return Cause("libpython", text, {"text": way})
    if MACHINE.search(line):
        text = "the compiled file is for another processor (x86_64 or arm64) than the Python that loads it"
        return Cause(
            "architecture",
            text,
            {"text": "Use a Python of this machine's own architecture, and install the package again."},
        )
    return None


def _mujoco(line: str, scene: Scene) -> Optional[Cause]:
    if LICENCE.search(line):
        text = "MuJoCo 2.1.1 and newer have no functions for licences, and an older dm_control looks for one"
        return Cause("dm-control", text, {"requirements": ["dm-control>=1.0"]})
    return None
