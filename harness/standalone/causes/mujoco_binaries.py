"""Explain that the files of MuJoCo before 2.1.2 are missing, which mujoco-py and old dm_control load from a folder."""

from __future__ import annotations

from typing import Optional

from .scene import Cause, Causes, Pattern, Scene

FOLDERS = {"131": "mjpro131", "140": "mjpro140", "150": "mjpro150", "200": "mujoco200", "210": "mujoco210"}
"""The folder below ~/.mujoco by the number of a MuJoCo release."""

MISSING = Pattern(
    r"missing MuJoCo\.? .*(?:mjpro|mujoco)(\d{3})\b|cannot find -lmujoco(\d{3})\b|libmujoco(\d{3})\w*\.(?:so|dylib)"
    r".*(?:cannot open|No such file|image not found|not found)|Could not find .*\.mujoco/(?:mujoco|mjpro)(\d{3})\b"
    r"|No such file or directory: .*\.mujoco[/\\]+(?:mujoco|mjpro)(\d{3})\b",
    "ujoco", "mjpro", "MuJoCo",
)  # fmt: skip
UNNAMED = Pattern(
    r"missing MuJoCo\b|fatal error: '?(?:mujoco|mjmodel|mjdata|mjrender|mjui|mjvisualize|mujoco/mujoco)\.h\b"
    r"|cannot find -lglew(?:osmesa|egl)\b|libglew(?:osmesa|egl)\.so: cannot open|Cannot find MuJoCo library at",
    "MuJoCo", "glew", "fatal error",
)  # fmt: skip
KEY = Pattern(
    r"(?:missing a )?[Ll]icense [Kk]ey for mujoco|mjkey\.txt|Invalid activation key", "mujoco", "mjkey", "key"
)
PATH = Pattern(
    r"Missing path to your environment variable|add following line to (?:\.bashrc|.*LD_LIBRARY_PATH)"
    r"|export LD_LIBRARY_PATH=\S*\.mujoco", "LD_LIBRARY_PATH", "Missing path",
)  # fmt: skip
WINDOWS = Pattern(r"DLL load failed while importing cymj", "cymj")


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where a line says that files of an old MuJoCo are missing."""
    named, unnamed = MISSING.search(line), UNNAMED.search(line)
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
