"""Write an index of tiny packages with upload days, and an environment that depends on them."""

from __future__ import annotations

import hashlib
import html
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import wheelhouse as fakes
from packaging.utils import canonicalize_name

LONG_AGO, ROBOT, LATER, LAST = "2020-01-01", "2026-02-01", "2026-04-01", "2026-06-01"
"""When other people's packages, the robot, and what came after it were uploaded: no Python has to wait for wheels."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Release:
    """One release of a package whose module has its name; `hooks` make it an sdist."""

    name: str
    version: str
    day: str
    code: str = ""
    requires: Sequence[str] = ()
    hooks: str | None = None
    about: Mapping[str, Any] = field(default_factory=dict)


def line(name: str, versions: Mapping[str, str], code: str = "", requires: Sequence[str] = ()) -> list[Release]:
    """Return releases of one package, from version to day; `@VERSION@` in the code is the version."""
    return [
        Release(name=name, version=version, day=day, code=code.replace("@VERSION@", version), requires=requires)
        for version, day in versions.items()
    ]


def robot(name: str, needs: str, requires: Sequence[str] = (), version: str = "1.0", day: str = ROBOT) -> Release:
    """Return a package with one environment, which can be made only if the statements in `needs` raise nothing."""
    module = name.replace("-", "_")
    code = (
        f"import os\nimport fake_healthy\nimport gymnasium\n\n\nclass Robot(fake_healthy.Healthy):\n"
        f"    def __init__(self, **kwargs):\n        super().__init__(**kwargs)\n        needed()\n\n\n"
        f"def needed():\n    {needs}\n\n\ngymnasium.register('{module}-v0', Robot)\n"
    )
    return Release(name=name, version=version, day=day, code=code, requires=("fake-healthy", *requires))


def write_index(folder: Path, place: Path, wheels: Path, releases: Sequence[Release]) -> None:
    """Write an index of these releases and wheels below a folder that will be moved to `place`."""
    shelf = folder / "files"
    shelf.mkdir(parents=True)
    days: dict[Path, str] = {}
    for path in wheels.glob("*.whl"):
        days[Path(shutil.copy(path, shelf))] = LONG_AGO
    for release in releases:
        about = {"name": release.name, "requires": list(release.requires), **release.about}
        files = {f"{release.name.replace('-', '_')}.py": release.code}
        if release.hooks is None:
            archive = fakes.wheel(shelf, release.version, files, about)
        else:
            archive = fakes.sdist(shelf, release.version, files, {**about, "hooks": release.hooks})
        days[archive] = release.day
    _pages(folder, place, days)


def _pages(folder: Path, place: Path, days: Mapping[Path, str]) -> None:
    listed: dict[str, list[str]] = {}
    for path, day in sorted(days.items()):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        link = html.escape(f"{(place / 'files' / path.name).as_uri()}#sha256={digest}")
        entry = f'<a href="{link}" data-upload-time="{day}T12:00:00Z">{path.name}</a>'
        listed.setdefault(str(canonicalize_name(path.name.partition("-")[0])), []).append(entry)
    for name, entries in listed.items():
        page = folder / "simple" / name / "index.html"
        page.parent.mkdir(parents=True)
        page.write_text(f"<!DOCTYPE html><html><body>{''.join(entries)}</body></html>", encoding="utf-8")
