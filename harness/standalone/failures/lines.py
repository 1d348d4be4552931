"""Find the one line of a text that says why something failed.

Of a long text the decisive line is what a person would quote: the exception that started a chain rather than the last
one of it, the compiler's complaint rather than "command failed", a resolver's explanation in one piece.
"""

from __future__ import annotations

import re
import signal
from typing import Iterator, Mapping, NamedTuple, Sequence

from ..control_characters import SEQUENCE, strip_controls

LIMIT = 300
"""Characters of a decisive line."""

MASKS = frozenset({"BrokenPipeError", "ConnectionResetError", "EOFError"})
"""What a process sees of the death of another: never the cause where anything else was raised."""

SILENT = "without a word"
"""How the line ends that tells of a process that died and left none."""

LOOKUPS = frozenset({"KeyError", "IndexError", "StopIteration"})
"""Causes that carry a bare key: the exception raised from them says more."""

PATH_START = r"(?:(?<![\w.-])|(?<=-[IL]))"
DEEP = 3
"""Folders of a path that is part of no other: it may follow a letter, where two streams were printed in one line."""

PATH_END = r"(?![\w-])(?!\.\w)"
"""`/tmp` is no part of `/var/tmp` or `/tmp2`, and is a part of `-I/tmp/include`."""

CHANGING = (
    (re.compile(r"\bhttps?://[^/\s\"'<>]+(?=/(?:simple|packages)/)"), "$INDEX"),
    (re.compile(r"\b0x[0-9a-fA-F]{6,}\b"), "0x…"),
    (re.compile(r"\b(pid)([ =:]+)\d+", re.IGNORECASE), r"\1\2…"),
    (re.compile(r"(/builds-v\d+/)\.tmp\w+"), r"\1.tmp…"),
    (re.compile(r"(/tmp)\w{6,}(?=/|\b)"), r"\1…"),
    (re.compile(r"\b(localhost|127\.0\.0\.1|0\.0\.0\.0|\[::1\]):\d+"), r"\1:…"),
    (re.compile(r"\b(in|took|after) \d+(?:\.\d+)? ?(?:ns|us|µs|ms|s|seconds)\b"), r"\1 … s"),
)
"""What differs between machines and runs: index mirrors, addresses, processes, temporary names, ports, timings."""


def strip_ansi(text: str) -> str:
    """Remove what a terminal would obey, and keep what a carriage return left standing."""
    lines = SEQUENCE.sub("", text).replace("\r\n", "\n").split("\n")
    return strip_controls("\n".join(line.rstrip("\r").rpartition("\r")[2] for line in lines))


def normalise(text: str, places: Mapping[str, str]) -> str:
    """Replace folders of this machine (path to name, such as `$ENV`) and all that changes from run to run."""
    text = strip_ansi(text)
    # The longest path goes first, since a shorter one may be the beginning of it.
    for path in sorted(filter(None, places), key=len, reverse=True):
        if path.rstrip("/") not in text:  # most are not, and each has an expression of its own
            continue
        start = PATH_START if path.rstrip("/").count("/") < DEEP else ""
        text = re.sub(start + re.escape(path.rstrip("/")) + PATH_END, places[path].replace("\\", r"\\"), text)
    for pattern, replacement in CHANGING:
        text = pattern.sub(replacement, text)
    return text


def decisive_line(text: str) -> str | None:
    """Return the one line of a log, stderr or traceback that says why, at most `LIMIT` characters; None if empty."""
    lines = strip_ansi(text).splitlines()
    exception = original(lines)
    compiler = _compiler(lines)
    if exception and not (compiler and re.search(r"command .* failed|CalledProcessError|CompileError", exception)):
        return shorten_line(exception)
    rules = (_fatal, _resolver, lambda _: compiler, _complaint, _last)
    candidates = (rule(lines) for rule in rules)
    return next((shorten_line(line) for line in candidates if line), None)


def shorten_line(text: str) -> str:
    """Return a text as one line of at most `LIMIT` characters: line breaks become ` / `, repeated blanks one."""
    parts = (" ".join(strip_controls(part).split()) for part in text.splitlines())
    line = " / ".join(part for part in parts if part)
    return line if len(line) <= LIMIT else line[: LIMIT - 1].rstrip() + "…"


# --- Python's own tracebacks -----------------------------------------------------------------------------------

HEADER = re.compile(r"^(\s*)Traceback \(most recent call last\):\s*$")
REPORT = re.compile(HEADER.pattern + r"|^Exception (?:ignored )?in|^Process \S+:$")
EXCEPTION = re.compile(r"^[A-Za-z_][\w.<>]*(?:$|: ?)")
FRAME = re.compile(r'File "([^"]+)", line (\d+)(?:,)? in (.+)')
MESSAGE_LINES = 4
MISSING_MODULE = re.compile(r"^ModuleNotFoundError: No module named '([^'.]+)")
CLEANING_UP = frozenset({"close", "__exit__", "__del__", "terminate"})
CAUSE = "The above exception was the direct cause of the following exception:"
CONTEXT = "During handling of the above exception, another exception occurred:"


class Block(NamedTuple):
    """One traceback: its exception, how the one before leads to it, and whether it was raised while cleaning up."""

    text: str
    link: str | None
    cleaning_up: bool

    @property
    def kind(self) -> str:
        """Return the name of the exception's class."""
        return self.text.partition(":")[0].rpartition(".")[2]


def original(lines: Sequence[str]) -> str | None:
    """Return the exception that started the last chain which is no mere echo of another process's death."""
    picks = [root(chain) for chain in chains(lines)]
    telling = [block for block in picks if block.kind not in MASKS]
    last = (telling or picks)[-1:]
    return last[0].text if last else None


def root(chain: Sequence[Block]) -> Block:
    """Choose the original of a chain.

    An explicit cause is the original, unless it is a bare lookup. An exception that was being *handled* is not: it
    was a first try (an optional import), except where the later one is a mask or was raised while cleaning up.
    """
    chosen = chain[-1]
    for earlier, later in zip(reversed(chain[:-1]), reversed(chain[1:])):
        told_by_earlier = (
            not _says_less(earlier, later) if later.link == CAUSE else later.kind in MASKS or later.cleaning_up
        )
        if not told_by_earlier:
            break
        chosen = earlier
    return chosen


def _says_less(cause: Block, raised: Block) -> bool:
    """Return whether a cause says less than the exception raised from it.

    That is so for a bare key, and for a missing module that the exception names, too.
    """
    missing = MISSING_MODULE.search(cause.text)
    return cause.kind in LOOKUPS or bool(missing and missing[1].casefold() in raised.text.casefold())


def chains(lines: Sequence[str]) -> Iterator[tuple[Block, ...]]:
    """Yield the tracebacks of a text in chains, in which each led to the next."""
    chain: list[Block] = []
    for block in blocks(lines):
        if chain and block.link is None:
            yield tuple(chain)
            chain = []
        chain.append(block)
    if chain:
        yield tuple(chain)


def blocks(lines: Sequence[str]) -> Iterator[Block]:
    """Yield every traceback of a text, whatever its indentation, except those of exceptions that Python ignored."""
    link: str | None = None
    position = 0
    while position < len(lines):
        header = HEADER.match(lines[position])
        if header and not lines[max(position - 1, 0)].startswith("Exception ignored"):
            block, position = _block(lines, position + 1, header.group(1), link)
            link = None
            if block:
                yield block
            continue
        stripped = lines[position].strip()
        link = stripped if stripped in {CAUSE, CONTEXT} else link
        position += 1


def _block(lines: Sequence[str], start: int, indent: str, link: str | None) -> tuple[Block | None, int]:
    """Read one traceback from the line after its header; a message goes on to a blank line or the next report."""
    position = start
    frames: list[str] = []
    while position < len(lines) and _without(indent, lines[position]).startswith((" ", "\t")):
        frames.append(lines[position])
        position += 1
    message: list[str] = []
    while position < len(lines) and lines[position].strip() and not REPORT.match(lines[position]):
        message.append(_without(indent, lines[position]))
        position += 1
    if not message or not EXCEPTION.match(message[0]):
        return None, position
    text = "\n".join((*message[:MESSAGE_LINES], *_rest(lines, position)))
    functions = {match.group(3) for match in map(FRAME.search, frames) if match}
    return Block(text, link, cleaning_up=bool(functions & CLEANING_UP)), position


def _without(indent: str, line: str) -> str:
    return line[len(indent) :] if line.startswith(indent) else line


def _rest(lines: Sequence[str], position: int) -> tuple[str, ...]:
    """Return the element and its line, which MuJoCo's compiler puts after a blank line."""
    following = lines[position + 1 : position + 2]
    return tuple(line for line in following if line.startswith("Element '"))


# --- other ways to say why -------------------------------------------------------------------------------------

ERROR = re.compile(r"^\s*(?:\w+: )?(?:fatal |[\w.]*)(?:error|exception)(?: in [\w.-]+ setup command)?: ", re.IGNORECASE)


def _fatal(lines: Sequence[str]) -> str | None:
    """Return the line in which C++, glibc or faulthandler reports a crash; the former two say more."""
    for pattern in (r"^\s*what\(\):\s", r": Assertion .* failed", r"^Fatal Python error: "):
        fatal_line = next((line for line in lines if re.search(pattern, line)), None)
        if fatal_line:
            return fatal_line
    return None


def _resolver(lines: Sequence[str]) -> str | None:
    """Explain a resolution without solution as uv does, both in its present form and in that of older releases."""
    start = next((n for n, line in enumerate(lines) if "No solution found" in line), None)
    if start is None:
        return None
    explanation = []
    for line in lines[start + 1 :]:
        if not line.strip() or line.startswith("hint:"):
            break
        explanation.append(re.sub(r"^\s*(?:cause:|╰─▶)?\s*", "", line))
    text = " ".join(explanation)
    return re.sub(r",? (?:and )?we can conclude that your requirements are unsatisfiable\.$", "", text) or lines[start]


def _compiler(lines: Sequence[str]) -> str | None:
    """Quote the first error of a compiler or of CMake: the ones after it follow from it."""
    for position, line in enumerate(lines):
        if re.search(r"^\s*\S+:\d+(?::\d+)?: (?:fatal )?error: ", line):
            return line
        if line.lstrip().startswith("CMake Error"):
            return "\n".join((line, *lines[position + 1 : position + 2]))
    return None


def _complaint(lines: Sequence[str]) -> str | None:
    """Quote the last line that calls itself an error; `error in gym setup command` is setuptools' way."""
    complaints = [line for line in lines if ERROR.match(line)]
    return complaints[-1] if complaints else None


def _last(lines: Sequence[str]) -> str | None:
    return next((line for line in reversed(lines) if line.strip()), None)


# --- how a process died -----------------------------------------------------------------------------------------


def describe_death(exit_code: int | None, number: int | None, stacks: str) -> str:
    """Describe how a process died.

    `stacks` is the output of faulthandler, after the process's log where there is one.

    An abort gives its reason in the log (`what():`, a failed assertion).
    """
    if not number:
        return f"exited with code {exit_code} {SILENT}"
    fatal = _fatal(strip_ansi(stacks).splitlines())
    where = innermost_frame(stacks)
    description = (
        f"killed by {signal_name(number)}"
        + (f" ({fatal.strip()})" if fatal else "")
        + (f" in {where}" if where else "")
    )
    return shorten_line(description)


def signal_name(number: int) -> str:
    """Return the name of a signal, such as `SIGSEGV`."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def innermost_frame(stacks: str) -> str | None:
    """Name the function that crashed or hangs: of the current thread, else of the main one, which is dumped last."""
    threads = re.split(r"(?m)^(?=(?:Current thread|Thread|Stack) .*\(most recent call first\):)", stacks)
    current = [thread for thread in threads if thread.startswith("Current thread")]
    frame = FRAME.search((current or threads)[-1])
    if not frame:
        return None
    path = "/".join(frame.group(1).split("/")[-2:])
    return f"{frame.group(3).strip()}, {path} line {frame.group(2)}"
