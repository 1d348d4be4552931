"""Run one fault apart: in namespaces of its own where this machine allows it, with a deadline."""

from __future__ import annotations

import fcntl
import functools
import hashlib
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import traceback
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ._declaring import Fault, FaultResult, Unavailable
from ._desk import Desk, last_line

ROOT = Path(__file__).parents[2]
APART = ("unshare", "--mount", "--pid", "--ipc", "--net", "--fork", "--kill-child", "--mount-proc")
GRACE, UP = 5.0, 0x41


@functools.cache
def namespace_prefix() -> tuple[str, ...]:
    """Return the prefix of a command that gives it mounts, processes and network of its own; empty if not allowed."""
    try:
        allowed = subprocess.run((*APART, "true"), capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        allowed = False
    return APART if allowed else ()


def digest(fault: Fault) -> str:
    """Identify the code that a result belongs to: the harness, its data, the desk and the fault's module."""
    texts = hashlib.sha256()
    here = Path(__file__).parent
    module = here / f"{fault.module}.py"
    for path in (*sorted((ROOT / "harness").rglob("*.py")), *sorted(here.glob("_*.py")), module):
        texts.update(path.read_bytes())
    return texts.hexdigest()[:16]


def run(fault: Fault, wheels: Path, folder: Path) -> dict[str, Any]:
    """Do a fault in a process of its own and return its row."""
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / f"{fault.module}.{fault.name}.json"
    out.unlink(missing_ok=True)
    command = (*namespace_prefix(), sys.executable, "-m", "benchmarks.faults", "--do", f"{fault.module}.{fault.name}")
    start, place = time.monotonic(), tempfile.mkdtemp(prefix="fault-")
    command = (*command, "--wheels", str(wheels), "--into", str(out), "--at", place)
    process = subprocess.Popen(command, cwd=ROOT, process_group=0)
    try:
        process.wait(fault.limit)
    except subprocess.TimeoutExpired:
        _end(process)
        return row(fault, FaultResult(f"no end within {fault.limit:.0f} s", False), time.monotonic() - start)
    finally:
        clear(Path(place))
    try:
        return dict(json.loads(out.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        came = FaultResult(f"the process that did it ended with {process.returncode}", False)
        return row(fault, came, time.monotonic() - start)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill `unshare`, and with it all in its namespace, or the group where there is none."""
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def clear(place: Path) -> None:
    """Remove what a fault left, however deep or locked its folders are; its mounts went with its namespace."""
    for command in (("chattr", "-R", "-i"), ("rm", "-rf")):
        subprocess.run((*command, str(place)), stderr=subprocess.DEVNULL, check=False)


def do(fault: Fault, wheels: Path, into: Path, folder: Path) -> None:
    """Do a fault in this process and write its row."""
    if namespace_prefix() and os.getpid() == 1:
        loopback()
    for number in (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)  # whoever runs this in the background ignores some, and so would all
    start = time.monotonic()
    folder.chmod(0o755)
    (folder / "desk").mkdir()
    desk = Desk(folder=folder / "desk", cache=folder / "cache", wheels=wheels)
    came = check_promises(desk, fault)
    into.write_text(json.dumps(row(fault, came, time.monotonic() - start)), encoding="utf-8")


def check_promises(desk: Desk, fault: Fault) -> FaultResult:
    """Do a fault and hold the promises that every one makes."""
    try:
        came = fault.do(desk)
    except Unavailable as missing:
        return FaultResult(f"not tried: needs {missing}", True)
    except Exception as broke:  # a broken promise often breaks the fault's own looking
        ends = [f"; the last command ended with {ran.code}: {last_line(ran.err)}" for ran in desk.ran[-1:]]
        return FaultResult("".join((f"{type(broke).__name__}: {last_line(str(broke))} {_where(broke)}", *ends)), False)
    words = [came.what]
    bugs = [ran for ran in desk.ran if ran.code == 4 or "Traceback (most recent call last)" in ran.err]
    if bugs:
        words.append(f"a command of the harness broke: exit {bugs[0].code}, {last_line(bugs[0].err)}")
    left = _left() if os.getpid() == 1 else []
    if left:
        words.append(f"left behind: {', '.join(left[:5])}")
    return FaultResult("; ".join(words), came.held and not bugs and not left)


def _where(broke: Exception) -> str:
    frame = traceback.extract_tb(broke.__traceback__)[-1]
    return f"({Path(frame.filename).name}:{frame.lineno})"


def _left() -> list[str]:
    """Return processes of this namespace that outlived the commands of the fault by some seconds."""
    deadline = time.monotonic() + GRACE
    while True:
        _reap()
        left = [path for path in Path("/proc").glob("[0-9]*") if path.name != "1"]
        if not left or time.monotonic() > deadline:
            return [_command(path) for path in left]
        time.sleep(0.1)


def _reap() -> None:
    """Collect children and, as the first process of a namespace, orphans."""
    while True:
        try:
            if os.waitpid(-1, os.WNOHANG)[0] == 0:
                return
        except ChildProcessError:
            return


def _command(path: Path) -> str:
    try:
        words = (path / "cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace")
    except OSError:
        words = "ended"
    return f"{path.name} {words.strip()[:80]}"


def loopback() -> None:
    """Start the loopback of a new network namespace."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control_socket:
        fcntl.ioctl(control_socket, 0x8914, struct.pack("16sh", b"lo", UP))


def texts(fault: Fault) -> dict[str, str]:
    """Return the texts of a fault's declaration by name."""
    words = {name: getattr(fault, name) for name in ("row", "section", "done", "promise", "documented")}
    return {"fault": f"{fault.module}.{fault.name}", **words}


def row(fault: Fault, came: FaultResult, seconds: float) -> dict[str, Any]:
    """Return the row of the table."""
    what, held = came
    return {
        **texts(fault),
        "came": what,
        "held": held,
        "tried": not what.startswith("not tried: "),
        "seconds": round(seconds, 1),
        "at": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}",
        "digest": digest(fault),
    }
