"""Find files of an environment that changed since its install: by a failing disk, or by a probe that reached them.

Each file is held against the RECORD of its package. A quick look takes sizes, and hashes of Python code; a thorough
one hashes every file.
"""

from __future__ import annotations

import base64
import csv
import hashlib
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from packaging.utils import canonicalize_name

from harness.machine.files.guarded_files import head, text
from harness.model.hostile_data import Unreadable, raise_unreadable

CONFIG, PYTHON = "pyvenv.cfg", "bin/python"
MOST_RECORD, MOST_CONFIG = 64 << 20, 1 << 16


def find_damage(environment: Path, *, thorough: bool) -> Mapping[str, str]:
    """Return the files that are not as RECORD has them, relative to the environment, each with its package's name.

    A RECORD that lists nothing, or cannot be read, is one of them.
    """
    damage, inside = {}, f"{environment}/"
    for site in environment.glob("lib/python*/site-packages"):
        for about in site.glob("*.dist-info"):
            record, package = about / "RECORD", str(canonicalize_name(about.name.partition("-")[0]))
            rows = [*_rows(record)]
            if not rows:
                damage[record.relative_to(environment).as_posix()] = package
            for name, mark, size in rows:
                path = os.path.normpath(f"{site}/{name}")  # thousands of files: `Path` would take most of the time
                if path.startswith(inside) and not _matches_record(path, mark, size, thorough=thorough):
                    damage[path[len(inside) :]] = package
    return dict(sorted(damage.items()))


def foundation(environment: Path) -> str | None:
    """Return what makes Python an environment of its own: its configuration and what it is a link to."""
    try:
        target = os.path.realpath(environment / PYTHON, strict=True)
        return f"{target}\n{text(environment / CONFIG, MOST_CONFIG)}"
    except (OSError, Unreadable):
        return None


def replacing(environment: Path) -> str | None:
    """Return the package that has a file in the place of what makes Python an environment of its own."""
    for site in environment.glob("lib/python*/site-packages"):
        for record in sorted(site.glob("*.dist-info/RECORD")):
            places = {os.path.normpath(site / name) for name, _, _ in _rows(record)}
            if places & {str(environment / CONFIG), str(environment / PYTHON)}:
                return record.parent.name.removesuffix(".dist-info").replace("-", " ", 1)
    return None


def _rows(record: Path) -> Iterator[tuple[str, str, str]]:
    with suppress(Unreadable):
        content = text(record, MOST_RECORD)
        with raise_unreadable():
            rows = [row for row in csv.reader(content.splitlines()) if len(row) == 3]
        yield from ((name, mark, size) for name, mark, size in rows if "=" in mark)


def _matches_record(path: str, mark: str, size: str, *, thorough: bool) -> bool:
    try:
        about = os.lstat(path)
    except (OSError, ValueError):  # no name that a file could have
        return False
    # Cut to 20 digits: `int` refuses numbers of more than 4,300.
    if not stat.S_ISREG(about.st_mode) or (size.isdigit() and about.st_size != int(size[:20])):
        return False
    if not thorough and not path.endswith(".py"):
        return True
    method, _, wanted = mark.partition("=")
    return method not in hashlib.algorithms_guaranteed or _hash(path, method) in {wanted, ""}


def _hash(path: str, method: str) -> str:
    try:
        if path.endswith(".py"):
            digest = hashlib.new(method, head(path, MOST_RECORD)).digest()
        else:
            with open(path, "rb") as file:  # noqa: PTH123 - thousands of files
                digest = hashlib.file_digest(file, method).digest()
    except (Unreadable, OSError):
        return "unreadable"
    except TypeError:  # a method that takes a length
        return ""
    return base64.urlsafe_b64encode(digest).decode().rstrip("=")
