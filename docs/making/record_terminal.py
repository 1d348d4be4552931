"""Record a terminal in which the commands of the README are typed and run, as an animated SVG.

    python docs/making/record_terminal.py dist/terminal.svg

The commands are really run, in a folder of their own, as `run_examples.py` runs them; their whole output is shown. The
site shows the recording on its first page where there is one.
"""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import run_examples

PAGE = run_examples.ROOT / "README.md"
KEY = 0.04
"""Seconds between two typed characters."""
PAUSE = 4.0
"""Seconds for a reader after each output."""
CLEAR = "\033[2J\033[H"
SCREEN = "100x34"
PLAY = "--play"


def main(arguments: Sequence[str]) -> int:
    """Write the recording to the file that the arguments name and return 0; with PLAY, play into this terminal."""
    if list(arguments) == [PLAY]:
        with run_examples.workplace(network=False) as place:
            for example in run_examples.commands(PAGE, place, network=False):
                play(example.command, place)
        return 0
    (out,) = arguments
    Path(out).parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "termtosvg", out, "-g", SCREEN, "-D", "3000", "-t", "window_frame"]
    # The recorder needs a terminal, which a CI job has not.
    status = pty.spawn([*command, "-c", f"{sys.executable} {__file__} {PLAY}"], lambda fd: os.read(fd, 1024))
    return os.waitstatus_to_exitcode(status)


def play(command: str, place: run_examples.Workplace) -> None:
    """Type a command, run it, and wait for the reader."""
    sys.stdout.write(f"{CLEAR}$ ")
    for character in command:
        sys.stdout.write(character)
        sys.stdout.flush()
        time.sleep(KEY)
    print(flush=True)
    subprocess.run(["bash", "-c", command], cwd=place.folder, env=place.environment, check=False)
    time.sleep(PAUSE)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
