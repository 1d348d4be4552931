"""Kills and signals: of the command, of its supervisors, of a probe, of a build; in both kinds of sandbox."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import wheelhouse
from commandline import PATIENCE, CommandResult, find_descendants, wait_for

from benchmarks.faults import Desk, FaultResult, fault

KILLS, PROBES, BUILDS = "kills and signals", "hostile probes", "wheels and builds"
GOES_ON = "the same command goes on from there"
OUTSIDE = "killed by SIGKILL from outside"
WAITING = """
open({reached!r}, "w").close()
while not os.path.exists({gate!r}):
    time.sleep(0.02)
"""


@dataclass(frozen=True, kw_only=True, slots=True)
class Chain:
    """A command in the middle of a cell: the harness, the guard, the keeper, the probe."""

    desk: Desk
    harness: subprocess.Popen[str]
    guard: int
    keeper: int
    probe: int

    def end(self) -> CommandResult:
        """Wait for the end of the command."""
        out, err = self.harness.communicate(timeout=PATIENCE)
        self.desk.ran.append(CommandResult(code=self.harness.returncode, out=out, err=err))
        return self.desk.ran[-1]

    def open_gate(self) -> None:
        """Let the probe go on."""
        (self.desk.folder / "gate").touch()


def waiting(desk: Desk, case: str = "") -> Path:
    """Make a matrix whose hostile cell waits in its first step until a file `gate` is there."""
    step = WAITING.format(reached=str(desk.folder / "reached"), gate=str(desk.folder / "gate"))
    return desk.hostile(checks=("single",), step=step, case=case)


def command(pid: int) -> str:
    """Return the command line of a process, empty where it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text(errors="replace")
    except OSError:
        return ""


def parent(pid: int) -> int:
    """Return the parent of a process."""
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def probe_below(pid: int) -> int:
    """Wait for the probe of the cell that waits, and return it."""
    probes: list[int] = []

    def there() -> bool:
        probes[:] = [each for each in find_descendants(pid) if "bootstrap.py" in command(each)]
        return bool(probes)

    wait_for(there)
    return probes[0]


@contextmanager
def measuring(desk: Desk, matrix: Path, sandbox: str = "", **variables: str) -> Iterator[Chain]:
    """Start a run of the cell that waits, and find the processes of its probe once that has come so far."""
    reached = desk.folder / "reached"
    reached.unlink(missing_ok=True)
    arguments = ("run", matrix, "-k", "*-hx", "--json")
    with desk.started(*arguments, HARNESS_SANDBOX=sandbox, **variables) as harness:
        wait_for(reached.exists)
        probe = probe_below(harness.pid)
        keeper = parent(probe)
        yield Chain(desk=desk, harness=harness, guard=parent(keeper), keeper=keeper, probe=probe)


def again(desk: Desk, matrix: Path, first: FaultResult, sandbox: str = "") -> FaultResult:
    """Measure once more with the gate open: the cell works, and is not taken from before."""
    (desk.folder / "gate").touch()
    ran = desk.measure(matrix, "-k", "*-hx", HARNESS_SANDBOX=sandbox)
    came = desk.check_verdicts(ran, code={0}, hx={"works"})
    fresh = came.held and not ran.cells("which")["hx"]["reused"]
    return FaultResult(f"{first.what}; once more: {came.what}", first.held and fresh)


def ended_by(desk: Desk, number: signal.Signals, code: int, times: int = 1) -> FaultResult:
    """Send a signal to a run whose first cell is done, and run it again."""
    matrix = waiting(desk)
    desk.measure(matrix, "-k", "*-neighbour")
    with measuring(desk, matrix) as chain:
        for _ in range(times):
            chain.harness.send_signal(number)
            time.sleep(0.03)
        ran = chain.end()
    is_announced = GOES_ON in ran.err or number == signal.SIGKILL
    came = FaultResult(f"exit {ran.code}, {ran.err.strip() or 'not a word'}", ran.code == code and is_announced)
    return again(desk, matrix, came)


@fault("1", section=KILLS, done="SIGKILL of `run` in the middle of a probe", promise="nothing stays, a rerun goes on")
def kill(desk: Desk) -> FaultResult:
    """Kill the command."""
    return ended_by(desk, signal.SIGKILL, -9)


@fault(
    "2",
    section=KILLS,
    done="SIGKILL of `run` at eight moments of its first two seconds, on one state",
    promise="a rerun gives the verdicts of an undisturbed run",
    limit=240,
)
def kill_at_any_moment(desk: Desk) -> FaultResult:
    """Kill the command early and late."""
    matrix = desk.hostile(checks=("single",))
    for tenths in (1, 3, 5, 8, 11, 14, 17, 20):
        with desk.started("run", matrix, "--json") as harness:
            time.sleep(tenths / 10)
            harness.kill()
            harness.communicate()
    return desk.check_verdicts(desk.measure(matrix), code={0}, hx={"works"}, neighbour={"works"})


@fault("4", section=KILLS, done="SIGTERM in the middle of a probe", promise="143 with a sentence, a rerun goes on")
def terminate(desk: Desk) -> FaultResult:
    """End the command as a service manager does."""
    return ended_by(desk, signal.SIGTERM, 143)


@fault("4a", section=KILLS, done="SIGTERM three times within 100 ms", promise="143 with a sentence, nothing stays")
def terminate_thrice(desk: Desk) -> FaultResult:
    """End the command by somebody impatient."""
    return ended_by(desk, signal.SIGTERM, 143, times=3)


@fault("4b", section=KILLS, done="SIGINT in the middle of a probe", promise="130 with a sentence, a rerun goes on")
def interrupt(desk: Desk) -> FaultResult:
    """End the command as Ctrl-C does."""
    return ended_by(desk, signal.SIGINT, 130)


@fault(
    "5",
    section=KILLS,
    done="SIGTERM at 24 moments of the first 0.6 s, while the command is still being loaded",
    promise="143 with a sentence, once Python runs our first line; never a traceback or a crash",
)
def terminate_at_once(desk: Desk) -> FaultResult:
    """End the command before it has begun."""
    return at_once(desk, signal.SIGTERM)


def at_once(desk: Desk, number: signal.Signals) -> FaultResult:
    """Send a signal at many early moments."""
    matrix = desk.hostile(checks=("single",))
    codes: dict[int, int] = {}
    silent = 0
    for step in range(24):
        with desk.started("run", matrix, "--json") as harness:
            time.sleep(0.02 + 0.025 * step)
            harness.send_signal(number)
            out, err = harness.communicate(timeout=PATIENCE)
        desk.ran.append(CommandResult(code=harness.returncode, out=out, err=err))
        codes[harness.returncode] = codes.get(harness.returncode, 0) + 1
        silent += harness.returncode == 143 and GOES_ON not in err
    return FaultResult(
        f"exit codes {codes}, {silent} without the sentence", codes.keys() <= {143, -number} and not silent
    )


@fault("6", section=KILLS, done="SIGHUP in the middle of a probe", promise="143 with a sentence, a rerun goes on")
def hang_up(desk: Desk) -> FaultResult:
    """End the command as a closed ssh session does."""
    return ended_by(desk, signal.SIGHUP, 143)


@fault(
    "6a",
    section=KILLS,
    done="the terminal of a run is closed in the middle of a probe",
    promise="143, nothing stays, a rerun goes on",
)
def close_terminal(desk: Desk) -> FaultResult:
    """Close the terminal that a run writes to."""
    matrix = waiting(desk)
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(desk.folder)
        words = (sys.executable, "-m", "harness", "run", str(matrix), "-k", "*-hx")
        os.execve(words[0], words, desk.environment({}))
    wait_for((desk.folder / "reached").exists)
    os.close(terminal)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return again(desk, matrix, FaultResult(f"exit {code}", code == 143))


@fault("7", section=KILLS, done="SIGHUP under nohup", promise="the run goes on to its end")
def hang_up_ignored(desk: Desk) -> FaultResult:
    """Close the session of a run that was told to stay."""
    matrix = waiting(desk)
    with measuring(desk.under("nohup"), matrix) as chain:
        chain.harness.send_signal(signal.SIGHUP)
        time.sleep(0.5)
        chain.open_gate()
        return desk.check_verdicts(chain.end(), code={0}, hx={"works"})


@fault("6b", section=KILLS, done="SIGHUP while the command is being loaded", promise="143 with a sentence, no crash")
def hang_up_at_once(desk: Desk) -> FaultResult:
    """Close the session at once."""
    return at_once(desk, signal.SIGHUP)


def supervisor_killed(desk: Desk, which: str, number: signal.Signals, sandbox: str = "") -> FaultResult:
    """Kill guard or keeper, or both: the cell is inconclusive, its processes are gone, a rerun works."""
    matrix = waiting(desk)
    with measuring(desk, matrix, sandbox) as chain:
        os.kill(chain.guard, signal.SIGSTOP)  # so that it cannot clear up after the keeper
        for name in which.split():
            os.kill(getattr(chain, name), number)
        os.kill(chain.guard, signal.SIGCONT)
        ran = chain.end()
        left = [pid for pid in (chain.guard, chain.keeper, chain.probe) if command(pid)]
    came = desk.check_verdicts(ran, code={3}, hx={"inconclusive"}, says="supervisor")
    return again(desk, matrix, FaultResult(f"{came.what}; {len(left)} left", came.held and not left), sandbox)


for row, which, sandbox in (
    ("10", "guard", ""),
    ("10s", "guard", "subreaper"),
    ("11", "keeper", ""),
    ("11s", "keeper", "subreaper"),
    ("58", "keeper guard", "subreaper"),
    ("58p", "keeper guard", ""),
):

    def killed(desk: Desk, which: str = which, sandbox: str = sandbox) -> FaultResult:
        """Kill supervisors."""
        return supervisor_killed(desk, which, signal.SIGKILL, sandbox)

    killed.__name__ = f"kill_{which.replace(' ', '_and_')}{'_subreaper' if sandbox else ''}"
    fault(
        row,
        section=KILLS,
        done=f"SIGKILL of the {which.replace(' ', ' and the ')}" + (", HARNESS_SANDBOX=subreaper" if sandbox else ""),
        promise="`inconclusive` that blames nobody, no process goes on, a rerun works",
    )(killed)


def shot(desk: Desk, times: int, sandbox: str = "") -> FaultResult:
    """Kill the probe once, or each time that it comes so far."""
    matrix = waiting(desk)
    with measuring(desk, matrix, sandbox) as chain:
        probe = chain.probe
        for count in range(times):
            if count:
                wait_for((desk.folder / "reached").exists)
                probe = probe_below(chain.harness.pid)
            (desk.folder / "reached").unlink()
            os.kill(probe, signal.SIGKILL)
        if times == 1:
            chain.open_gate()
            return desk.check_verdicts(chain.end(), code={0}, hx={"works"})
        came = desk.check_verdicts(chain.end(), code={3}, hx={"inconclusive"}, says=OUTSIDE)
    return again(desk, matrix, came, sandbox)


@fault(
    "12",
    section=KILLS,
    done="SIGKILL of a probe, whenever it runs (earlyoom, systemd-oomd, an administrator)",
    promise="`inconclusive` with words, never blamed, not reused by the rerun",
)
def shoot_probe(desk: Desk) -> FaultResult:
    """Kill the probe twice."""
    return shot(desk, 2)


@fault("12a", section=KILLS, done="SIGKILL of a probe, once", promise="it is run again and works")
def shoot_probe_once(desk: Desk) -> FaultResult:
    """Kill the probe once."""
    return shot(desk, 1)


@fault(
    "12s",
    section=KILLS,
    done="SIGKILL of a probe, whenever it runs, HARNESS_SANDBOX=subreaper",
    promise="`inconclusive` with words, never blamed, not reused by the rerun",
)
def shoot_probe_subreaper(desk: Desk) -> FaultResult:
    """Kill the probe twice where there are no namespaces."""
    return shot(desk, 2, "subreaper")


@fault(
    "12w",
    section=KILLS,
    done="SIGKILL of the workers of a vector environment, each time, by something outside",
    promise="`inconclusive` or `works`, the package is not blamed",
    limit=180,
)
def shoot_workers(desk: Desk) -> FaultResult:
    """Kill the workers of a vector environment as they come."""
    top = "import multiprocessing"
    make = """
if multiprocessing.parent_process():
    open({worker!r}, "w").close()
    time.sleep(30)
""".format(worker=str(desk.folder / "worker"))
    matrix = desk.hostile(checks=("single", "vector"), top=top, make=make)
    with desk.started("run", matrix, "-k", "*-hx", "--json") as harness:
        until = time.monotonic() + 120
        while harness.poll() is None and time.monotonic() < until:
            for probe in [pid for pid in find_descendants(harness.pid) if "bootstrap.py" in command(pid)]:
                if (desk.folder / "worker").exists():
                    for child in find_descendants(probe)[:1]:
                        os.kill(child, signal.SIGKILL)
            time.sleep(0.1)
        out, err = harness.communicate()
    desk.ran.append(CommandResult(code=harness.returncode, out=out, err=err))
    return desk.check_verdicts(desk.ran[-1], code={0, 3}, hx={"inconclusive", "works"})


@fault(
    "12b",
    section=KILLS,
    done="SIGKILL of the build of an sdist, each time, by something outside",
    promise="`inconclusive` with words, not `uninstallable`; a rerun works",
)
def shoot_build(desk: Desk) -> FaultResult:
    """Kill a build as often as it is tried."""
    return killed_build(desk, WAITING.format(reached=str(desk.folder / "reached"), gate=str(desk.folder / "gate")))


@fault(
    "89k",
    section=BUILDS,
    done="a build kills itself by SIGKILL",
    promise="`inconclusive` with words: nobody can tell it from a build that was killed",
)
def build_kills_itself(desk: Desk) -> FaultResult:
    """Kill the build from within."""
    matrix = sdist_matrix(desk, "os.kill(os.getpid(), 9)")
    return desk.check_verdicts(desk.measure(matrix), code={3}, hx={"inconclusive"}, neighbour={"works"}, says=OUTSIDE)


def sdist_matrix(desk: Desk, deed: str) -> Path:
    """Make a matrix whose package `hx` needs the sdist `built`, which does a deed while it is built."""
    hooks = f"import os, time\n\ndef files(entries):\n{indented(deed)}\n    return entries\n"
    wheelhouse.sdist(desk.shelf, "1.0", {"built.py": ""}, {"name": "built", "hooks": hooks, "static": True})
    matrix = desk.hostile(checks=("single",))
    text = matrix.read_text().replace('requirements = ["hx"]', 'requirements = ["hx", "built"]')
    matrix.write_text(text)
    return matrix


def indented(text: str) -> str:
    """Indent the lines of a function."""
    return "\n".join(f"    {line}" for line in text.strip().splitlines())


def killed_build(desk: Desk, deed: str) -> FaultResult:
    """Kill a build whenever it waits, then let it go on."""
    matrix = sdist_matrix(desk, deed)
    reached = desk.folder / "reached"
    with desk.started("run", matrix, "-k", "*-hx", "--json") as harness:
        while harness.poll() is None:
            if reached.exists():
                builds = [pid for pid in find_descendants(harness.pid) if "_in_process" in command(pid)]
                for pid in builds:
                    os.kill(pid, signal.SIGKILL)
                if builds:
                    reached.unlink()
            time.sleep(0.05)
        out, err = harness.communicate()
    desk.ran.append(CommandResult(code=harness.returncode, out=out, err=err))
    return again(desk, matrix, desk.check_verdicts(desk.ran[-1], code={3}, hx={"inconclusive"}, says=OUTSIDE))


def stopped(desk: Desk, who: str, sandbox: str = "") -> FaultResult:
    """Stop guard or keeper: the limit of the check ends the cell all the same."""
    matrix = waiting(desk, case="timeouts = { single = 3 }")
    with measuring(desk, matrix, sandbox) as chain:
        begun = time.monotonic()
        os.kill(getattr(chain, who), signal.SIGSTOP)
        ran = chain.end()
    seconds = time.monotonic() - begun
    came = desk.check_verdicts(ran, hx={"broken"}, says="no end within")
    return FaultResult(f"{came.what}, after {seconds:.0f} s", came.held and seconds < 30)


for row, which, sandbox in (
    ("13", "keeper", ""),
    ("13g", "guard", ""),
    ("59", "keeper", "subreaper"),
    ("59g", "guard", "subreaper"),
):

    def stop(desk: Desk, which: str = which, sandbox: str = sandbox) -> FaultResult:
        """Stop a supervisor."""
        return stopped(desk, which, sandbox)

    stop.__name__ = f"stop_{which}{'_subreaper' if sandbox else ''}"
    fault(
        row,
        section=KILLS,
        done=f"SIGSTOP of the {which}" + (", HARNESS_SANDBOX=subreaper" if sandbox else ""),
        promise="the limit of the check ends the cell",
    )(stop)


def stopped_then(desk: Desk, number: signal.Signals, code: int, sandbox: str = "") -> FaultResult:
    """Stop the keeper, then end the command: it ends, and nothing stays."""
    with measuring(desk, waiting(desk), sandbox) as chain:
        os.kill(chain.keeper, signal.SIGSTOP)
        begun = time.monotonic()
        chain.harness.send_signal(number)
        ran = chain.end()
        seconds = time.monotonic() - begun
    until = time.monotonic() + 5
    while (left := [pid for pid in (chain.guard, chain.keeper, chain.probe) if command(pid)]) and (
        time.monotonic() < until
    ):
        time.sleep(0.1)
    return FaultResult(
        f"exit {ran.code} after {seconds:.0f} s, {len(left)} left", ran.code == code and seconds < 30 and not left
    )


@fault(
    "13t", section=KILLS, done="SIGSTOP of the keeper, then SIGTERM of `run`", promise="143 within 30 s, nothing stays"
)
def stop_keeper_then_terminate(desk: Desk) -> FaultResult:
    """End a run whose keeper is stopped."""
    return stopped_then(desk, signal.SIGTERM, 143)


@fault("13k", section=KILLS, done="SIGSTOP of the keeper, then SIGKILL of `run`", promise="nothing stays")
def stop_keeper_then_kill(desk: Desk) -> FaultResult:
    """Kill a run whose keeper is stopped."""
    return stopped_then(desk, signal.SIGKILL, -9)


@fault(
    "59k",
    section=KILLS,
    done="SIGSTOP of the keeper, then SIGKILL of `run`, HARNESS_SANDBOX=subreaper",
    promise="nothing stays",
)
def stop_keeper_then_kill_subreaper(desk: Desk) -> FaultResult:
    """Kill a run whose keeper is stopped, where there are no namespaces."""
    return stopped_then(desk, signal.SIGKILL, -9, "subreaper")


@fault("14", section=KILLS, done="SIGTSTP, SIGCONT, then SIGTERM of `run`", promise="143")
def suspend_then_terminate(desk: Desk) -> FaultResult:
    """Suspend the command before it is ended."""
    with measuring(desk, waiting(desk)) as chain:
        for number in (signal.SIGTSTP, signal.SIGTERM, signal.SIGCONT):
            chain.harness.send_signal(number)
            time.sleep(0.1)
        ran = chain.end()
    return FaultResult(f"exit {ran.code}", ran.code == 143)


def hostile(
    desk: Desk, verdicts: set[str], step: str, sandbox: str = "", says: str = "", case: str = ""
) -> FaultResult:
    """Measure a cell whose step does something to processes, and its neighbour."""
    case = ", ".join(filter(None, ["timeouts = { single = 5 }", case]))
    matrix = desk.hostile(checks=("single",), step=step, case=case, top="import signal")
    ran = desk.measure(matrix, HARNESS_SANDBOX=sandbox)
    return desk.check_verdicts(ran, hx=verdicts, neighbour={"works"}, says=says)


@fault("35", section=PROBES, done="os._exit(0) in step()", promise="`broken`, never `works`")
def leave_with_success(desk: Desk) -> FaultResult:
    """Leave without a word."""
    return hostile(desk, {"broken"}, "os._exit(0)")


@fault("35e", section=PROBES, done="execve of /bin/true in step()", promise="`broken`, never `works`")
def become_another(desk: Desk) -> FaultResult:
    """Turn into another program."""
    return hostile(desk, {"broken"}, "os.execv('/bin/true', ['true'])")


@fault("55", section=PROBES, done="200 daemons by double fork that ignore SIGTERM", promise="none outlives the cell")
def daemons(desk: Desk) -> FaultResult:
    """Leave processes behind that escape their group."""
    step = """
if not getattr(self, "left", False):
    self.left = True
    if os.fork() == 0:
        for _ in range(200):
            if os.fork() == 0:
                os.setsid()
                signal.signal(signal.SIGTERM, signal.SIG_IGN)
                time.sleep(600)
        os._exit(0)
    os.wait()
"""
    return hostile(desk, {"works"}, step)


@fault("56", section=PROBES, done="a probe stops itself", promise="it times out")
def stop_itself(desk: Desk) -> FaultResult:
    """Stop oneself."""
    return hostile(desk, {"broken"}, "os.kill(os.getpid(), signal.SIGSTOP)", says="no end within")


@fault("56a", section=PROBES, done="kill(-1, SIGTERM) by a probe", promise="it reaches nothing but itself")
def kill_all(desk: Desk) -> FaultResult:
    """Signal everybody."""
    step = "signal.signal(signal.SIGTERM, signal.SIG_IGN); os.kill(-1, signal.SIGTERM)"
    return hostile(desk, {"works", "broken"}, step)


def at_parent(number: int) -> str:
    """Return the code of a step that sends its parent a signal."""
    return f"""
try:
    os.kill(os.getppid(), {number})
except PermissionError:
    pass
"""


for row, number, sandbox in (("56p", 9, ""), ("57", 9, "subreaper"), ("56s", 19, ""), ("57s", 19, "subreaper")):

    def strike(desk: Desk, number: int = number, sandbox: str = sandbox) -> FaultResult:
        """Send the parent a signal."""
        return hostile(desk, {"works", "inconclusive"}, at_parent(number), sandbox)

    name = signal.Signals(number).name
    strike.__name__ = f"{name.lower()}_to_parent{'_subreaper' if sandbox else ''}"
    fault(
        row,
        section=PROBES,
        done=f"{name} of its parent by a probe" + (", HARNESS_SANDBOX=subreaper" if sandbox else ""),
        promise="nothing happens, or `inconclusive`; nothing stays",
    )(strike)


@fault("8k", section=KILLS, done="SIGKILL of uv while it resolves", promise="`inconclusive`, a rerun works")
def kill_uv(desk: Desk) -> FaultResult:
    """Kill uv as often as it is seen."""
    matrix = desk.hostile(checks=("single",))
    with desk.started("run", matrix, "--json") as harness:
        while harness.poll() is None:
            for pid in find_descendants(harness.pid):
                if command(pid).partition("\0")[0].endswith("/uv"):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.001)
        out, err = harness.communicate()
    desk.ran.append(CommandResult(code=harness.returncode, out=out, err=err))
    first = desk.check_verdicts(desk.ran[-1], hx={"inconclusive", "works"}, neighbour={"inconclusive", "works"})
    came = desk.check_verdicts(desk.measure(matrix), code={0}, hx={"works"}, neighbour={"works"})
    return FaultResult(f"{first.what}; once more: {came.what}", first.held and came.held)
