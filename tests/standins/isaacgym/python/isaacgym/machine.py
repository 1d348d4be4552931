"""Say what this machine is, which reported failure each pair of its devices has, and how native code fails."""

import json
import os
import signal
import time
from pathlib import Path

FOLDER = Path(__file__).parent


def failure(part):
    """Return the report on a pair of devices (`c0g1`), or of `gymtorch`."""
    planned = json.loads((FOLDER / "machine.json").read_text(encoding="utf-8"))
    reported = json.loads((FOLDER / "failures.json").read_text(encoding="utf-8"))
    return reported[planned.get(part, "sound")]


def say(lines):
    """Print as native code does: past Python."""
    for line in lines:
        os.write(2, (line + "\n").encode("utf-8"))


def crash():
    """End as a segmentation fault does."""
    os.kill(os.getpid(), signal.SIGSEGV)


def hang():
    """Wait for ever."""
    while True:
        time.sleep(60)
