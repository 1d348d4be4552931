"""Write a combination as a file: `environment.yml` of conda, `pyproject.toml`, a Dockerfile.

An environment has every package of the lock at its measured version. A project declares only the named ones.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from harness.reports.answers.recommending import Combination, public_version
from harness.reports.install_texts.install_commands import VIRTUAL, minor, variables
from harness.running.lock_files import WHEELS

PIN = re.compile(r"^([\w.-]+)==(\S+)", re.MULTILINE)
CODENAME = re.compile(r"Debian GNU/Linux \S+ \((\w+)\)")
DRAWING = {
    "egl": ("libegl1", "libgl1", "libgl1-mesa-dri"),
    "osmesa": ("libosmesa6", "libgl1"),
    "glx": ("libgl1", "libgl1-mesa-dri", "xvfb"),
    "glfw": ("libgl1", "libgl1-mesa-dri", "xvfb"),
}
"""Debian's packages for each way of drawing, as OpenGL and as `MUJOCO_GL` name it."""

LOADED = {
    "opencv-python": ("libgl1", "libglib2.0-0"),
    "opencv-contrib-python": ("libgl1", "libglib2.0-0"),
    "pyglet": ("libgl1", "libglu1-mesa"),
}
"""Debian's packages that a package of Python loads when it is imported or draws."""


def conda(combination: Combination, header: str) -> str:
    """Return an `environment.yml`."""
    values = variables(combination)
    lines = [
        f"name: {json.dumps('-'.join(combination.versions))}",
        "channels:",
        "  - conda-forge",
        "dependencies:",
        f'  - "python={minor(combination)}"',
        "  - pip",
        "  - pip:",
        *(f"      - {json.dumps(text)}" for text in _all_pins(combination)),
        *(["variables:"] if values else []),
        *(f"  {name}: {json.dumps(value)}" for name, value in values.items()),
    ]
    return header + "\n".join(lines) + "\n"


def pyproject(combination: Combination, header: str) -> str:
    """Return a `pyproject.toml` of a project without code of its own."""
    lines = [
        "[project]",
        f"name = {json.dumps('my-' + '-'.join(combination.versions))}",
        'version = "0.1.0"',
        f'requires-python = "=={minor(combination)}.*"',
        "dependencies = [",
        *(f"    {json.dumps(text)}," for text in combination.requirements),
        "]",
    ]
    return header + "\n".join(lines) + "\n"


def dockerfile(combination: Combination, header: str, os: str, lock: Path | None = None) -> str:
    """Return a Dockerfile; `os` is the system that was measured on, `lock` a file that lies beside it."""
    codename = CODENAME.search(os)
    values = variables(combination)
    debian = debian_packages(combination)
    lines = [
        f"FROM python:{minor(combination)}-slim{f'-{codename[1]}' if codename else ''}",
        *_apt(debian),
        *(f"ENV {name}={json.dumps(value)}" for name, value in values.items()),
        *_pip(combination, lock),
    ]
    if VIRTUAL in combination.settings.items():
        lines.append("# Pictures need a display: start the program with `xvfb-run`.")
    return header + "\n".join(lines) + "\n"


def debian_packages(combination: Combination) -> list[str]:
    """Return Debian's packages that drawing needs, as it was measured, and those that its packages load."""
    names = {name for name, _ in PIN.findall(combination.lock)} or set(combination.versions)
    # MuJoCo loads the library of its way of drawing when it is imported, even if nothing is drawn.
    ways = [*combination.drawn, combination.settings.get("MUJOCO_GL", "")]
    ways += ["glx"] if VIRTUAL in combination.settings.items() else []
    needed = [DRAWING.get(way, ()) for way in ways] + [LOADED[name] for name in sorted(LOADED.keys() & names)]
    return sorted({package for packages in needed for package in packages})


def _apt(packages: list[str]) -> Iterator[str]:
    if packages:
        yield "RUN apt-get update \\"
        yield f"    && apt-get install -y --no-install-recommends {' '.join(packages)} \\"
        yield "    && rm -rf /var/lib/apt/lists/*"


def _pip(combination: Combination, lock: Path | None) -> Iterator[str]:
    if lock:
        yield f"COPY {json.dumps([lock.name, '/tmp/'])}"
        links = f"/tmp/{lock.stem}{WHEELS}"
        if combination.repaired:
            yield f"COPY {json.dumps([f'{lock.stem}{WHEELS}', links])}"
        option = f" --find-links {shlex.quote(links)}" if combination.repaired else ""
        # Every package is in the lock: what it declares to need was resolved when it was measured.
        yield f"RUN pip install --no-cache-dir --no-deps --require-hashes{option} -r {shlex.quote(f'/tmp/{lock.name}')}"
        return
    yield "RUN pip install --no-cache-dir \\"
    yield " \\\n".join(f"    {shlex.quote(text)}" for text in _all_pins(combination))


def _all_pins(combination: Combination) -> list[str]:
    """Return every package of the lock as a requirement; without a lock those that are known."""
    pins = {name: public_version(version) for name, version in PIN.findall(combination.lock)}
    if not pins:
        return list(combination.requirements)
    # A version with a local part comes from another index: what the release of the usual one needs is not in the lock.
    extras = {canonicalize_name(one.name): sorted(one.extras) for one in map(Requirement, combination.requirements)}
    return [
        f"{name}[{','.join(extras[name])}]=={version}" if extras.get(name) else f"{name}=={version}"
        for name, version in pins.items()
    ]
