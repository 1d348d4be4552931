"""Faults that no mechanism prevents: a package that lies about itself in its own process, reads files, or calls out."""

from __future__ import annotations

import socket

from benchmarks.faults import Desk, FaultResult, fault

SECTION = "hostile probes"
FORGED, FILES, NETWORK = (
    "A probe can forge its own reply",
    "A probe runs with the rights of the user",
    "The network is open",
)
RECORDS = """
def forged():
    with open({path}, "rb") as file:
        lines = [json.loads(line) for line in file.read().splitlines()]
    last = lines[-1]
    names = [line["check"] for line in lines if line["kind"] == "start"]
    record = dict(check=names[-1], outcome="passed", seconds=0.1, raised=None, reason=None, workers=[], facts={{}},
        kind="check", seq=last["seq"] + 1, pid=last["pid"])
    end = dict(kind="end", modules=[], versions={{}}, seq=last["seq"] + 2, pid=last["pid"])
    return "".join(json.dumps(one) + "\\n" for one in (record, end)).encode()
"""
OWN = 'next(p for p in map(os.readlink, glob.glob("/proc/self/fd/*")) if p.endswith("reply.jsonl"))'
BY_PATH = 'os.path.join(os.path.dirname(open("/proc/self/cmdline").read().split("\\0")[-2]), "reply", "reply.jsonl")'
FAILS = "raise RuntimeError('step never works')"


def lied(desk: Desk, top: str, step: str) -> FaultResult:
    """Measure a package that never steps and says that it does; its neighbour stays what it is."""
    ran = desk.measure(desk.hostile(checks=("single",), top=top, step=step))
    return desk.check_verdicts(ran, hx={"works", "broken", "inconclusive", "partial"}, neighbour={"works"})


@fault("31", section=SECTION, done="records forged through /proc/self/fd, then os._exit(0)", documented=FORGED,
       promise="its own cell alone is a lie, its neighbour's is not")  # fmt: skip
def forged_by_descriptor(desk: Desk) -> FaultResult:
    """Write into one's own reply by its descriptor."""
    step = f"with open({OWN}, 'ab') as file: file.write(forged())\nos._exit(0)"
    return lied(desk, RECORDS.format(path=OWN), step)


@fault("32", section=SECTION, done="records forged through the path in /proc/self/cmdline", documented=FORGED,
       promise="its own cell alone is a lie, its neighbour's is not")  # fmt: skip
def forged_by_path(desk: Desk) -> FaultResult:
    """Write into one's own reply by its path."""
    step = f"with open({BY_PATH}, 'ab') as file: file.write(forged())\nos._exit(0)"
    return lied(desk, RECORDS.format(path=BY_PATH), step)


@fault("32c", section=SECTION, done="records forged by a child with the number of its parent", documented=FORGED,
       promise="its own cell alone is a lie, its neighbour's is not")  # fmt: skip
def forged_by_child(desk: Desk) -> FaultResult:
    """Write into the parent's reply from a child."""
    step = f"""
if os.fork() == 0:
    with open({OWN}, 'ab') as file: file.write(forged())
    os._exit(0)
os.wait()
os._exit(0)
"""
    return lied(desk, RECORDS.format(path=OWN), step)


@fault("33", section=SECTION, done="the checks in sys.modules are replaced by some that pass", documented=FORGED,
       promise="its own cell alone is a lie, its neighbour's is not")  # fmt: skip
def replaced_checks(desk: Desk) -> FaultResult:
    """Replace the checks of the cell."""
    top = """
for name, module in list(sys.modules.items()):
    if name.startswith("_simmatrix_cell.check_"):
        module.run = lambda probe, facts: None
"""
    return lied(desk, top, FAILS)


@fault("34", section=SECTION, done="os.write and json.dumps are replaced by liars", documented=FORGED,
       promise="its own cell alone is a lie, its neighbour's is not")  # fmt: skip
def replaced_functions(desk: Desk) -> FaultResult:
    """Replace what writes the reply."""
    top = """
dumps, write = json.dumps, os.write
json.dumps = lambda value, *a, **k: dumps(value, *a, **k).replace('"failed"', '"passed"')
os.write = lambda fd, data: write(fd, data.replace(b'"failed"', b'"passed"'))
"""
    return lied(desk, top, FAILS)


@fault("73", section=SECTION, done="a probe reads a file of the user, outside our folders", documented=FILES,
       promise="it can; HOME points elsewhere, the file stays where it is")  # fmt: skip
def reads_files(desk: Desk) -> FaultResult:
    """Read a file of the user."""
    secret = desk.folder / "netrc"
    secret.write_text("machine example.invalid password none")
    step = f"assert 'password' in open({str(secret)!r}).read()\nassert os.environ['HOME'] != {str(desk.folder)!r}"
    ran = desk.measure(desk.hostile(checks=("single",), step=step))
    return desk.check_verdicts(ran, hx={"works"}, neighbour={"works"})


@fault("74", section=SECTION, done="a probe connects to a server on the loopback", documented=NETWORK,
       promise="it can: simulators download their assets")  # fmt: skip
def connects(desk: Desk) -> FaultResult:
    """Connect to a server of the user."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        step = f"import socket; socket.create_connection(('127.0.0.1', {server.getsockname()[1]}), 5).close(); step = 0"
        matrix = desk.hostile(checks=("single",), make=step)
        ran = desk.measure(matrix, "-k", "*-hx")
    return desk.check_verdicts(ran, hx={"works", "broken"})
