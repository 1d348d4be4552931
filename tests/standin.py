"""A stand-in for several GPUs, for tests alone: one real device of EGL shown several times, and NVML beside it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

SOURCES = Path(__file__).parent / "devices"
EGL = "libEGL.so.1"


def variables(folder: Path, devices: str) -> dict[str, str]:
    """Compile the libraries into a folder, once, and return what makes a process see these devices.

    `devices` has a word for each: the ordinal that CUDA gives it or `-`, with `!` where it cannot be initialised.
    """
    if not (folder / EGL).exists():
        _compile(folder)
    contexts = folder / "contexts"
    contexts.unlink(missing_ok=True)
    return {"LD_LIBRARY_PATH": str(folder), "SHIM_DEVICES": devices, "SHIM_CONTEXTS": str(contexts)}


def _compile(folder: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("unavailable: a C compiler")
    process = subprocess.run((compiler, f"-print-file-name={EGL}"), capture_output=True, text=True, check=True)
    real = Path(process.stdout.strip()).resolve()
    if not real.is_absolute() or not real.exists():
        pytest.skip("missing library: libegl1")
    shared = (compiler, "-shared", "-fPIC", "-O1", "-Wall", "-Werror")
    (folder / "empty.c").write_text("")
    named = folder / "real.so"  # what makes the stand-in lean on the real one by its path: both have the same name
    subprocess.run((*shared, f"-Wl,-soname,{real}", "-o", named, folder / "empty.c"), check=True)
    arguments = ("-o", folder / EGL, f"-Wl,-soname,{EGL}", f'-DREAL="{real}"', SOURCES / "egl.c")
    subprocess.run((*shared, *arguments, "-Wl,--no-as-needed", named, "-ldl"), check=True)
    (folder / "libEGL.so").symlink_to(EGL)
    nvml = "libnvidia-ml.so.1"
    subprocess.run((*shared, f"-Wl,-soname,{nvml}", "-o", folder / nvml, SOURCES / "nvml.c"), check=True)
