"""Guard and keeper."""

from __future__ import annotations

import marshal
import os
import sys

from harness.supervisor import SIZE
from harness.supervisor.sandbox import enter_namespaces, furnish, prctl
from harness.supervisor.tree import SupervisorError, end_all
from harness.supervisor.watch import CHUNK, Watch, write_all

TYPE_CHECKING = False
if TYPE_CHECKING:
    import signal
    from typing import Any
else:
    import _signal as signal  # without the enums, which take longer to make than all the rest of this process

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
LISTED = 100  # of the files written into sealed folders


def keep(order: dict[str, Any], early: bytes) -> dict[str, Any]:
    """The keeper's life; when it ends, so does what is left (by the namespace, or by the guard)."""
    if order["sandbox"].startswith("pid"):
        prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    prctl(PR_SET_CHILD_SUBREAPER, 1)
    try:
        layers = furnish(order)
        try:
            report = Watch(order).run(early)
            paths = (path for layer in layers for path in layer.written())
            return {**report, "written": [path for path, _ in zip(paths, range(LISTED), strict=False)]}
        finally:
            for layer in layers:
                layer.remove()
    except (SupervisorError, OSError) as error:
        return failure(error)


def guard(order: dict[str, Any], early: bytes) -> bytes:
    """The guard's life: start the keeper, pass its report on, and end what it could not."""
    prctl(PR_SET_CHILD_SUBREAPER, 1)
    told, report = os.pipe()
    enter_namespaces(order["sandbox"])
    keeper = os.fork()
    if keeper == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the end of the report's pipe is the end of the guard
        try:
            write_all(report, marshal.dumps(keep(order, early)))
        except BaseException:
            sys.excepthook(*sys.exc_info())
        finally:
            os._exit(0)
    os.close(report)
    with open(told, "rb") as file:
        text = file.read()
    status = os.waitpid(keeper, 0)[1]
    if not order["sandbox"].startswith("pid"):
        end_all({})
    if not text or status:
        return marshal.dumps(failure(f"the keeper ended with {os.waitstatus_to_exitcode(status)}"))
    return text


def failure(error: object) -> dict[str, Any]:
    """The report where the supervisor is at fault, or what it was given."""
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
    """What was read, and more until it is at least so long."""
    while len(text) < size:
        data = os.read(0, CHUNK)
        if not data:
            sys.exit("the harness is gone")
        text += data
    return text
