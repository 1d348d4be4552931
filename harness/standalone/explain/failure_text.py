"""Read a failure from a text of unknown origin: the lines that say why, the phase, and the signal that killed.

Tracebacks of notebooks, of workers whose lines carry a prefix, and of pytest are read as Python's own.
"""

from __future__ import annotations

import re
from typing import Iterator, List, NamedTuple, Optional, Sequence, Tuple

from ..failures import lines as said
from ..failures.lines import EXCEPTION, FRAME, MASKS, shorten_line, strip_ansi
from .installer_errors import installer

START = "Traceback (most recent call last):"
PREFIXED = re.compile(r"^(\s*\S.{0,150}?)Traceback \(most recent call last\):\s*$")
NOTEBOOK = re.compile(r"^([A-Za-z_][\w.]*)\s{2,}Traceback \(most recent call last\)\s*$")
PYTEST = re.compile(r"^E {2,}(?=[A-Za-z_][\w.]*(?:Error|Exception|Interrupt|Exit|Warning)\b)", re.MULTILINE)
AFTER = re.compile(
    r"^\s*\[end of output\]|^(?:wandb|srun|g?make(?:\[\d+\])?|error|note|hint|explain|ninja|slurmstepd|sys): "
    r"|^\[?(?:INFO|WARN(?:ING)?|ERROR|DEBUG|Info|Warning|Error)\b|^\d{4}-\d\d-\d\d[ T]|^/\S+:\d+: \w*Warning: "
    r"|^Exception in thread|^Exception ignored|^Process \S+:$"
)
"""How lines begin that no message of an exception has."""

RULE = re.compile(r"^-{20,}$")
NO_PREFIX = re.compile(r"Exception|^\s*raise|['\"]$")
PREFIXES = 20
"""Different ones that are looked at."""


class Failure(NamedTuple):
    """A failure as its text tells it: `lines` say why, the decisive one first; `phase` is where it may have failed.

    `failed` is whether there is a failure at all, `marked` whether the text itself says so, `raised` whether the
    decisive line is an exception, of the traceback `region`. `text` is all of it, its tracebacks in one form; its last
    line is `last`.
    """

    decisive: Optional[str]
    lines: Tuple[str, ...]
    phase: Optional[str]
    signal: Optional[str]
    failed: bool
    marked: bool
    raised: bool
    region: str
    text: str
    last: str


OPTIONAL = re.compile(
    r"^Failed to import (?:mujoco_)?warp: No module named .*\n?"
    r"|^\[.* E \d+ \d+\] .*Failed to establish connection to the metrics exporter agent.*\n?",
    re.MULTILINE,
)
"""Lines about what a library can do without: of MuJoCo's MJX without Warp, of Ray without its metrics."""


def read_failure(text: str, *, surely: bool = False) -> Failure:
    """Read a text and return its failure; `surely` means that something is known to have failed."""
    text = OPTIONAL.sub("", unify_tracebacks(strip_ansi(text)))
    lines = _without_ignored(text.splitlines())
    text, whole = "\n".join(lines), text
    picked = list(_tracebacks(lines))
    gave_up = installer(lines)
    killed = _signal(text)
    # Without a traceback an installer's reason is what a person would quote.
    decisive = gave_up if gave_up and not picked else said.decisive_line(text)
    marked = bool(picked or gave_up or killed or MARKED.search(text) or NAMED.search(text))
    if len(lines) <= QUOTED:
        marked = marked or RAISED.search(text) is not None or _complains(lines)
    failed = marked or surely
    first = decisive if failed else None
    every = [line for line in [first, *reversed(picked), *_complaints(lines, with_others=not picked)] if line]
    region = _region(lines, first) if first in picked else ""
    return Failure(
        decisive=first,
        lines=tuple(dict.fromkeys(every)),
        phase=_phase(text, gave_up, region),
        signal=killed,
        failed=failed,
        marked=marked,
        raised=first in picked and first is not None and first.partition(":")[0].rpartition(".")[2] not in MASKS,
        region=region,
        text=whole,
        last=next((shorten_line(line) for line in reversed(lines) if line.strip()), ""),
    )


def _region(lines: Sequence[str], decisive: Optional[str]) -> str:
    """Return the traceback that ends with the decisive line; empty if there is none."""
    begin = (decisive or "").partition(" / ")[0][:80]
    word = begin.partition(" ")[0]
    ends = [place for place, line in enumerate(lines) if word in line and shorten_line(line).startswith(begin)]
    if not ends:
        return ""
    starts = [place for place in range(ends[-1]) if START in lines[place]]
    return "\n".join(lines[starts[-1] if starts else ends[-1] : ends[-1] + 1])


# --- one form of tracebacks ------------------------------------------------------------------------------------


def unify_tracebacks(text: str) -> str:
    """Return the text with its tracebacks as Python itself prints them, and a blank line after each."""
    lines = _without_prefixes(text.splitlines())
    lines = _notebooks(lines) if any(NOTEBOOK.match(line) for line in lines) else lines
    return PYTEST.sub("", "\n".join(_separate_output(lines)))


def _separate_output(lines: Sequence[str]) -> Iterator[str]:
    """Yield the lines, with a blank one between an exception and a tool's output: that is no part of the message."""
    traceback = False
    for line in lines:
        if traceback and AFTER.match(line):
            traceback = False
            yield ""
        traceback = bool(line.strip()) and (traceback or START in line)
        yield line


def _without_ignored(lines: Sequence[str]) -> List[str]:
    """Return the lines without exceptions that Python ignored: they stopped nothing."""
    remaining_lines: List[str] = []
    ignored = False
    for line in lines:
        if line.startswith("Exception ignored"):
            ignored = True
        elif ignored and not (line.startswith((" ", "Traceback")) or EXCEPTION.match(line)):
            ignored = False
        remaining_lines += [] if ignored else [line]
        ignored = ignored and not (EXCEPTION.match(line) and not line.startswith(("Exception ignored", "Traceback")))
    return remaining_lines


def _without_prefixes(lines: Sequence[str]) -> List[str]:
    """Remove the prefixes that a launcher of workers, a service or a log puts before lines: `[rank0]: `, `(pid=1) `."""
    matches = (PREFIXED.match(line) for line in lines if START in line)
    shapes = dict.fromkeys(
        _shape(match.group(1)) for match in matches if match and not NO_PREFIX.search(match.group(1))
    )
    if not shapes:
        return list(lines)
    prefix = re.compile("|".join("(?:{})".format(shape) for shape in list(shapes)[:PREFIXES]))
    return [prefix.sub("", line, count=1) if prefix.match(line) else line for line in lines]


def _shape(prefix: str) -> str:
    """Return a pattern for a prefix with any numbers; on an empty line it may lack the blank at its end."""
    bare = prefix.rstrip()
    shape = re.sub(r"\d+", r"\\d+", re.escape(bare))
    return shape + ("(?: |$)" if bare != prefix else "")


def _notebooks(lines: Sequence[str]) -> List[str]:
    """Rewrite a notebook's tracebacks as Python's own: a header, and indented frames below it."""
    new_lines: List[str] = []
    kind: Optional[str] = None
    for line in lines:
        header = NOTEBOOK.match(line)
        if header:
            kind = header.group(1)
            new_lines.append(START)
        elif kind is None:
            new_lines += [] if RULE.match(line) else [line]
        elif line.startswith((kind + ":", kind.rpartition(".")[2] + ":")) or line.strip() == kind:
            kind = None
            new_lines.append(line)
        elif line.strip():
            new_lines.append("  " + line)
    return new_lines


# --- the lines that say why ------------------------------------------------------------------------------------


def _tracebacks(lines: Sequence[str]) -> Iterator[str]:
    """Yield the original exception of every chain, first the echoes of another process's death.

    The caller reverses this order.
    """
    picks = [said.root(chain) for chain in said.chains(lines)]
    yield from (shorten_line(block.text) for block in picks if block.kind in MASKS)
    yield from (shorten_line(block.text) for block in picks if block.kind not in MASKS)


MARKS = (
    r"^\s*(?:\w+: )?(?:fatal |[\w.]*)(?:error|exception)(?: in [\w.-]+ setup command)?: (?![-+]?\d)",
    r"^\s*what\(\):\s",
    r": Assertion .* failed",
    r"^Fatal Python error: ",
    r"^\s*CMake Error",
    r": (?:fatal )?error: ",
    r": version `\S+' not found",
    r"^Failed to create an OpenGL context",
    r"^(?:\S*sh|env|\S+: line \d+): .*(?:command not found|No such file or directory|Permission denied)$",
    r"^\S+: can't open file '",
    r"^\[(?:Error|Fatal)\] \[",
    r"^E +\w+.*(?:Error|Exception)",
    r"^\*\*\* Error in ",
    r"^(?:free|malloc|realloc)\(\): |double free or corruption",
    r"is incompatible\.$",
    r"failed with exit code [1-9]",
    r"^(?:FAILED|ERROR) \S+::",
    r"exit(?:ed with)? code:? [1-9]",
)
"""Of lines that tell of a failure; a model's `error: 0.3` is none."""

MARKED = re.compile("|".join(MARKS), re.MULTILINE | re.IGNORECASE)
NAMED = re.compile(r"\b[A-Za-z]*(?:Error|Exception): \D")
RAISED = re.compile(
    r"^(?:[a-z_]\w*\.)+[A-Z]\w+: \S"
    r"|^[A-Z][A-Za-z]*(?:NotFound|Fault|Failed|Failure|Missing): \S"
    r"|^(?:Deprecated|Invalid|Unregistered|Unsupported)[A-Z]\w*: \S"
    r"|^\W*(?:\w+\.)*\w*(?:[A-Za-z]Error|Exception)(?:: .*)?$",
    re.MULTILINE,
)
"""The beginning of an exception that is not called an error. Other lines begin so, too: it counts in short texts."""

COMPLAINS = re.compile(
    r"(?<!returned )\berror: \D|\b(?:[Cc]annot|[Cc]ould not|[Uu]nable to|[Ff]ailed to|[Nn]ot found|[Ii]ncompatible"
    r"|[Cc]onflict\w*|[Uu]ndefined symbol|is not installed|[Uu]nsupported|does not (?:exist|provide)|not available"
    r"|no longer supported|has been removed|has no attribute|[Nn]o matching|[Ii]nvalid)\b"
)
"""Words of a line by itself that complains; a log has them in lines that stopped nothing."""


def _complains(lines: Sequence[str]) -> bool:
    """Return whether a text is one line that complains, and no warning."""
    written = [line for line in lines if line.strip()]
    return len(written) == 1 and "Warning" not in written[0] and COMPLAINS.search(written[0]) is not None


QUOTED = 4
"""Lines of a text that is no log: somebody asks what they mean."""


COMPLAINT = re.compile(r"^\[(?:Error|Fatal)\] \[")
"""Lines of Isaac Sim that call themselves errors in their own way."""

OTHER_COMPLAINT = re.compile(
    r": version `\S+' not found|^\s*CMake Error|^Failed to create an OpenGL context|^libGL error: MESA-LOADER: "
)
"""Lines of the loader, CMake and PyBullet; where an exception was raised, it counts."""


def _complaints(lines: Sequence[str], *, with_others: bool) -> Iterator[str]:
    """Yield the lines that call themselves errors, the last ones first; those of the loader and of CMake if wanted."""
    complaints = [
        line
        for line in lines
        if said.ERROR.match(line) or COMPLAINT.search(line) or (with_others and OTHER_COMPLAINT.search(line))
    ]
    yield from (shorten_line(line) for line in reversed(complaints[-40:]))


# --- where it failed -------------------------------------------------------------------------------------------

BUILD = re.compile(
    r"Failed(?: to)?(?: download and)? build(?:ing)?\b|Failed building wheel|build backend returned an error"
    r"|subprocess-exited-with-error|Could not build wheels|error in [\w.-]+ setup command|Getting requirements to build"
    r"|metadata-generation-failed|CMake Error|has invalid metadata|fatal error: |(?:setup\.py|egg_info) \S+ did not run"
    r"|CompileError|command .* failed with exit"
)
BUILDING = re.compile(r"(?:^|/)setup\.py$|/(?:setuptools|distutils|_distutils|pip/_internal|pyproject_hooks)/")
FAILED = re.compile(r"Failed to (?!resolve)|Request failed")
"""How what uv says begins where it had a solution."""

IMPORTING = re.compile(r"^(?:ModuleNotFoundError|ImportError|AttributeError: partially initialized module)\b")
VECTOR = re.compile(r"vector_env|async_vector|subproc_vec_env|AsyncVectorEnv|SubprocVecEnv|vec_env|ParallelEnv")
PACKAGE = re.compile(r"(?:site|dist)-packages")
USING = frozenset({"make", "__init__", "reset", "step", "render"})
"""Functions in which an import is one of something that is being used."""

RENDER = re.compile(
    r"in render\b|mujoco_rendering|rendering\.py|glfw|EGL|OSMesa|OpenGL|pyglet|GLError|libGL|X11|DISPLAY"
)


def _phase(text: str, gave_up: Optional[str], region: str) -> Optional[str]:
    """Return the phase that may have failed, judged by the text; None if nothing shows it."""
    # A failed build also prints tracebacks and an installer's reason, which would suggest other phases.
    if BUILD.search(text):
        return "install"
    if gave_up:
        return "install" if FAILED.match(gave_up) else "resolve"
    blocks = [said.root(chain) for chain in said.chains(text.splitlines())]
    telling = [block for block in blocks if block.kind not in MASKS] or blocks
    return (
        _of_traceback(telling[-1].text, region, echoed=any(block.kind in MASKS for block in blocks))
        if telling
        else None
    )


def _of_traceback(exception: str, region: str, *, echoed: bool) -> str:
    """Return the phase that an exception was raised in, judged by its traceback.

    `echoed` means that another process saw this one die.
    """
    frames = FRAME.findall(region)
    functions = [function.strip() for _, _, function in frames]
    if any(BUILDING.search(path) for path, _, _ in frames):
        return "install"
    if echoed or any(VECTOR.search(path) for path, _, _ in frames):
        return "vector"
    loaded = [n for n, (path, _, name) in enumerate(frames) if name.strip() == "<module>" and PACKAGE.search(path)]
    if (loaded or IMPORTING.match(exception)) and not USING & set(functions[: loaded[0] if loaded else None]):
        return "import"
    drawing = "render" in functions or any("rendering" in path for path, _, _ in frames)
    return "render" if drawing or RENDER.search(exception) else "single"


# --- what was killed -------------------------------------------------------------------------------------------

# A shell writes SIGKILL as exit code 137 (128 and its number, 9), Python as -9.
KILLED = (
    (re.compile(r"\bkilled by (SIG[A-Z]+)|<Signals\.(SIG[A-Z]+)|\((SIG[A-Z]+)\)"), ""),
    (
        re.compile(r"^Fatal Python error: Segmentation fault|\b[Ss]egmentation fault(?: \(core dumped\)|$)", re.M),
        "SIGSEGV",
    ),
    (re.compile(r"^Fatal Python error: Aborted|\bAborted(?: \(core dumped\)|$)|^terminate called", re.M), "SIGABRT"),
    (
        re.compile(r"^Fatal Python error: Illegal instruction|\bIllegal instruction(?: \(core dumped\)|$)", re.M),
        "SIGILL",
    ),
    (re.compile(r"^Fatal Python error: Floating point|\bFloating point exception", re.M), "SIGFPE"),
    (re.compile(r"^Fatal Python error: Bus error|\bBus error(?: \(core dumped\)|$)", re.M), "SIGBUS"),
    (re.compile(r"^(?:.*: line \d+:\s+\d+ )?Killed\b|exit(?:code|ed with code)?[: ]+(?:137|-9)\b", re.M), "SIGKILL"),
)


IN_KILLED = (
    ("SIG",), ("egmentation fault",), ("Aborted", "terminate called"), ("Illegal instruction",), ("loating point",),
    ("Bus error",), ("Killed", "exit"),
)  # fmt: skip
"""Literals of these patterns: most texts have none, which is seen quickly."""


def _signal(text: str) -> Optional[str]:
    """Return the name of the signal that killed a process, if the text says so; else None."""
    for (pattern, name), literals in zip(KILLED, IN_KILLED):
        match = pattern.search(text) if any(literal in text for literal in literals) else None
        if match:
            return name or next(one for one in match.groups() if one)
    return None
