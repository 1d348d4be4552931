"""Faults of what a probe leaves behind: replies, frames, logs, folders that the harness reads and removes."""

from __future__ import annotations

import os

from benchmarks.faults import Desk, FaultResult, Unavailable, fault

PLACES = """
import atexit
words = open('/proc/self/cmdline').read().split('\\0')
scratch = os.path.dirname([word for word in words if 'request.json' in word][0])
reply = os.path.join(scratch, 'reply')
done = []
def once():
    done.append(1)
    return len(done) == 1
"""
ANY = {"works", "partial", "broken", "inconclusive"}
RED = {"broken", "inconclusive"}
FINE = {"works"}
MB = 1 << 20
"""What a cell of a hostile package may come to: that it says what it did wrong is not promised, only that it ends."""


def probe(
    desk: Desk, deed: str, hx: set[str] = ANY, *, top: str = "", checks: tuple[str, ...] = ("single",)
) -> FaultResult:
    """Let one probe do a deed in its first step, with a healthy neighbour."""
    matrix = desk.hostile(checks=checks, top=PLACES + top, step=first_step(deed))
    return desk.check_verdicts(desk.measure(matrix), hx=hx, neighbour=FINE)


def first_step(deed: str) -> str:
    """Return Python that does a deed once."""
    return "if once():\n" + "\n".join(f"    {line}" for line in deed.strip().splitlines())


def spoilt(desk: Desk, content: str) -> FaultResult:
    """Let a probe put other bytes in the place of its frames; `content` is Python."""
    deed = f"""
def spoil():
    for path in glob.glob(reply + '/*.npy'):
        os.unlink(path)
        put(path)
def put(path):
{content}
atexit.register(spoil)
"""
    matrix = desk.hostile(checks=("single", "render"), top=PLACES + deed)
    ran = desk.measure(matrix)
    came = desk.check_verdicts(ran, hx=FINE, neighbour=FINE)
    frames = [frame for case in ran.cells("which")["hx"]["cases"] for frame in case["frames"]] if came.held else []
    neighbours = [frame for case in ran.cells("which")["neighbour"]["cases"] for frame in case["frames"]]
    return FaultResult(
        f"{came.what}; frames kept: {len(frames)}, of the neighbour {len(neighbours)}", came.held and not frames
    )


def npy(header: str, rest: str = "bytes(100)") -> str:
    """Return Python that writes an array with this header (an expression)."""
    return f"""
    header = {header}
    open(path, 'wb').write(b'\\x93NUMPY\\1\\0' + len(header).to_bytes(2, 'little') + header.encode() + {rest})
"""


def evidence(desk: Desk) -> dict[str, int]:
    """Return the files kept as evidence and in the report's folder: path to size in bytes."""
    files = (path for path in desk.state.rglob("*") if path.is_file())
    return {str(path.relative_to(desk.state)): path.stat().st_size for path in files}


# --- replies -----------------------------------------------------------------------------------------------------

LINES = {
    "36": ("100,000 `[`", "b'[' * 100_000"),
    "36b": ('100,000 times `{"a":`', "b'{\"a\":' * 100_000"),
    "36c": (
        "900 nested lists as the facts of a check",
        "b'{\"kind\": \"check\", \"facts\": ' + b'[' * 900 + b']' * 900 + b'}'",
    ),
    "37": ("bytes that are not UTF-8", 'b\'{"kind": "start", "check": "\\xff\\xfe"}\''),
    "49a": ("an integer of 5,000 digits", "b'{\"seq\": ' + b'9' * 5000 + b'}'"),
    "49b": ("NaN and infinities", 'b\'{"kind": "check", "seconds": NaN, "seq": -Infinity}\''),
    "49c": ("half of a surrogate pair", 'b\'{"kind": "start", "check": "\\\\ud800"}\''),
    "64a": ("50 MB", "b'x' * 50_000_000"),
    "L1": ("NUL bytes", "bytes(1000)"),
    "L2": ("2 MB of blanks in a million lines", "b' \\n' * 1_000_000"),
}
"""Lines that a probe writes into its reply."""


def line_fault(row: str, what: str, line: str) -> None:
    """Declare the fault of one line."""

    def do(desk: Desk) -> FaultResult:
        deed = f"fd = os.open(reply + '/reply.jsonl', os.O_WRONLY | os.O_APPEND)\nos.write(fd, {line} + b'\\n')"
        return probe(desk, deed)

    do.__name__ = f"line_{row}"
    fault(
        row,
        section="hostile probes",
        done=f"a probe writes a line of {what} into its reply",
        promise="the line is refused, the neighbour works",
    )(do)


for row, (what, line) in LINES.items():
    line_fault(row, what, line)


SWAPS = {
    "38": ("a FIFO", "os.mkfifo(path)"),
    "39a": ("a folder", "os.mkdir(path)"),
    "39b": ("a link to itself", "os.symlink(path, path)"),
    "39c": ("a link to /dev/zero", "os.symlink('/dev/zero', path)"),
    "39d": ("a socket", "import socket; s = socket.socket(socket.AF_UNIX); s.bind(path)"),
    "40a": ("a sparse file of 200 GB", "open(path, 'wb').truncate(200 << 30)"),
    "40b": ("a sparse file of 20 GB", "open(path, 'wb').truncate(20 << 30)"),
}
"""What a probe puts in the place of a file that the harness reads."""


def swap_fault(row: str, what: str, deed: str, name: str) -> None:
    """Declare the fault of one file that becomes something else."""

    def do(desk: Desk) -> FaultResult:
        lines = f"path = os.path.join(reply, {name!r})\nif os.path.lexists(path):\n    os.unlink(path)\n{deed}"
        return probe(desk, lines)

    do.__name__ = f"swap_{row}_{''.join(filter(str.isalnum, name))}"
    fault(
        row,
        section="hostile probes",
        done=f"a probe puts {what} in the place of {name}",
        promise="nothing hangs, nothing is read beyond bounds, the neighbour works",
    )(do)


for row, (what, deed) in SWAPS.items():
    swap_fault(row, what, deed, "reply.jsonl")
for row, swapped, name in (
    ("38b", "38", "stacks.txt"),
    ("38c", "38", "worker-77.jsonl"),
    ("38d", "38", "../log.txt"),
    ("40c", "40a", "../log.txt"),
    ("40d", "40a", "x.txt"),
    ("40e", "40a", "worker-77.txt"),
    ("39e", "39c", "../log.txt"),
):
    swap_fault(row, *SWAPS[swapped], name)


@fault(
    "41",
    section="hostile probes",
    done="a probe links texts of its reply folder to the caller's .netrc",
    promise="nothing of it is in the evidence or the report",
)
def link_out(desk: Desk) -> FaultResult:
    """Leave links with the names of evidence."""
    secret = desk.folder / ".netrc"
    secret.write_text("machine example.org login me password CANARY-41", encoding="utf-8")
    names = ("leak.txt", "leak.jsonl", "worker-1.txt", "worker-1.jsonl", "stacks.txt", "../log.txt")
    deed = "\n".join(
        f"path = os.path.join(reply, {name!r})\nif os.path.lexists(path): os.unlink(path)\n"
        f"os.symlink({str(secret)!r}, path)"
        for name in names
    )
    came = probe(desk, deed)
    return without_canary(desk, came, b"CANARY-41")


@fault(
    "41b",
    section="hostile probes",
    done="a probe puts a link to the caller's folder in the place of its reply folder, and of the one above",
    promise="nothing of that folder is in the evidence or the report",
)
def link_folder(desk: Desk) -> FaultResult:
    """Swap whole folders."""
    home = desk.folder / "secrets"
    (home / "reply").mkdir(parents=True)
    for folder in (home, home / "reply"):
        for name in ("stacks.txt", "reply.jsonl", "worker-1.txt", "log.txt", "notes.txt"):
            (folder / name).write_text("CANARY-41b", encoding="utf-8")
    deed = f"""
os.rename(reply, reply + '-old')
os.symlink({str(home)!r}, reply)
try:
    os.rename(scratch, scratch + '-old')
    os.symlink({str(home)!r}, scratch)
except OSError:
    pass
"""
    came = without_canary(desk, probe(desk, deed), b"CANARY-41b")
    there = sorted(path.name for path in home.rglob("*"))
    return FaultResult(f"{came.what}; the caller's folder has {len(there)} entries", came.held and len(there) == 11)


def without_canary(desk: Desk, came: FaultResult, canary: bytes) -> FaultResult:
    """Look for a secret in all that is kept."""
    leaks = [name for name in evidence(desk) if canary in (desk.state / name).read_bytes()[: 64 * MB]]
    return FaultResult(f"{came.what}; found in {leaks or 'no file'}", came.held and not leaks)


@fault(
    "42",
    section="hostile probes",
    done="a probe leaves 3,000 files `n*.txt` and 3,000 files of workers, of 20 KB each",
    promise="a bounded number and size of them is kept",
)
def many_files(desk: Desk) -> FaultResult:
    """Leave thousands of texts."""
    deed = """
for number in range(3000):
    open(os.path.join(reply, 'n%d.txt' % number), 'w').write('x' * 20_000)
    open(os.path.join(reply, 'worker-%d.txt' % number), 'w').write('x' * 20_000)
"""
    came = probe(desk, deed)
    sizes = evidence(desk)
    size = sum(sizes.values())
    return FaultResult(
        f"{came.what}; {len(sizes)} files, {size // MB} MB kept", came.held and len(sizes) < 400 and size < 64 * MB
    )


@fault(
    "42b",
    section="hostile probes",
    done="a probe leaves 60 texts of workers of 4 MB each",
    promise="a bounded size of them is kept",
)
def large_files(desk: Desk) -> FaultResult:
    """Leave texts that are large together."""
    deed = "for number in range(60): open(os.path.join(reply, 'worker-%d.txt' % number), 'w').write('x' * (4 << 20))"
    came = probe(desk, deed)
    size = sum(evidence(desk).values())
    return FaultResult(f"{came.what}; {size // MB} MB kept", came.held and size < 64 * MB)


@fault(
    "43",
    section="hostile probes",
    done="a probe leaves files whose names hold ESC, a newline, HTML, bytes that are no text",
    promise="nothing is kept under such a name",
)
def odd_names(desk: Desk) -> FaultResult:
    """Leave odd names."""
    names = [b"\x1b[31mred.txt", b"a\nb.txt", b"<script>.txt", b"\xff\xfe.txt", b"a b.jsonl", b"%s.txt", b"-rf.txt"]
    deed = f"for name in {names!r}:\n    open(os.path.join(os.fsencode(reply), name), 'w').write('x')"
    came = probe(desk, deed)
    odd = [name for name in evidence(desk) if set(name) & set("\x1b\n<>% ") or "/-" in name or not name.isascii()]
    return FaultResult(f"{came.what}; odd names kept: {len(odd)}", came.held and not odd)


# --- frames ------------------------------------------------------------------------------------------------------

FRAMES = {
    "44": (
        "a zip archive",
        "    import numpy; f = open(path, 'wb'); numpy.savez(f, a=numpy.zeros((4, 4, 3), 'uint8')); f.close()",
    ),
    "45a": (
        "a header that promises 12 TB",
        npy("\"{'descr': '|u1', 'fortran_order': False, 'shape': (2000000, 2000000, 3), }\\n\""),
    ),
    "45b": ("a header of 5,000 `(`", npy("'(' * 5000")),
    "45c": (
        "a header with keys of several types",
        npy("\"{'descr': '|u1', 1: 2, 'fortran_order': False, 'shape': (4, 4, 3), }\\n\""),
    ),
    "45d": ("a header of 9,000 minus signs", npy("'-' * 9000 + '1'")),
    "46a": ("a negative shape", npy("\"{'descr': '|u1', 'fortran_order': False, 'shape': (-4, -4, 3), }\\n\"")),
    "46b": ("a FIFO", "    os.mkfifo(path)"),
    "46c": ("a link to /dev/zero", "    os.symlink('/dev/zero', path)"),
    "46d": (
        "a pickle that runs a command",
        "    import pickle, numpy; numpy.save(path, numpy.array([{'a': 1}], dtype=object), allow_pickle=True)",
    ),
    "46f": ("a sparse file of 200 GB", "    open(path, 'wb').truncate(200 << 30)"),
    "46g": ("a folder", "    os.mkdir(path)"),
    "46h": ("nothing at all", "    open(path, 'wb').close()"),
}
"""What a probe puts in the place of its frames."""


def frame_fault(row: str, what: str, content: str) -> None:
    """Declare the fault of one frame."""

    def do(desk: Desk) -> FaultResult:
        return spoilt(desk, content)

    do.__name__ = f"frame_{row}"
    fault(
        row,
        section="hostile probes",
        done=f"a probe puts {what} in the place of its frames",
        promise="no picture is made of it, its cell and the neighbour work",
    )(do)


for row, (what, content) in FRAMES.items():
    frame_fault(row, what, content)


@fault(
    "46e",
    section="hostile probes",
    done="a probe puts a frame of 1 x 20,000,000 pixels in the place of its own",
    promise="it is drawn or refused, its cell and the neighbour work",
)
def thin_frame(desk: Desk) -> FaultResult:
    """Draw an extreme shape."""
    content = "    import numpy; numpy.save(path, numpy.zeros((1, 20_000_000, 3), 'uint8'))"
    came = spoilt(desk, content)
    return FaultResult(came.what, "hx: works" in came.what and "neighbour: works" in came.what)


# --- folders -----------------------------------------------------------------------------------------------------


def deep(start: str, depth: int) -> str:
    """Return Python that nests folders from a start (an expression), whatever the length of their path."""
    return f"""
cwd = os.getcwd()
os.chdir({start})
for _ in range({depth}):
    os.mkdir('d')
    os.chdir('d')
open('leaf', 'w').close()
os.chdir(cwd)
"""


@fault(
    "47a",
    section="hostile probes",
    done="a probe leaves 3,000 nested folders in TMPDIR",
    promise="they are removed, its cell and the neighbour work",
)
def deep_scratch(desk: Desk) -> FaultResult:
    """Nest folders where the harness removes them."""
    came = probe(desk, deep("os.environ['TMPDIR']", 3000), FINE)
    left = sorted(path.name for path in desk.scratch.iterdir())
    return FaultResult(f"{came.what}; left in TMPDIR: {left}", came.held and not left)


@fault(
    "47b",
    section="hostile probes",
    done="a probe leaves 1,500 nested folders in its environment",
    promise="they are gone, its cell and the neighbour end",
)
def deep_environment(desk: Desk) -> FaultResult:
    """Nest folders where the harness looks for what was written."""
    came = probe(desk, deep("os.path.dirname(os.path.abspath(__file__))", 1500))
    left = sorted(path.name for path in desk.scratch.iterdir())
    return FaultResult(f"{came.what}; left in TMPDIR: {left}", came.held and not left)


@fault(
    "47c",
    section="hostile probes",
    done="a probe leaves 1,500 nested folders in a copy of its environment (no overlay)",
    promise="they are gone, its cell and the neighbour end",
)
def deep_copy(desk: Desk) -> FaultResult:
    """Nest folders in a copy."""
    return deep_environment(desk.with_variables(HARNESS_SANDBOX="subreaper"))


@fault(
    "48",
    section="hostile probes",
    done="a probe running as root makes a file of its TMPDIR immutable (chattr +i)",
    promise="the cell ends as ever, and a line says which folder stays",
)
def immutable(desk: Desk) -> FaultResult:
    """Leave what cannot be removed."""
    if os.geteuid() != 0:
        msg = "root, who alone may make a file immutable"
        raise Unavailable(msg)
    deed = """
import fcntl, struct
fd = os.open(os.path.join(os.environ['TMPDIR'], 'stays'), os.O_CREAT | os.O_RDWR)
try:
    fcntl.ioctl(fd, 0x40086602, struct.pack('l', 0x10))
    open(os.path.join(reply, 'worker-1.txt'), 'w').write('immutable')
except OSError as error:
    open(os.path.join(reply, 'worker-1.txt'), 'w').write('refused: %s' % error)
"""
    matrix = desk.hostile(checks=("single",), top=PLACES, step=first_step(deed))
    ran = desk.measure(matrix)
    came = desk.check_verdicts(ran, hx=FINE, neighbour=FINE)
    left = [path.name for path in desk.scratch.iterdir()]
    is_reported = "cannot be removed" in ran.err
    return FaultResult(f"{came.what}; left: {len(left)}, said: {is_reported}", came.held and (is_reported or not left))


@fault(
    "48b",
    section="hostile probes",
    done="a probe leaves folders without any permission, FIFOs and sockets in TMPDIR (as nobody)",
    promise="they are gone, its cell and the neighbour work",
)
def locked_folders(desk: Desk) -> FaultResult:
    """Leave folders that nobody may enter."""
    deed = """
os.chdir(os.environ['TMPDIR'])
os.makedirs('a/b/c')
open('a/b/c/file', 'w').close()
os.mkfifo('a/fifo')
os.chmod('a/b/c', 0)
os.chmod('a/b', 0)
os.chmod('a', 0)
"""
    desk = desk.as_nobody()
    came = probe(desk, deed, FINE)
    left = [path.name for path in desk.scratch.iterdir()]
    return FaultResult(f"{came.what}; left: {left}", came.held and not left)


@fault(
    "122t",
    section="several at once",
    done="TMPDIR is removed while probes run (as systemd-tmpfiles does)",
    promise="cells in flight are inconclusive at worst, the run ends, the next one measures all",
    limit=180,
)
def scratch_removed(desk: Desk) -> FaultResult:
    """Let the probe itself take TMPDIR away, for the whole run."""
    above = str(desk.scratch)
    mark = str(desk.folder / "gone")
    deed = f"""
import shutil
if not os.path.exists({mark!r}):
    open({mark!r}, 'w').close()
    shutil.rmtree({above!r}, ignore_errors=True)
"""
    matrix = desk.hostile(checks=("single",), top=PLACES, step=first_step(deed))
    first = desk.measure(matrix, "-j", "1")
    came = desk.check_verdicts(first, hx={"works", "inconclusive"}, neighbour={"works", "inconclusive"})
    again = desk.check_verdicts(desk.measure(matrix), hx=FINE, neighbour=FINE)
    return FaultResult(f"{came.what}; again: {again.what}", came.held and again.held)
