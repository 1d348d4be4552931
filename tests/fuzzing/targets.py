"""Fuzzing targets: each takes one mutated input in a folder of its own and returns an exit code.

An input may be refused in a sentence (`HarnessError`, an exit code other than 4). Any other exception, a write outside
the folder, a process or a connection is a fault of ours.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import os
import random
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pypi_simple  # noqa: F401 - urllib3 makes a socket when it is imported
from fuzzing.mutating import ATOMS, content, mutate, mutate_json

from harness.__main__ import VERBS, main
from harness.model.errors import HarnessError
from harness.packages.requirement_files import inputs

ROOT = Path(__file__).parents[2]
LARGEST_SEED = 12_000
"""Characters of a file that is mutated: larger ones take longer and have nothing that small ones lack."""

REQUIREMENTS = {
    "requirements.txt": (
        "numpy>=1.26,<3 ; python_version >= '3.9'\ngymnasium[mujoco]==1.2.3 \\\n    --hash=sha256:00\n"
        "# a comment\n-r more.txt\n--extra-index-url https://index.example/simple\n-e .\n",
        "--only-binary :all:\n--find-links './wheels dir'\n./pkg-1.0-py3-none-any.whl\ntorch @ https://x.example/t.whl\n",
    ),
    "pyproject.toml": (
        '[project]\nname = "x"\nrequires-python = ">=3.9"\ndependencies = ["numpy>=1.26", "gymnasium"]\n'
        '[project.optional-dependencies]\nmujoco = ["mujoco>=3"]\nall = ["x[mujoco]"]\n'
        '[dependency-groups]\ndev = ["pytest", {include-group = "more"}]\nmore = ["ruff"]\n'
        '[tool.uv]\nconstraint-dependencies = ["numpy<3"]\n[[tool.uv.index]]\nurl = "https://index.example"\n',
    ),
    "environment.yml": (
        "name: x\nchannels: [conda-forge]\ndependencies:\n  - python=3.10\n  - numpy>=1.26\n  - pip\n  - pip:\n"
        "    - gymnasium[mujoco]==1.2.3\n    - -r more.txt\nvariables:\n  A: b\n",
    ),
    "pylock.toml": (
        'lock-version = "1.0"\ncreated-by = "uv"\nrequires-python = ">=3.9"\nextras = ["a"]\n[[packages]]\n'
        'name = "numpy"\nversion = "2.2.6"\nmarker = "\'a\' in extras"\n'
        'wheels = [{ name = "numpy-2.2.6-py3-none-any.whl",'
        ' url = "https://x.example/numpy-2.2.6-py3-none-any.whl", hashes = { sha256 = "00" } }]\n'
        '[[packages]]\nname = "x"\nvcs = { type = "git", url = "https://x.example/x", commit-id = "0" }\n',
    ),
}
"""Files of users, one of each format; the repository has no others."""

PLANNED = ("plan", "report", "merge", "show", "known", "recommend", "schema", "explain", "ci", "accept")
"""Verbs that start no process: of the others only the arguments are read."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """A name and what is done with one input; `make` writes it into the working folder, `run` returns a code."""

    name: str
    make: Callable[[random.Random], list[str]]
    run: Callable[[list[str]], int]


def texts(*globs: str) -> list[str]:
    """Return committed files that are small enough."""
    contents = (path.read_text(encoding="utf-8") for glob in globs for path in sorted(ROOT.glob(glob)))
    return [text for text in contents if len(text) <= LARGEST_SEED]


@cache
def matrices() -> list[str]:
    """Return the committed matrices, and those of the tests."""
    candidates = texts("matrices/*.toml", "matrices/*/*.toml", "tests/e2e/spine/*.toml")
    usable = []
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for text in candidates:
            written = text.replace("@FAKES@", '"fake-healthy"')
            Path("m.toml").write_text(written, encoding="utf-8")
            usable += [written] if command(["plan", "m.toml", "--offline"]) == 0 else []
    return usable


@cache
def reports() -> list[str]:
    """Return the committed reports that are small enough to be made again and again."""
    documents = [path.read_text(encoding="utf-8") for path in sorted(ROOT.glob("reports/*/report.json"))]
    return sorted(documents, key=len)[:4]


def command(words: list[str]) -> int:
    """Run one command line of the harness in this process, what it prints being thrown away."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as errors:
        before, sys.stdin = sys.stdin, io.TextIOWrapper(io.BytesIO(b"ValueError: x\n"))
        try:
            code = main(words)
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 2
        finally:
            sys.stdin = before
    assert code != HarnessError.exit_code, errors.getvalue()[-3000:]
    return code


def _matrix(chance: random.Random) -> list[str]:
    Path("m.toml").write_bytes(content(mutate(matrices(), chance), chance))
    return ["plan", "m.toml", "--offline", "--json"]


def _requirements(chance: random.Random) -> list[str]:
    name = chance.choice(sorted(REQUIREMENTS))
    every = [text for listed in REQUIREMENTS.values() for text in listed]
    seeds = list(REQUIREMENTS[name]) * 8 + every
    Path(name).write_bytes(content(mutate(seeds, chance), chance))
    return [name]


def _read_requirements(words: list[str]) -> int:
    try:
        inputs.read([Path(words[0])])
    except HarnessError as error:
        return error.exit_code
    return 0


def _report(chance: random.Random) -> list[str]:
    Path("report.json").write_bytes(content(mutate_json(reports(), chance), chance))
    form = chance.choice(["terminal", "md", "github", "github-summary", "table", "json"])
    return ["report", "report.json", "--format", form]


def _merge(chance: random.Random) -> list[str]:
    for name in ("one", "two"):
        Path(name).mkdir(exist_ok=True)
        Path(name, "report.json").write_text(chance.choice(reports()), encoding="utf-8")
    Path("two", "report.json").write_bytes(content(mutate_json(reports(), chance), chance))
    return ["merge", "one", "two", "--out", "out"]


def _site(chance: random.Random) -> list[str]:
    Path("report.json").write_bytes(content(mutate_json(reports(), chance), chance))
    return ["site", "report.json", "--out", "out"]


def _build_site(words: list[str]) -> int:
    os.environ["HARNESS_SIGNATURES"] = ""  # pages of known issues are the same for every report
    return command(words)


WRITING = frozenset({"--out", "--into", "--to", "--lock-out"})
"""Options whose path a user may put anywhere; here it is kept in the folder."""


def _words(chance: random.Random) -> list[str]:
    verb = chance.choice(sorted(VERBS))
    options = [word for action in _parser(verb)._actions for word in action.option_strings if "help" not in word]
    values = [*ATOMS, "quickstart", "m.toml", "report.json", ".", "gymnasium==1.2.3", "3.11", "CartPole-v1", "1/2", "*"]
    words = []
    for _ in range(chance.randrange(6)):
        words += [chance.choice(options)] if options and chance.random() < 0.4 else []
        words += [chance.choice(values).replace("\0", "0").replace("\ud800", "\udcff")] if chance.random() < 0.8 else []
    outside = {at + 1 for at, word in enumerate(words) if word in WRITING}
    words = [word.lstrip("/") or "x" if at in outside else word for at, word in enumerate(words)]
    offline = ["--offline"] if "--offline" in options else []
    return [verb, *offline, *(word for word in words if word != "--")]


def _parser(verb: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"simmatrix {verb}")
    importlib.import_module(VERBS[verb][0]).add_arguments(parser)
    return parser


def _run_words(words: list[str]) -> int:
    if words[0] in PLANNED:
        return command(words)
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        try:
            _parser(words[0]).parse_args(words[1:])
        except SystemExit as end:
            return int(end.code or 0)
        except HarnessError as error:
            return error.exit_code
    return 0


TARGETS = {
    target.name: target
    for target in (
        Target(name="matrix files", make=_matrix, run=command),
        Target(name="requirement files", make=_requirements, run=_read_requirements),
        Target(name="reports", make=_report, run=command),
        Target(name="merged reports", make=_merge, run=command),
        Target(name="sites", make=_site, run=_build_site),
        Target(name="command lines", make=_words, run=_run_words),
    )
}
