"""Run the commands of Markdown pages and compare their output with the pages.

A fenced block `console` holds commands, each after `$ `, and below each its output. In an output `...` stands for any
text, and lines may be wrapped elsewhere than on the page. All blocks of a page run in one temporary folder, in their
order. A comment before a block, `<!-- example: WORD... -->`, may say:

    exit=N        the exit code of the block's last command [0]
    files=FOLDER  first copy this folder of the repository into the working folder
    file=NAME     write the block to this file; it is no command
    network       needs a package index

    python docs/making/run_examples.py [--no-network] PAGE...
"""

from __future__ import annotations

import argparse
import difflib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(
    r"(?:^<!-- example: (?P<options>.*?) -->\n\s*)?^```(?P<language>[\w.-]*)\n(?P<body>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
OPTIONS = {"exit", "files", "file", "network"}
LIMIT = 300
"""Seconds that a command may take."""
ANY = "..."
UNSET = ("PYTHONPATH", "VIRTUAL_ENV", "CONDA_PREFIX", "HARNESS_STATE", "HARNESS_RESULTS", "MUJOCO_GL")
"""Variables of the caller that would change what a reader sees."""


@dataclass(frozen=True, kw_only=True)
class Example:
    """A command of a page and its output, or a file to write."""

    line: int
    command: str = ""
    output: str = ""
    exit_code: int = 0
    folder: str = ""
    file: str = ""
    network: bool = False


def examples(text: str) -> Iterator[Example]:
    """Yield the examples of a page in their order. Raises ValueError for a comment or a block that is none."""
    for block in BLOCK.finditer(text):
        line = text.count("\n", 0, block.start("body"))
        options = _options(block["options"] or "", line)
        if "file" in options:
            yield Example(line=line, file=options["file"], output=block["body"])
        elif block["language"] == "console":
            yield from _commands(block["body"], options, line)
        elif options:
            message = f"line {line}: options before a block that is no `console`"
            raise ValueError(message)


def _options(text: str, line: int) -> dict[str, str]:
    options = dict(word.partition("=")[::2] for word in text.split())
    if unknown := options.keys() - OPTIONS:
        message = f"line {line}: unknown option {sorted(unknown)}; choose from {sorted(OPTIONS)}"
        raise ValueError(message)
    return options


def _commands(body: str, options: Mapping[str, str], first: int) -> Iterator[Example]:
    lines = body.splitlines()
    starts = [index for index, line in enumerate(lines) if line.startswith("$ ")]
    if not starts or starts[0] != 0:
        message = f"line {first}: a `console` block begins with a command: `$ ...`"
        raise ValueError(message)
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        last = start + 1
        while last < end and lines[last].startswith("> "):
            last += 1
        yield Example(
            line=first + start + 1,
            command="\n".join(line[2:] for line in lines[start:last]),
            output="\n".join(lines[last:end]),
            exit_code=int(options.get("exit", 0)) if end == len(lines) else 0,
            folder=options.get("files", "") if start == 0 else "",
            network="network" in options,
        )


def fits(expected: str, printed: str) -> bool:
    """Return whether a printed text is the expected one: `...` stands for any text, lines may be wrapped elsewhere."""
    text = " ".join(printed.split())
    first, *rest = (" ".join(part.split()) for part in expected.split(ANY))
    if not rest:
        return text == first
    place = len(first)
    for part in rest[:-1]:
        place = text.find(part, place) + len(part) if part in text[place:] else len(text) + 1
    return text.startswith(first) and text.endswith(rest[-1]) and place <= len(text) - len(rest[-1])


@dataclass(frozen=True, kw_only=True)
class Workplace:
    """A folder in which the commands of a page are run, and their variables."""

    folder: Path
    environment: Mapping[str, str]


@contextmanager
def workplace(*, network: bool) -> Iterator[Workplace]:
    """Make an empty workplace that is removed at the end; without a network its cache is empty, too."""
    with tempfile.TemporaryDirectory(prefix="simmatrix-docs-") as name:
        folder = Path(name, "work")
        folder.mkdir()
        yield Workplace(folder=folder, environment=_environment(Path(name), network=network))


def commands(page: Path, place: Workplace, *, network: bool) -> Iterator[Example]:
    """Yield the commands of a page in their order, each once the files before it are written."""
    for example in examples(page.read_text(encoding="utf-8")):
        if example.network and not network:
            continue
        if example.folder:
            shutil.copytree(ROOT / example.folder, place.folder, dirs_exist_ok=True)
        if example.file:
            (place.folder / example.file).parent.mkdir(parents=True, exist_ok=True)
            (place.folder / example.file).write_text(example.output, encoding="utf-8")
        else:
            yield example


def run_page(page: Path, *, network: bool) -> Iterator[str]:
    """Run the examples of a page; yield a text for each that fails."""
    with workplace(network=network) as place:
        for example in commands(page, place, network=network):
            if failure := _failure(example, place):
                yield f"{_shown(page)}:{example.line}: $ {example.command}\n{failure}"


CLOSED = "http://127.0.0.1:9"
"""A proxy that is not there: whoever asks it fails at once."""


def _environment(place: Path, *, network: bool) -> dict[str, str]:
    """Return the variables of the commands: `simmatrix` is this checkout's."""
    program = place / "bin" / "simmatrix"
    program.parent.mkdir()
    program.write_text(
        f"#!{sys.executable}\nimport sys\n\nsys.path[0] = {str(ROOT)!r}\n"
        "from harness.__main__ import console\n\nconsole()\n",
        encoding="utf-8",
    )
    program.chmod(0o755)
    path = os.pathsep.join([str(program.parent), str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    own = {name: value for name, value in os.environ.items() if name not in UNSET}
    if not network:
        own |= dict.fromkeys(("HTTP_PROXY", "HTTPS_PROXY", "http_proxy", "https_proxy"), CLOSED)
        own |= {"HARNESS_CACHE": str(place / "cache")}
    return {**own, "PATH": path, "COLUMNS": "100", "NO_COLOR": "1", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}


def _failure(example: Example, place: Workplace) -> str | None:
    """Run a command; return the difference from the page, or None."""
    started = time.monotonic()
    try:
        ran = subprocess.run(
            ["bash", "-c", example.command],
            cwd=place.folder,
            env=dict(place.environment),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"ran longer than {LIMIT} s"
    print(f"{time.monotonic() - started:6.1f} s  $ {example.command}", file=sys.stderr)
    if ran.returncode != example.exit_code:
        return f"exit code {ran.returncode}, not {example.exit_code}\n{ran.stdout}"
    if not fits(example.output, ran.stdout):
        return "\n".join(
            difflib.unified_diff(
                example.output.splitlines(), ran.stdout.splitlines(), "page", "printed", lineterm="", n=1
            )
        )
    return None


def _shown(page: Path) -> str:
    path = page.resolve()
    return path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else str(page)


def pages() -> list[Path]:
    """Return every page that has examples: the README and the documents."""
    listed = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [page for page in listed if "```console" in page.read_text(encoding="utf-8")]


def main(arguments: Sequence[str]) -> int:
    """Run the pages that the arguments name, or all; return 1 if an example fails."""
    parser = argparse.ArgumentParser(description="Run the commands of Markdown pages and compare their output.")
    parser.add_argument("pages", metavar="PAGE", nargs="*", type=Path, help="a Markdown file [README.md and docs/]")
    parser.add_argument("--no-network", action="store_true", help="leave out examples that need a package index")
    options = parser.parse_args(arguments)
    failures = 0
    for page in options.pages or pages():
        for failure in run_page(page, network=not options.no_network):
            failures += 1
            print(f"{failure}\n")
    print(f"{failures} examples differ" if failures else "all examples print what their pages show")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
