"""Faults that a stranger tried last: an index that drips, a HOME that is removed, a working folder that is gone."""

from __future__ import annotations

import time
from contextlib import suppress
from http.server import BaseHTTPRequestHandler

from benchmarks.faults import Desk, FaultResult, fault
from benchmarks.faults.indexes import PAGE, SECTION, on, serve_index

SOON = 10
"""Seconds within which a command that is asked to end has ended."""


def drip(handler: BaseHTTPRequestHandler) -> None:
    """Send 18 bytes every 0.2 seconds."""
    handler.send_response(200)
    handler.send_header("Content-Type", "text/html")
    handler.end_headers()
    with suppress(OSError):
        for _ in range(125):
            handler.wfile.write(b"<a href='x'>x</a>\n")
            time.sleep(0.2)


@fault(
    "s29",
    section=SECTION,
    done="the index sends 18 bytes of its page every 0.2 seconds and does not end for 25 seconds",
    promise="SIGTERM ends the run within seconds; left alone, it ends inconclusive",
    limit=300,
)
def dripping_index(desk: Desk) -> FaultResult:
    """End a run that waits for the page; run it again to its end."""
    with serve_index(desk) as (index, text):
        matrix = desk.matrix("m", text)
        index.trouble = on(PAGE, drip)
        with desk.started("run", matrix, UV_HTTP_TIMEOUT="5") as process:
            while not index.request_count:
                time.sleep(0.1)
            time.sleep(1)
            signal_time = time.monotonic()
            process.terminate()
            code = process.wait(60)
            took = time.monotonic() - signal_time
        came = desk.check_verdicts(desk.measure(matrix, UV_HTTP_TIMEOUT="5"), code={3}, odd={"inconclusive"})
    return FaultResult(f"SIGTERM: {code} after {took:.0f} s; {came.what}", came.held and code == 143 and took < SOON)


@fault(
    "s25",
    section="bad input",
    done="the working folder is removed before `run` and `doctor` are typed",
    promise="one sentence, exit 2",
    limit=120,
)
def removed_working_folder(desk: Desk) -> FaultResult:
    """Type two verbs in a folder that is gone."""
    matrix = desk.hostile()
    gone = desk.under("sh", "-c", 'mkdir gone && cd gone && rmdir ../gone && exec "$@"', "sh")
    ran = [gone.run("run", matrix), gone.run("doctor")]
    parts = [f"exit {one.code}: {one.err.strip()}" for one in ran]
    held = all(one.code == 2 and one.err.count("\n") == 1 and "does not exist any more" in one.err for one in ran)
    return FaultResult("; ".join(parts), held)


@fault(
    "s31",
    section="what is printed",
    done="COLUMNS says 99999999, FORCE_COLOR is set",
    promise="the report of a run is shown within seconds",
    limit=180,
)
def endless_columns(desk: Desk) -> FaultResult:
    """Show a report again on a terminal of absurd width."""
    matrix = desk.hostile()
    desk.measure(matrix)
    began = time.monotonic()
    ran = desk.run("run", matrix, COLUMNS="99999999", FORCE_COLOR="1")
    took = time.monotonic() - began
    longest = max(map(len, ran.out.splitlines()))
    return FaultResult(f"exit {ran.code}, {took:.0f} s", ran.code == 0 and took < SOON and longest < 5000)


@fault(
    "s1",
    section="hostile probes",
    done="a probe removes its HOME and asks Python where temporary files go",
    promise="into its own TMPDIR, never the machine's; its neighbour works",
    limit=120,
)
def removed_home(desk: Desk) -> FaultResult:
    """Remove nothing but the HOME, and only where it is below the desk."""
    matrix = desk.hostile(
        top="import shutil, tempfile",
        step=f"""
        home = os.environ["HOME"]
        if not home.startswith({str(desk.folder)!r} + "/"):
            raise RuntimeError("HOME is not its own: " + home)
        shutil.rmtree(home, ignore_errors=True)
        tempfile.tempdir = None
        if not tempfile.gettempdir().startswith({str(desk.folder)!r} + "/"):
            raise RuntimeError("its temporary files go to " + tempfile.gettempdir())
        """,
    )
    came = desk.check_verdicts(desk.measure(matrix), hx={"works", "broken", "inconclusive"}, neighbour={"works"})
    return FaultResult(
        came.what, came.held and "temporary files go" not in came.what and "not its own" not in came.what
    )
