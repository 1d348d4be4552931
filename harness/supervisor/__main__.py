"""Guard and keeper."""

from __future__ import annotations

import json
import os
import signal
import sys

if __name__ == "__main__":  # run by path: the package is found last, after the standard library
    sys.path.append(os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))))

from harness.supervisor.sandbox import enter_namespaces, furnish, prctl
from harness.supervisor.tree import SupervisorError, end_all
from harness.supervisor.watch import CHUNK, Watch, write_all

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

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


def guard(order: dict[str, Any], early: bytes) -> dict[str, Any]:
    """The guard's life: start the keeper, pass its report on, and end what it could not."""
    prctl(PR_SET_CHILD_SUBREAPER, 1)
    told, report = os.pipe()
    enter_namespaces(order["sandbox"])
    keeper = os.fork()
    if keeper == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the end of the report's pipe is the end of the guard
        try:
            write_all(report, json.dumps(keep(order, early)).encode())
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
    return json.loads(text) if text else failure(f"the keeper ended with {os.waitstatus_to_exitcode(status)}")


def failure(error: object) -> dict[str, Any]:
    """The report where the supervisor is at fault, or what it was given."""
    return {"killed": f"supervisor: {error}"}


def main() -> None:
    """Read the order, obey it, report."""
    text = b""
    while b"\n" not in text:
        data = os.read(0, CHUNK)
        if not data:
            sys.exit("the harness is gone")
        text += data
    line, _, early = text.partition(b"\n")
    try:
        report = guard(json.loads(line), early)
    except (SupervisorError, OSError) as error:
        report = failure(error)
    write_all(1, json.dumps(report).encode())


if __name__ == "__main__":
    main()
