"""Look up the system packages that a cell needs, by Debian's names, and say how to install them."""

from __future__ import annotations

import shutil
from functools import cache

from harness.machine import this_machine
from harness.machine.files.scratch_folders import scratch_folder
from harness.machine.process import Command, Limits, Profile, run
from harness.model import Finding, Level

DPKG = "dpkg-query"


def describe_missing(names: tuple[str, ...]) -> str | None:
    """Return a sentence with the missing packages and their `apt install`; None if none is missing or dpkg is."""
    installed_names = installed_packages(names)
    lacking = [] if installed_names is None else [name for name in names if name not in installed_names]
    if not lacking:
        return None
    return f"no {', '.join(lacking)} here: run `apt install {' '.join(lacking)}`"


def note_unchecked(names: tuple[str, ...]) -> tuple[Finding, ...]:
    """Return a note if there is no dpkg-query to ask: the cell is run, and fails if a package is missing."""
    if not names or installed_packages(names) is not None:
        return ()
    text = f"whether {', '.join(names)} are here could not be looked up: this system has no {DPKG}"
    return (Finding(check="install.system", level=Level.NOTE, text=text),)


def installed_packages(names: tuple[str, ...]) -> frozenset[str] | None:
    """Return the packages among `names` that are installed; None where the system has no dpkg-query."""
    program = shutil.which(DPKG)
    return _installed(program, names) if names and program else frozenset() if program else None


@cache
def _installed(program: str, names: tuple[str, ...]) -> frozenset[str]:
    with scratch_folder() as folder:
        done = run(
            Command(
                argv=(program, "--show", "--showformat", "${Package} ${db:Status-Status}\\n", *names),
                cwd=folder,
                env=this_machine.ENVIRONMENT,
                limits=Limits(seconds=60),
                log=folder / "log",
                profile=Profile.HOST,
            )
        )
        lines = [line.split() for line in done.log.read_text(encoding="utf-8", errors="replace").splitlines()]
    return frozenset(line[0] for line in lines if line[1:] == ["installed"])
