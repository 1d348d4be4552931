"""Run the guard and the keeper, the two processes above the command."""

from __future__ import annotations

import marshal
import os
import select
import sys
import time

from harness.machine.supervisor import SIZE
from harness.machine.supervisor.rights import ready_gpu
from harness.machine.supervisor.sandbox import enter_namespaces, furnish, prctl
from harness.machine.supervisor.tree import SupervisorError, end_all
from harness.machine.supervisor.watch import CHUNK, Watch, write_all

TYPE_CHECKING = False
if TYPE_CHECKING:
    import signal
    from typing import Any
else:
    import _signal as signal  # without the enums, which take longer to make than all the rest of this process

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
LISTED = 100  # of the files written into sealed folders
LOOK = 1.0  # seconds between two looks at the keeper
PATIENCE = 15.0  # seconds that the keeper has to end everything, once the harness is gone


def keep(order: dict[str, Any], early: bytes, parent: int) -> dict[str, Any]:
    """Run the keeper and return its report; when it ends, so does what is left (by the namespace, or by the guard).

    When the guard dies, a namespace ends at once; without one the keeper is woken, in case it was stopped, and sees it.
    """
    apart = order["sandbox"].startswith("pid")
    prctl(PR_SET_PDEATHSIG, signal.SIGKILL if apart else signal.SIGCONT)
    prctl(PR_SET_CHILD_SUBREAPER, 1)
    try:
        layers = furnish(order)
        try:
            report = Watch(order, 0 if apart else parent).run(early)
            paths = (path for folder in order["sealed"] if folder in layers for path in layers[folder].written())
            return {
                **report,
                "written": [path for path, _ in zip(paths, range(LISTED), strict=False)],
                "compiled": [path for folder in order["byte_code"] for path in layers[folder].compiled()],
            }
        finally:
            for layer in layers.values():
                layer.remove()
    except (SupervisorError, OSError) as error:
        return failure(error)


def guard(order: dict[str, Any], early: bytes) -> bytes:
    """Run the guard: start the keeper, return its report, and end the processes that it could not."""
    prctl(PR_SET_CHILD_SUBREAPER, 1)
    if order["confined"]:
        ready_gpu()
    reader, report = os.pipe()
    enter_namespaces(order)
    parent = os.getpid()
    keeper = os.fork()
    if keeper == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the end of the report's pipe is the end of the guard
        try:
            write_all(report, marshal.dumps(keep(order, early, parent)))
        except BaseException:
            # The child must never return into the code of the guard: every exception ends here, and the log shows it.
            sys.excepthook(*sys.exc_info())
        finally:
            os._exit(0)
    os.close(report)
    text, status = report_of(keeper, reader)
    if not order["sandbox"].startswith("pid"):
        end_all({})
    if not text or status:
        return marshal.dumps(failure(f"the keeper ended with {os.waitstatus_to_exitcode(status)}"))
    return text


def report_of(keeper: int, reader: int) -> tuple[bytes, int]:
    """Read the report of the keeper until its end: (report, status). A stopped keeper is woken.

    Once the harness is gone the keeper has a while to end everything; then it is killed.
    """
    poller = select.poll()
    poller.register(reader, select.POLLIN)
    poller.register(0, 0)  # its end alone; what comes there is the keeper's to read
    text, patience = b"", float("inf")
    while True:
        for descriptor, _ in poller.poll(LOOK * 1000):
            if descriptor == 0:
                poller.unregister(0)
                patience = time.monotonic() + PATIENCE
                continue
            data = os.read(reader, CHUNK)
            if not data:
                return text, ended(keeper)
            text += data
        if time.monotonic() > patience:
            os.kill(keeper, signal.SIGKILL)
        elif stopped(keeper):
            os.kill(keeper, signal.SIGCONT)


def stopped(pid: int) -> bool:
    """Tell whether a child was stopped; one that has ended is left to be waited for."""
    try:
        status = os.waitid(os.P_PID, pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:
        return False
    return status is not None


def ended(pid: int) -> int:
    """Wait for the end of a child, and return its status; wake it if it is stopped on its way."""
    while True:
        child, status = os.waitpid(pid, os.WUNTRACED)
        if not os.WIFSTOPPED(status):
            return status
        os.kill(child, signal.SIGCONT)


def failure(error: object) -> dict[str, Any]:
    """Return the report for a fault of the supervisor, or of the order that it was given."""
    return {"killed": f"supervisor: {error}"}


def main() -> None:
    """Read the order, obey it, report."""
    text = received(b"", SIZE)
    size = SIZE + int.from_bytes(text[:SIZE], "little")
    text = received(text, size)
    try:
        report = guard(marshal.loads(text[SIZE:size]), text[size:])
    except (SupervisorError, OSError) as error:
        report = marshal.dumps(failure(error))
    write_all(1, report)


def received(text: bytes, size: int) -> bytes:
    """Read the order until at least `size` bytes are there, and return them; `text` was read before."""
    while len(text) < size:
        data = os.read(0, CHUNK)
        if not data:
            sys.exit("the harness is gone")
        text += data
    return text
