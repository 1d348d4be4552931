"""Provide a display for one run: an X server of our own without a screen, which ends with it, or the user's display.

Records and keys hold a word for it, `virtual` or `own`, never a number: what was measured is the same at each.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep

from msgspec import Struct

from harness.machine.files.guarded_files import log_text
from harness.machine.process import Command, Completed, Limits, Profile, Running, start
from harness.model import replace

VARIABLE, AUTHORITY = "DISPLAY", "XAUTHORITY"
VIRTUAL, OWN = "virtual", "own"
SERVER = "Xvfb"
SCREEN = "1280x1024x24"
"""As large as what gym and its like open windows for, in the depth that OpenGL needs."""

FIRST_NUMBER, NUMBERS = 10_000, 49_000
"""Display numbers of ours. A server takes the socket of a number from one that it does not see, in another network
namespace with the same /tmp (a container that was given the user's X socket): so it is one that hardly anybody has."""

SERVERS = (
    "PATH",
    "HOME",
    "TMPDIR",
    "LANG",
    "LD_LIBRARY_PATH",
    "LIBGL_",
    "MESA_",
    "GALLIUM_",
    "XKB_",
    "__EGL_",
    "__GLX_",
)
"""Prefixes of variables of the caller's that a display server inherits; its tokens are left out."""

SOCKETS = Path("/tmp/.X11-unix")
PATIENCE_SECONDS, POLL_SECONDS = 20.0, 0.005
# A server ends with the run that it serves. Every command needs a limit, and this one is never to be reached.
LONGEST_SECONDS = 30 * 86400.0
MEMORY_MB = 2000


class NoDisplayError(Exception):
    """The X server did not start."""


class DisplayedCommand(Struct, frozen=True, kw_only=True):
    """A command whose display is up; `server` is its own X server, if it has one.

    `places` maps the display to the text that evidence shows instead: its number says nothing.
    """

    command: Command
    server: Running | None = None
    places: Mapping[str, str] = {}

    def lost(self) -> str | None:
        """Return how the server ended, or None if it runs.

        A failure to draw without its server says nothing about the code that drew.
        """
        ended = self.server.poll() if self.server else None
        return f"the virtual display {describe_end(ended)}" if ended else None


@contextmanager
def open_display(command: Command, folder: Path) -> Iterator[DisplayedCommand]:
    """Provide the display that a command's `DISPLAY` names while the block lasts; a server's files go into `folder`.

    Raises NoDisplayError.
    """
    word = command.env.get(VARIABLE)
    if word == VIRTUAL:
        with _server(folder) as (running, number):
            opened = _with(command, number, {AUTHORITY: str(folder / "authority")})
            yield DisplayedCommand(command=opened, server=running, places={number: ":0"})
    elif word:
        yield DisplayedCommand(command=_with(command, (users() or "") if word == OWN else word, authority()))
    else:
        yield DisplayedCommand(command=command)


def _with(command: Command, name: str, authority: Mapping[str, str]) -> Command:
    return replace(command, env={**authority, **command.env, VARIABLE: name})


def program() -> str | None:
    """Return the path of the X server for virtual displays; None if it is not installed."""
    return shutil.which(SERVER)


def users() -> str | None:
    """Return the display that the user sits at, or None."""
    return os.environ.get(VARIABLE) or None


def authority() -> dict[str, str]:
    """Return the variable that lets a run, whose HOME is another, open the user's display."""
    usual = Path(os.environ.get("HOME", "/"), ".Xauthority")
    path = os.environ.get(AUTHORITY) or (str(usual) if usual.exists() else None)
    return {AUTHORITY: path} if path else {}


@contextmanager
def _server(folder: Path) -> Iterator[tuple[Running, str]]:
    """Start a server and yield it with its display; it is reached by its socket alone and with its cookie."""
    executable = program()
    if not executable:
        message = f"no {SERVER}"
        raise NoDisplayError(message)
    folder.mkdir(parents=True, exist_ok=True)
    number = folder / "number"
    number.unlink(missing_ok=True)
    (folder / "authority").write_bytes(_entry(secrets.token_bytes(16)))
    name = f":{FIRST_NUMBER + secrets.randbelow(NUMBERS)}"
    arguments = (name, "-displayfd", "3", "-screen", "0", SCREEN, "-nolisten", "tcp", "-noreset", "-auth", "authority")
    command = Command(
        # The supervisor passes on no descriptor beyond the standard three, so a shell opens the one for -displayfd.
        argv=("/bin/sh", "-c", f'exec "$0" "$@" 3> {number.name}', executable, *arguments),
        cwd=folder,
        env={name: value for name, value in os.environ.items() if name.startswith(SERVERS)},
        limits=Limits(seconds=LONGEST_SECONDS, memory_mb=MEMORY_MB),
        log=folder / "log.txt",
        profile=Profile.HOST,
    )
    with start(command) as running:
        display_name = _await_display(running, number)
        try:
            yield running, display_name
        finally:
            (SOCKETS / f"X{name[1:]}").unlink(missing_ok=True)  # which a server that is killed leaves behind


def _await_display(running: Running, number: Path) -> str:
    """Wait until the server can be reached, and return the name of its display. Raises NoDisplayError."""
    until = monotonic() + PATIENCE_SECONDS
    while monotonic() < until:
        text = log_text(number)
        if text.endswith("\n"):
            return f":{text.strip()}"
        ended = running.poll()
        if ended:
            last = [*log_text(running.log).split("\n"), ""]
            words = next((line.strip() for line in reversed(last) if line.strip()), "")
            message = f"{SERVER} {describe_end(ended)}{f': {words}' if words else ''}"
            raise NoDisplayError(message)
        sleep(POLL_SECONDS)
    message = f"{SERVER} could not be reached within {PATIENCE_SECONDS:g} s"
    raise NoDisplayError(message)


def describe_end(done: Completed) -> str:
    """Say how a process ended."""
    if done.killed:
        return f"was ended: {done.killed}"
    return f"crashed with signal {done.signal}" if done.signal else f"ended with exit code {done.exit_code}"


def _entry(cookie: bytes) -> bytes:
    """Return an entry of an authority file that holds for every host and number: family, then counted texts."""
    texts = (b"", b"", b"MIT-MAGIC-COOKIE-1", cookie)
    return b"\xff\xff" + b"".join(len(text).to_bytes(2, "big") + text for text in texts)
