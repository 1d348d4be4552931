"""Bad input: files, names and command lines that nobody meant. Each is refused in one sentence, at once."""

from __future__ import annotations

import json
import os
import resource
from collections.abc import Callable
from pathlib import Path

from benchmarks.faults import ROOT, Desk, FaultResult, fault

LONGEST = 10.0
"""Seconds of CPU within which bad input is refused, whatever else this machine does; `limit` ends what waits."""

HEAD = '[axes]\npython = ["host"]\n'
CASE = 'requirements = ["gymnasium"]\ncases = [{ env = "CartPole-v1" }]\n'

Make = Callable[[Path], object]


def _spent() -> float:
    """Return the seconds of CPU of the commands that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def text(name: str, content: str | bytes) -> Make:
    """Return a function that writes a file."""
    return lambda folder: (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def fifo(name: str) -> Make:
    """Return a function that makes a named pipe."""
    return lambda folder: os.mkfifo(folder / name)


def declare_refusal(row: str, done: str, make: Make, *words: str, says: str = "", code: int = 2) -> None:
    """Declare bad input that is refused: a sentence on stderr, nothing left in the folder, within `LONGEST` seconds."""

    def do(desk: Desk) -> FaultResult:
        make(desk.folder)
        _ = desk.scratch
        before = set(desk.folder.rglob("*"))
        began = _spent()
        ran = desk.run(*words)
        took = _spent() - began
        last = ran.err.strip().splitlines()[-1][:200] if ran.err.strip() else "not a word"
        left = set(desk.folder.rglob("*")) - before - {desk.state, desk.state / ".gitignore"}
        strange = sorted(str(path.relative_to(desk.folder)) for path in left if desk.state not in path.parents)
        held = ran.code == code and says in ran.err and took < LONGEST and len(ran.err) < 2_000 and not strange
        return FaultResult(f"exit {ran.code} in {took:.1f} s: {last}" + (f"; left {strange}" if strange else ""), held)

    do.__name__ = "row_" + row.replace(".", "_").replace("-", "_")
    promise = f"exit {code} within {LONGEST:g} s, in a sentence" + (f" that says “{says}”" if says else "")
    fault(row, section="bad input", done=done, promise=promise, limit=60)(do)


def axes(count: int, values: int) -> str:
    """Return a matrix of so many axes of so many values."""
    listed = ", ".join(f'"{number}.0"' for number in range(values))
    return CASE + HEAD + "".join(f"a{axis} = [{listed}]\n" for axis in range(count))


PLAN = ("plan", "m.toml", "--offline")
TRY = ("--import", "numpy", "--offline")

declare_refusal(
    "92",
    "a version of 5,000 digits in a `when`",
    text(
        "m.toml",
        CASE + f'exclude = [{{ when = {{ numpy = "{"1" * 5000}" }}, reason = "x" }}]\n' + HEAD + 'numpy = ["2.0"]\n',
    ),
    *PLAN,
    says="m.toml: exclude[0].when.numpy",
)
declare_refusal(
    "93.1",
    "5,000 lists, one in the other, in a matrix",
    text("m.toml", "x = " + "[" * 5000),
    *PLAN,
    says="m.toml: is nested too deep",
)
declare_refusal(
    "93.2",
    "5,000 dotted keys in a matrix",
    text("m.toml", ".".join("a" * 5000) + " = 1"),
    *PLAN,
    says="m.toml: is nested too deep",
)
declare_refusal(
    "93.3",
    "5,000 inline tables, one in the other",
    text("m.toml", "x = " + "{a = " * 5000),
    *PLAN,
    says="m.toml: is nested too deep",
)
declare_refusal(
    "94", "an integer of 5,000 digits in a matrix", text("m.toml", "x = " + "1" * 5000), *PLAN, says="too many digits"
)
declare_refusal(
    "95.1", "60 to the 6th combinations", text("m.toml", axes(6, 60)), *PLAN, says="46,656,000,000 combinations"
)
declare_refusal(
    "95.2", "100 to the 5th combinations", text("m.toml", axes(5, 100)), *PLAN, says="10,000,000,000 combinations"
)
declare_refusal(
    "95.3", "2 to the 40th combinations", text("m.toml", axes(40, 2)), *PLAN, says="1,099,511,627,776 combinations"
)
declare_refusal(
    "95.4",
    "pairwise of 30 axes of 30 values",
    text("m.toml", 'strategy = "pairwise"\n' + axes(30, 30)),
    *PLAN,
    says="at most 20,000 can be planned",
)
declare_refusal(
    "95.5",
    "8 ways of 14 axes of 2 values",
    text("m.toml", "strategy = { ways = 8 }\n" + axes(14, 2)),
    "lock",
    "m.toml",
    "--offline",
    says="parts to cover",
)
declare_refusal(
    "96",
    "a pattern of thirty stars in a `when`, against a label of 100 letters",
    text(
        "m.toml",
        CASE
        + f'exclude = [{{ when = {{ X = "{"*a" * 30}*b" }}, reason = "x" }}]\n'
        + HEAD
        + f'X = {{ variable = ["{"a" * 100}"] }}\n',
    ),
    *PLAN,
    says="no value of this axis",
)
declare_refusal("97", "a matrix that is a named pipe", fifo("m.toml"), *PLAN, says="it is a named pipe")
declare_refusal(
    "98.1", "a matrix that is a folder", lambda folder: (folder / "m.toml").mkdir(), *PLAN, says="Is a directory"
)
declare_refusal(
    "98.2",
    "a matrix that is a link to itself",
    lambda folder: (folder / "m.toml").symlink_to("m.toml"),
    *PLAN,
    says="Too many levels of symbolic links",
)
declare_refusal("98.3", "a matrix that does not exist", lambda folder: None, *PLAN, says="No such file or directory")
declare_refusal("98.4", "a matrix with a null character", text("m.toml", CASE + "x = '\0'\n"), *PLAN, says="m.toml: ")
declare_refusal(
    "98.5", "a matrix in Latin-1", text("m.toml", "# caf\xe9".encode("latin-1")), *PLAN, says="is not UTF-8 text"
)
declare_refusal(
    "98.6",
    "a matrix that is /dev/zero",
    lambda folder: (folder / "m.toml").symlink_to("/dev/zero"),
    *PLAN,
    says="it is a device",
)
declare_refusal(
    "98.7",
    "a sparse matrix of 200 GB",
    lambda folder: os.truncate(folder / "m.toml", 200 << 30) if not (folder / "m.toml").touch() else None,
    *PLAN,
    says="more than 4 MB",
)
declare_refusal(
    "98.8",
    "a cutoff in the year 99999",
    text("m.toml", 'snapshot = "99999-01-01"\n' + CASE + HEAD),
    *PLAN,
    says="snapshot",
)
declare_refusal(
    "100.1",
    "environment.yml with an escape character",
    text("e.yml", "dependencies:\n - python\x1b\n"),
    "try",
    "-r",
    "e.yml",
    *TRY,
    says="e.yml:2: YAML allows no character U+001B",
)
declare_refusal(
    "100.2",
    "environment.yml with a null character",
    text("e.yml", "dependencies:\n - python\0\n"),
    "try",
    "-r",
    "e.yml",
    *TRY,
    says="e.yml:2: YAML allows no character U+0000",
)
declare_refusal(
    "100.3",
    "environment.yml nested 3,000 deep",
    text("e.yml", "x: " + "[" * 3000 + "]" * 3000),
    "try",
    "-r",
    "e.yml",
    *TRY,
    says="e.yml: is nested too deep",
)
declare_refusal(
    "100.4",
    "environment.yml with lists that multiply where a text is expected",
    text("e.yml", "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\ndependencies:\n - pip:\n   - *c\n"),
    "try",
    "-r",
    "e.yml",
    *TRY,
    says="expected the name of a package",
)
declare_refusal(
    "101.1",
    "`-r` with a name of 300 letters",
    lambda folder: None,
    "try",
    "-r",
    "a" * 300,
    *TRY,
    says="File name too long",
)
declare_refusal(
    "101.2",
    "`-c` with a name of 300 letters inside a file",
    text("r.txt", "-c " + "a" * 300 + "\n"),
    "try",
    "-r",
    "r.txt",
    *TRY,
)
declare_refusal(
    "102.1",
    "pyproject.toml nested 3,000 deep",
    text("pyproject.toml", "x = " + "[" * 3000),
    "try",
    "-r",
    "pyproject.toml",
    *TRY,
    says="pyproject.toml: is nested too deep",
)
declare_refusal(
    "102.2",
    "pylock.toml with an integer of 5,000 digits",
    text("pylock.toml", "lock-version = " + "1" * 5000),
    "try",
    "-r",
    "pylock.toml",
    *TRY,
    says="pylock.toml: has an integer of too many digits",
)
declare_refusal(
    "103.1",
    "requirements.txt with a line of 200,000 blanks",
    text("r.txt", "numpy" + " " * 200_000 + "x\n"),
    "try",
    "-r",
    "r.txt",
    *TRY,
    says="r.txt:1: ",
)
declare_refusal(
    "103.2",
    "requirements.txt with 100,000 continued lines and then nonsense",
    text("r.txt", "\\\n" * 100_000 + "=\n"),
    "try",
    "-r",
    "r.txt",
    *TRY,
    says="r.txt:1: '=' is no requirement",
)
declare_refusal(
    "103.3",
    "requirements.txt with an option of 1 MB in quotes that do not close",
    text("r.txt", "--find-links '" + "a b" * 350_000),
    "try",
    "-r",
    "r.txt",
    *TRY,
    says="No closing quotation",
)
declare_refusal(
    "103.4",
    "requirements.txt of 100,000 packages",
    text("r.txt", "".join(f"p{n}\n" for n in range(100_000))),
    "try",
    "-r",
    "r.txt",
    *TRY,
    says="at most 2,000",
)
declare_refusal(
    "103.5",
    "1,200 requirement files that each include the next",
    lambda folder: [(folder / f"r{n}.txt").write_text(f"-r r{n + 1}.txt\n") for n in range(1200)],
    "try",
    "-r",
    "r0.txt",
    *TRY,
    says="is nested too deep",
)
DEEP = "numpy; " + "(" * 2000 + 'python_version > "3"' + ")" * 2000
declare_refusal(
    "104.1",
    "a marker nested 2,000 deep on the command line",
    lambda folder: None,
    "try",
    DEEP,
    *TRY,
    says="nested too deep",
)
declare_refusal(
    "104.2",
    "a marker nested 2,000 deep in a file",
    text("r.txt", DEEP),
    "try",
    "-r",
    "r.txt",
    *TRY,
    says="nested too deep",
)
declare_refusal(
    "105.1",
    "a report of 100,000 lists, one in the other",
    text("report.json", "[" * 100_000),
    "report",
    "report.json",
    says="report.json: is nested too deep",
)
declare_refusal(
    "105.2",
    "the same report, merged",
    text("report.json", "[" * 100_000),
    "merge",
    "report.json",
    "--out",
    "out",
    says="report.json: is nested too deep",
)
declare_refusal(
    "105.3",
    "a report with half of a surrogate pair",
    text("report.json", '{"schema": 1, "generated": "\\ud800"}'),
    "report",
    "report.json",
    says="half of a surrogate pair",
)
declare_refusal(
    "107.1",
    "`--shard 1/99999999999999999999`",
    text("m.toml", CASE + HEAD),
    "run",
    "m.toml",
    "--offline",
    "--shard",
    "1/99999999999999999999",
    says="at most 10,000 shards",
)
declare_refusal(
    "107.2",
    "an `--env` that climbs out of the folder",
    lambda folder: None,
    "try",
    "mujoco",
    "--env",
    "mujoco:../../etc/passwd.xml",
    "--offline",
    says="is not a relative path",
)
declare_refusal(
    "107.3",
    "`--as-of` that is no date",
    lambda folder: None,
    "try",
    "numpy",
    *TRY,
    "--as-of",
    "yesterday",
    says="yesterday",
)
declare_refusal(
    "107.4", "`--set` of a name with a blank", lambda folder: None, "try", "numpy", *TRY, "--set", "A B=1", says="A B"
)
declare_refusal("107.5", "`show` of an id with escape characters", lambda folder: None, "show", "\x1b]0;x\x07\x9b31m*")
declare_refusal("107.6", "`-j` of nonsense", text("m.toml", CASE + HEAD), "run", "m.toml", "-j", "many", says="'many'")
declare_refusal(
    "107.7", "a pattern that no cell fits", text("m.toml", CASE + HEAD), "run", "m.toml", "--offline", "-k", "*nobody*"
)
declare_refusal("108.1", "`explain /dev/zero`", lambda folder: None, "explain", "/dev/zero", says="it is a device")
declare_refusal("108.2", "`explain` of a named pipe", fifo("log"), "explain", "log", says="it is a named pipe")


@fault(
    "8",
    section="kills and signals",
    done="`run | head -1` of a red matrix",
    promise="the run ends with 1, its report is written",
)
def reader_gone(desk: Desk) -> FaultResult:
    """Close stdout after its first line."""
    matrix = desk.hostile(checks=("single",), step="raise ValueError('red')")
    with desk.started("run", matrix) as process:
        assert process.stdout
        process.stdout.close()
        code = process.wait(timeout=110)
    written = (desk.state / "reports" / "m" / "report.json").is_file()
    return FaultResult(f"exit {code}, report {'written' if written else 'missing'}", code == 1 and written)


@fault("22", section="disks and damaged files", done="HARNESS_STATE of 300 letters", promise="exit 2 with one sentence")
def state_too_long(desk: Desk) -> FaultResult:
    """Name a state that no file system can hold."""
    ran = desk.run("run", desk.hostile(), HARNESS_STATE="a" * 300)
    held = ran.code == 2 and ran.err.count("\n") == 1 and "File name too long" in ran.err
    return FaultResult(f"exit {ran.code}: {ran.err.strip()[:150]}", held)


@fault(
    "101.3",
    section="bad input",
    done="requirements come through a pipe of the shell",
    promise="they are read as a file is",
)
def pipe_of_the_shell(desk: Desk) -> FaultResult:
    """Give `-r <(...)`."""
    ran = desk.under("bash", "-c", 'exec "$@" -r <(echo "numpy==")', "bash").run("try", *TRY)
    return FaultResult(
        f"exit {ran.code}: {ran.err.strip()[-100:]}", ran.code == 2 and ":1: 'numpy==' is no requirement" in ran.err
    )


@fault(
    "106",
    section="bad input",
    done="a report whose locks, frames and evidence lie outside, merged and written again",
    promise="nothing outside is copied or written",
)
def report_climbs_out(desk: Desk) -> FaultResult:
    """Let every path of a committed report lead to a secret beside it."""
    plain = json.loads((ROOT / "reports" / "quickstart" / "report.json").read_text(encoding="utf-8"))
    (desk.folder / "secret.txt").write_text("canary-4711")
    for cell in plain["cells"]:
        cell |= {"lock": "../secret.txt", "evidence": "/etc"}
        for case in cell["cases"]:
            case["frames"] = ["../secret.txt", "/etc/passwd"]
    there = desk.folder / "there"
    there.mkdir()
    (there / "report.json").write_text(json.dumps(plain))
    codes = [desk.run("merge", "there", "--out", "merged").code, desk.run("report", "there", "--out", "again").code]
    copied = [path for name in ("merged", "again") for path in (desk.folder / name).rglob("*") if path.is_file()]
    leaked = [str(path) for path in copied if b"canary-4711" in path.read_bytes() or b"root:" in path.read_bytes()]
    outside = sorted(path.name for path in desk.folder.iterdir())
    return FaultResult(
        f"exits {codes}, {len(copied)} files, leaked {leaked or 'nothing'}, beside: {outside}", not leaked
    )
