"""Start Python alone in an environment: what is installed may end it before any check is reached.

A `.pth` file or a `sitecustomize` runs whenever Python starts. Where the same interpreter starts without them, and
does not with them, the packages are at fault, not the harness.
"""

from __future__ import annotations

from harness.machine import process
from harness.machine.files import guarded_files
from harness.machine.files.scratch_folders import scratch_folder
from harness.probes import launch
from harness.standalone.failures.lines import decisive_line, describe_death, shorten_line

STARTED = "simmatrix: Python has started"
PROGRAM = (
    "import atexit, faulthandler, gc, importlib, json, os, platform, re, signal, sys, time, traceback, warnings; "
    f"print({STARTED!r}, flush=True)"
)
"""The imports of a probe before it imports a package, all of the standard library."""

LIMITS = process.Limits(seconds=60.0, memory_mb=2000)
ALONE, WITH_PACKAGES = ("-s", "-S"), ("-s",)
"""Python without what is installed, and with it: both heed the variables of the case, which may be what stops it."""


def broken_by_packages(site: launch.Site) -> str | None:
    """Return why Python does not start with what is installed; None where it starts, or where it never does."""
    _, started, _ = _start(site, ALONE)
    if not started:
        return None
    done, started, text = _start(site, WITH_PACKAGES)
    if started or done.killed or done.timed_out or done.out_of_memory:
        return None
    line = decisive_line(text) or describe_death(done.exit_code, done.signal, text)
    return shorten_line(f"Python does not start with what is installed: {line}")


def _start(site: launch.Site, options: tuple[str, ...]) -> tuple[process.Completed, bool, str]:
    with scratch_folder() as scratch:
        with launch.set_up(site, scratch, "start") as place:
            done = process.run(place.command((*options, "-c", PROGRAM), LIMITS))
        text = guarded_files.log_text(done.log)
    return done, done.exit_code == 0 and STARTED in text, text
