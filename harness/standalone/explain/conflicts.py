"""Tell what a line of an installer, a loader or a driver says of two versions that do not fit."""

from __future__ import annotations

import re
from typing import Any, Mapping, NamedTuple, Optional

from ..versions import canonical

INCOMPATIBLE = re.compile(
    r"([A-Za-z0-9][\w.-]*) (\d\S*) requires ([A-Za-z0-9][\w.-]*)(?:\[[\w,-]*\])?\s?"
    r"((?:[<>=!~]=?=?\s?[\w.*]+,?\s?)+), but you have \3 (\S+) which is incompatible"
)
ABSENT = re.compile(
    r"([A-Za-z0-9][\w.-]*) (\d\S*) requires ([A-Za-z0-9][\w.-]*)(?:\[[\w,-]*\])?\s?"
    r"((?:[<>=!~]=?=?\s?[\w.*]+,?\s?)*), which is not installed"
)
ARCHITECTURE = re.compile(
    r"no kernel image is available for execution on the device|with CUDA capability sm_(\d+) is not compatible"
    r"|PyTorch install supports CUDA capabilities"
)
ABI = re.compile(r"AttributeError: _ARRAY_API not found|module compiled against ABI version 0x1\w* but this version")
LIBSTDCXX = re.compile(r"libstdc\+\+\.so\.6: version `?(GLIBCXX_[\d.]+)'? not found")


class Conflict(NamedTuple):
    """Two versions that do not fit: the package to change, the cause, and the remedy as documents hold it."""

    package: str
    cause: str
    remedy: Mapping[str, Any]


def find(line: str) -> Optional[Conflict]:
    """Return the conflict that a line tells of; None if it tells of none."""
    apart, absent, newer = INCOMPATIBLE.search(line), ABSENT.search(line), LIBSTDCXX.search(line)
    if apart:
        name, version, package, bound, there = apart.groups()
        cause = "{} {} wants {}{}, and {} {} is installed".format(name, version, package, bound.strip(), package, there)
        return Conflict(canonical(package), cause, {"requirements": [package + bound.replace(" ", "")]})
    if absent:
        name, version, package, bound = absent.groups()
        cause = "{} {} wants {}, which is not installed".format(name, version, package)
        return Conflict(canonical(package), cause, {"requirements": [package + bound.replace(" ", "")]})
    if ARCHITECTURE.search(line):
        cause = "this build of torch has no code for this GPU: the GPU is newer, or older, than the build knows"
        text = "Install a torch built for a CUDA that knows the GPU: cu128, from torch 2.7 on, for RTX 50 (sm_120)."
        return Conflict("torch", cause, {"text": text})
    if ABI.search(line):
        cause = "a package that was compiled with NumPy 1 was loaded with NumPy 2; the traceback above names it"
        text = "Or take a release of that package that was built with NumPy 2."
        return Conflict("numpy", cause, {"requirements": ["numpy<2"], "text": text})
    if newer:
        cause = "a library wants {} of a newer libstdc++ than the one that was loaded".format(newer.group(1))
        text = (
            "With conda: `conda install -c conda-forge libstdcxx-ng`, and put $CONDA_PREFIX/lib first in"
            " LD_LIBRARY_PATH; elsewhere upgrade the system's libstdc++6."
        )
        return Conflict("libstdcxx-ng", cause, {"text": text})
    return None
