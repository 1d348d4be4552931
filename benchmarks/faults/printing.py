"""Faults of printed texts: a package's own words on a terminal, in Markdown, in annotations and in an issue."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from collections.abc import Mapping

from benchmarks.faults import Desk, FaultResult, fault

OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ufffe]|\x1b")
"""What no door may let through."""

FORMATS = ("md", "github", "github-summary")


def doors(desk: Desk, message: str, *, kind: str = "ValueError", top: str = "") -> dict[str, str]:
    """Let a package raise a message at its first step; return what each door says of it, by the door's name."""
    step = f"raise {kind}({message!r})"
    ran = desk.run("run", desk.hostile(checks=("single",), top=top, step=step))
    texts = {"run": ran.out + ran.err}
    for form in FORMATS:
        texts[f"report --format {form}"] = desk.run("report", "m", "--format", form).out
    texts["show"] = desk.run("show", "*hx*").out
    texts["show --issue"] = desk.run("show", "*hx*", "--issue").out
    for name in ("report.md", "report.json"):
        texts[name] = (desk.state / "reports" / "m" / name).read_text(encoding="utf-8")
    log = desk.folder / "log"
    log.write_text(
        f'Traceback (most recent call last):\n  File "x.py", line 1, in f\n{kind}: {message}\n', errors="replace"
    )
    texts["explain"] = desk.run("explain", "log").out
    texts["explain -"] = subprocess.run(
        [sys.executable, "-m", "harness", "explain", "-"], input=log.read_bytes(), env=desk.environment({}),
        cwd=desk.folder, capture_output=True, check=False,
    ).stdout.decode()  # fmt: skip
    return texts


def clean(texts: Mapping[str, str], word: str) -> FaultResult:
    """Hold that nothing is obeyed by a terminal, and that the word itself is told at each door of a person."""
    dirty = [door for door, text in texts.items() if OBEYED.search(text)]
    silent = [door for door in ("run", "show", "show --issue", "report.md", "explain") if word not in texts[door]]
    summary = f"{len(texts)} doors, raw at {dirty or 'none'}, silent at {silent or 'none'}"
    return FaultResult(summary, not dirty and not silent)


SEQUENCES = {
    "109.1": ("colours, movements and a cleared screen (CSI)", "\x1b[2J\x1b[1;1H\x1b[8mhidden"),
    "109.2": ("a window title (OSC 0)", "\x1b]0;owned\x07"),
    "109.3": ("a link that says something else (OSC 8)", "\x1b]8;;http://evil.example\x1b\\index.example\x1b]8;;\x1b\\"),
    "110.1": ("a reset of the terminal (ESC c)", "\x1bc"),
    "110.2": ("another set of characters (ESC ( 0)", "\x1b(0"),
    "110.3": ("a CSI of one character (U+009B)", "\x9b2J"),
    "110.4": ("an OSC of one character (U+009D)", "\x9d0;owned\x9c"),
    "110.5": ("null characters, shifts, bells and deletes", "\0\x07\x08\x0e\x0f\x7f"),
    "110.6": ("a change of the direction of writing", "\u202egnp.exe\u2066"),
    "110.7": ("an escape that the limit of a line cuts", "word " * 58 + "\x1b[31" + "\x1b]0;x" * 5),
    "110.8": ("a device control string (DCS) and a privacy message", "\x1bP$q\"p\x1b\\\x1b^x\x1b\\"),
    "111": ("the clipboard (OSC 52)", "\x1b]52;c;ZXZpbA==\x07\x1b]52;c;ZXZpbA==\x1b\\"),
}  # fmt: skip


def _sequence(row: str, what: str, sequence: str) -> None:
    def do(desk: Desk) -> FaultResult:
        return clean(doors(desk, f"token4711 {sequence} end"), "token4711")

    do.__name__ = "row_" + row.replace(".", "_")
    promise = "none of it at any door: run, report in three forms, show, show --issue, explain, report.md, report.json"
    fault(row, section="what is printed", done=f"an exception holds {what}", promise=promise, limit=400)(do)


for _row, (_what, _text) in SEQUENCES.items():
    _sequence(_row, _what, _text)


def live(text: str) -> list[str]:
    """Return the live parts of a Markdown page, which it would follow, show or call; code does not count."""
    fenced = re.sub(r"(?ms)^(`{3,})[^`\n]*\n.*?^\1`*$", "", text)
    plain = re.sub(r"(?m)^ {4}.*$", "", fenced)
    spans = re.sub(r"(?<!`)(`+)(?!`).+?(?<!`)\1(?!`)", "", plain)
    matches = re.findall(r"!\[[^\]]*\]\([^)]*\)|(?<!\\)\[[^\]]*\]\(http://evil[^)]*\)", spans)
    return matches + re.findall(r"(?<![\w`])@everyone|<script|<img", spans)


def pages(texts: Mapping[str, str]) -> FaultResult:
    """Hold that no page has anything live that came from a package."""
    names = ("report --format md", "report --format github-summary", "report.md", "show --issue")
    live_parts = {name: live(texts[name]) for name in names if live(texts[name])}
    return FaultResult(f"{len(names)} pages, live: {live_parts or 'nothing'}", not live_parts)


@fault(
    "112",
    section="what is printed",
    limit=400,
    done="an exception holds `<script>`, `<img>` and bars of a table",
    promise="they are text on every page",
)
def tags(desk: Desk) -> FaultResult:
    """Raise HTML."""
    texts = doors(desk, "<script>alert(1)</script> | a | <img src=http://evil.example/x.png> | b")
    came = pages(texts)
    rows = [line for line in texts["report.md"].splitlines() if line.startswith("|") and "alert" in line]
    bars = {len(re.findall(r"(?<!\\)\|", line)) for line in rows}
    return FaultResult(f"{came.what}; bars {bars}", came.held and len(bars) <= 1)


@fault(
    "113.1",
    section="what is printed",
    limit=400,
    done="an exception holds a link and a picture",
    promise="no page calls home",
)
def picture(desk: Desk) -> FaultResult:
    """Raise Markdown."""
    return pages(doors(desk, "![i](http://evil.example/x.png) [pypi](http://evil.example) [a]: http://evil.example"))


@fault("113.2", section="what is printed", limit=400, done="an exception calls @everyone", promise="nobody is called")
def mention(desk: Desk) -> FaultResult:
    """Raise a mention."""
    return pages(doors(desk, "@everyone (@everyone) look"))


@fault(
    "113.3",
    section="what is printed",
    limit=400,
    done="an exception opens code spans that do not close as they seem to",
    promise="no picture leaves them",
)
def spans(desk: Desk) -> FaultResult:
    """Raise backticks of several lengths around a picture."""
    return pages(doors(desk, "`` ![i](http://evil.example/x.png) ` and \\` ![j](http://evil.example/y.png) `"))


@fault(
    "114.1",
    section="what is printed",
    limit=400,
    done="an exception holds lines of three to seven backticks",
    promise="no line of it ends a block of the issue",
)
def fence(desk: Desk) -> FaultResult:
    """Raise fences around HTML."""
    lines = "\n".join("`" * count + "\n<script>x</script>\n# heading" for count in range(3, 8))
    issue = doors(desk, lines)["show --issue"]
    outside = re.sub(r"(?ms)^(`{3,})[^`\n]*\n.*?^\1$", "", issue)
    left = [line for line in outside.splitlines() if line in {"<script>x</script>", "# heading"}]
    return FaultResult(f"{len(left)} lines outside a block", not left)


@fault(
    "114.2",
    section="what is printed",
    limit=400,
    done="the heading of an issue is an exception with HTML and @everyone",
    promise="it is text",
)
def heading(desk: Desk) -> FaultResult:
    """Raise what a heading would obey."""
    issue = doors(desk, "<img src=x> @everyone ![i](http://evil.example)")["show --issue"]
    first = issue.splitlines()[0]
    return FaultResult(first, not live(first))


@fault(
    "115",
    section="what is printed",
    limit=400,
    done="an exception holds workflow commands of GitHub on lines of their own",
    promise="annotations stay single lines, no command but ours begins one",
)
def commands(desk: Desk) -> FaultResult:
    """Raise `::error::` and its like."""
    text = "x\n::error::owned\n::set-output name=a::b\n::stop-commands::t\n%0A::add-mask::x\r\n::warning::w"
    output = doors(desk, text)["report --format github"]
    strange = [line for line in output.splitlines() if not line.startswith("::error title=")]
    return FaultResult(
        f"{len(output.splitlines())} lines, strange: {strange or 'none'}", not strange and "::error" in output
    )


@fault(
    "116",
    section="what is printed",
    limit=400,
    done="an exception of 5 MB on one line",
    promise="every door is below 100 KB",
)
def long_message(desk: Desk) -> FaultResult:
    """Raise a long message."""
    texts = doors(desk, "x", top="class Long(Exception):\n    def __str__(self): return 'y' * 5_000_000", kind="Long")
    longest = max((len(text), door) for door, text in texts.items())
    return FaultResult(f"the longest is {longest[1]}: {longest[0]} characters", longest[0] < 100_000)


@fault(
    "117.1",
    section="what is printed",
    limit=400,
    done="an exception whose `__str__` raises, of a class with escapes in its name",
    promise="it is told, without the escapes",
)
def odd_class(desk: Desk) -> FaultResult:
    """Raise what cannot be written down."""
    top = (
        "class Odd(Exception):\n    def __str__(self): raise RuntimeError('no')\nOdd.__name__ = 'Odd\\x1b[31m\\x9bName'"
    )
    texts = doors(desk, "x", top=top, kind="Odd")
    dirty = [door for door, text in texts.items() if OBEYED.search(text)]
    return FaultResult(f"raw at {dirty or 'none'}", not dirty and "broken" in texts["run"] + texts["show"])


@fault(
    "117.2",
    section="what is printed",
    limit=400,
    done="an exception whose `__module__` is a number",
    promise="the cell is broken",
)
def odd_module(desk: Desk) -> FaultResult:
    """Raise a class that lives nowhere."""
    top = "class Odd(Exception): pass\nOdd.__module__ = 7"
    texts = doors(desk, "token4711", top=top, kind="Odd")
    return FaultResult(texts["show"].splitlines()[1], "token4711" in texts["show"])


@fault(
    "118.1",
    section="what is printed",
    limit=400,
    done="the same on a real terminal, with the progress board",
    promise="only our own colours and movements reach it, and never a title, a clipboard or another set",
)
def terminal(desk: Desk) -> FaultResult:
    """Run on a pseudo-terminal."""
    matrix = desk.hostile(
        checks=("single",), step="raise ValueError('token4711 \\x1b]0;owned\\x07\\x1bc\\x1b(0\\x9b5m')"
    )
    controller, own = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "harness", "run", str(matrix)], cwd=desk.folder,
        env=desk.environment({"TERM": "xterm"}), stdin=own, stdout=own, stderr=own, start_new_session=True,
    ) as process:  # fmt: skip
        os.close(own)
        pieces = []
        while True:
            try:
                piece = os.read(controller, 1 << 16)
            except OSError:  # the end of a pseudo-terminal
                break
            if not piece:
                break
            pieces.append(piece)
    os.close(controller)
    text = b"".join(pieces).decode("utf-8", "replace")
    bad = re.findall(r"\x1b[\]c(]|\x9b|\x07", text)
    return FaultResult(
        f"exit {process.returncode}, {len(text)} characters, bad: {bad or 'none'}", not bad and "token4711" in text
    )
