"""Hold the exit codes and examples of every verb, which its `--help` shows below the options."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from harness.standalone import wrapping

BAD_INPUT = {2: "wrong arguments, or a file that cannot be used"}
NOT_DECIDED = {3: "not decided: this machine or the network is at fault"}
OF_REPORT = {
    0: "every result is as expected",
    1: "some result has a kind that --fail-on names",
    3: "some result is inconclusive: this machine or the network is at fault",
}


class Example(NamedTuple):
    """A command, its meaning, and what it needs that the shipped results do not have (`network`, a file, ...)."""

    meaning: str
    command: str
    needs: str = ""


class VerbHelp(NamedTuple):
    """The exit codes of a verb with their meanings, and its examples."""

    exit_codes: Mapping[int, str]
    examples: tuple[Example, ...]


CELL = "quickstart/py3.11_gymnasium-0.29.1_mujoco-3.3.7"
"""A measured combination that fails in one environment; a release of one package is enough to change that."""

HELP_OF_VERBS = {
    "explain": VerbHelp(
        {0: "the cause, or the most likely causes, are printed", 1: "no known cause, or no failure in the text"},
        (
            Example("Explain one line", "simmatrix explain \"ModuleNotFoundError: No module named 'mujoco_py'\""),
            Example("Run a script, and explain its failure", "simmatrix explain -- python train.py", "train.py"),
            Example("Explain a log for the environment that wrote it", "simmatrix explain train.log --python .venv",
                    "train.log, .venv"),
            Example("Show a known issue", "simmatrix explain --id gym021-extras-require-setuptools"),
        ),
    ),
    "known": VerbHelp(
        {0: "printed"},
        (
            Example("List the measured releases of MuJoCo, and its known issues", "simmatrix known mujoco"),
            Example("Show one known issue", "simmatrix known gym021-extras-require-setuptools"),
        ),
    ),
    "recommend": VerbHelp(
        {0: "a working combination is printed", 1: "no measured combination works"},
        (
            Example("Print a command that installs two packages that work together",
                    "simmatrix recommend gymnasium mujoco --python 3.11 --offline"),
            Example("Write a lock of a combination that renders Ant-v5",
                    "simmatrix recommend mujoco --env Ant-v5 --needs render --lock-out lock.txt"),
        ),
    ),
    "check": VerbHelp(
        {0: "no finding", 1: "something fails, conflicts or may change", 3: "something was never measured"},
        (
            Example("Check the active environment for one task", "simmatrix check --env Ant-v5", "an environment"),
            Example("Check a requirement file for Python 3.11", "simmatrix check -r requirements.txt --python 3.11",
                    "requirements.txt"),
        ),
    ),
    "upgrade": VerbHelp(
        {0: "nothing changes as far as it was measured", 1: "something fails or changes", 3: "not measured"},
        (
            Example("Find the newest MuJoCo that changes nothing here", "simmatrix upgrade mujoco", "an environment"),
            Example("Predict the effect of one release for a requirement file",
                    "simmatrix upgrade mujoco==3.9.0 -r requirements.txt --env Ant-v5 --offline", "requirements.txt"),
        ),
    ),
    "try": VerbHelp(
        {0: "it works", 1: "it fails", **NOT_DECIDED},
        (
            Example("Measure one environment of one release",
                    "simmatrix try 'gymnasium[mujoco]==1.2.3' --python 3.11 --env Ant-v5", "network"),
            Example("Measure a requirement file with an older NumPy, as of a day",
                    "simmatrix try -r requirements.txt 'numpy<2' --as-of 2025-06-01", "network"),
        ),
    ),
    "doctor": VerbHelp(
        {0: "no problem was found; notes do not count", 1: "problems were found", 3: "the environment does not run"},
        (
            Example("Inspect the active environment", "simmatrix doctor", "an environment"),
            Example("Inspect another one, run a task in it, and check rendering",
                    "simmatrix doctor --python .venv --env Ant-v5 --rendering", ".venv"),
            Example("Write a file that does this on machines without simmatrix",
                    "simmatrix doctor --standalone simmatrix-doctor.pyz"),
        ),
    ),
    "repair": VerbHelp(
        {0: "a fix was found and verified, or none is needed", 1: "no fix was found", **NOT_DECIDED},
        (
            Example("Repair a combination of a matrix", f"simmatrix repair {CELL}", "network"),
            Example("Repair your own requirements within five minutes",
                    "simmatrix repair -r requirements.txt --env Ant-v4 --minutes 5", "network"),
        ),
    ),
    "bisect": VerbHelp(
        {0: "the boundary was found", 1: "there is no boundary on this line", **NOT_DECIDED},
        (
            Example("Find the MuJoCo release that broke a combination", f"simmatrix bisect {CELL} --axis mujoco",
                    "network"),
            Example("Find the release that changed how Ant-v5 moves",
                    "simmatrix bisect 'drift-mujoco/*-3.3.0' --axis mujoco --behaves --good 3.2.7", "network"),
        ),
    ),
    "compare": VerbHelp(
        {0: "no difference was found", 1: "they behave differently", **NOT_DECIDED},
        (
            Example("Compare two MuJoCo releases in one environment",
                    "simmatrix compare 'drift-mujoco/*-3.2.7' 'drift-mujoco/*-3.3.0' --env Ant-v5", "network"),
            Example("Compare their pictures, too",
                    "simmatrix compare 'drift-mujoco/*-3.2.7' 'drift-mujoco/*-3.3.0' --pixels", "network"),
        ),
    ),
    "show": VerbHelp(
        {0: "printed"},
        (
            Example("Show a combination with its versions and results", f"simmatrix show {CELL}"),
            Example("Write the lock of the one combination that a glob matches",
                    "simmatrix show 'drift-mujoco/*-3.3.0' --lock-out lock.txt"),
        ),
    ),
    "init": VerbHelp(
        {0: "the files are written", 3: "some questions are open, such as ranges that the index was not asked about"},
        (
            Example("Start in the working folder", "simmatrix init", "network"),
            Example("Start with the combinations of an existing workflow",
                    "simmatrix init --from .github/workflows/ci.yml", "network"),
        ),
    ),
    "plan": VerbHelp(
        {0: "printed", **NOT_DECIDED},
        (
            Example("List the combinations of a built-in matrix", "simmatrix plan quickstart --offline"),
            Example("List those of one MuJoCo release as JSON",
                    "simmatrix plan gymnasium-mujoco -k '*_mujoco-3.3.7*' --offline --json"),
        ),
    ),
    "lock": VerbHelp(
        {0: "every combination has a lock, or is expected to have none", 1: "some combination has none", **NOT_DECIDED},
        (
            Example("Resolve a whole matrix", "simmatrix lock quickstart", "network"),
            Example("Write the lock of one combination",
                    "simmatrix lock quickstart -k '*1.4.0_mujoco-4.0.0' --out lock.txt", "network"),
        ),
    ),
    "run": VerbHelp(
        OF_REPORT,
        (
            Example("Measure a built-in matrix, as much at a time as fits", "simmatrix run quickstart -j auto",
                    "network"),
            Example("Measure only what failed the last time", "simmatrix run quickstart --only-failed", "network"),
            Example("Measure the first of four parts on this machine",
                    "simmatrix run gymnasium-mujoco --shard 1/4 --out shard-1", "network"),
        ),
    ),
    "freeze": VerbHelp(
        {0: "the file is written; with --check: the same behaviour", 1: "another behaviour", **NOT_DECIDED},
        (
            Example("Write how Ant-v5 behaves now",
                    "simmatrix freeze 'drift-mujoco/*-3.3.0' --env Ant-v5 --out ant.npz", "network"),
            Example("Check another release against that file",
                    "simmatrix freeze 'drift-mujoco/*-3.9.0' --check ant.npz", "network"),
        ),
    ),
    "fetch": VerbHelp(
        {0: "the folder is complete", 3: "something could not be downloaded"},
        (
            Example("Download what a matrix needs", "simmatrix fetch quickstart --to bundle", "network"),
            Example("Download what one MuJoCo release needs",
                    "simmatrix fetch quickstart -k '*mujoco-4.0.0' --to bundle", "network"),
        ),
    ),
    "report": VerbHelp(
        OF_REPORT,
        (
            Example("Print the tables of a built-in matrix", "simmatrix report quickstart"),
            Example("Write its report with other axes",
                    "simmatrix report quickstart --pivot mujoco gymnasium --out report"),
        ),
    ),
    "merge": VerbHelp(
        OF_REPORT,
        (
            Example("Merge the reports of two shards", "simmatrix merge shard-1 shard-2 --out merged",
                    "shard-1, shard-2"),
            Example("Merge all reports below a folder; gaps are failures",
                    "simmatrix merge downloads --fail-on unexpected,stale,not_run", "downloads"),
        ),
    ),
    "site": VerbHelp(
        {0: "the site is built"},
        (
            Example("Build the site of all reports that come with simmatrix", "simmatrix site --out site"),
            Example("Build the site of your own report", "simmatrix site .harness/reports/mine --out site", "a report"),
        ),
    ),
    "accept": VerbHelp(
        {0: "the expectations are written", 1: "one of them cannot fit all results, as these differ"},
        (
            Example("Print the expectations that would be written",
                    "simmatrix accept mine.toml -k '*' --reason 'not supported' --dry-run", "mine.toml"),
            Example("Accept the failures with MuJoCo 4 until a day",
                    "simmatrix accept mine.toml -k '*mujoco-4*' --reason '#12' --until 2027-01-31", "mine.toml"),
        ),
    ),
    "ci": VerbHelp(
        {0: "written; with --check: up to date", 1: "with --check: out of date", **NOT_DECIDED},
        (
            Example("Write a GitHub workflow", "simmatrix ci quickstart --out .github/workflows/quickstart.yml"),
            Example("Write a Slurm script with shards of 30 minutes",
                    "simmatrix ci quickstart --provider slurm --minutes 30 --out quickstart.slurm"),
        ),
    ),
    "gc": VerbHelp(
        {0: "done"},
        (
            Example("List what a month without use would delete", "simmatrix gc --older-than 30 --dry-run"),
            Example("Keep the cache below 20 GB", "simmatrix gc --max-size 20GB"),
        ),
    ),
    "schema": VerbHelp(
        {0: "printed"},
        (
            Example("List all documents", "simmatrix schema"),
            Example("Write the schema of report.json", "simmatrix schema report --out report.schema.json"),
        ),
    ),
}  # fmt: skip


def wrap(text: str, width: int, below: str = "") -> str:
    """Return a paragraph, broken between words at a width; `below` indents all lines but the first."""
    return textwrap.fill(text, width, subsequent_indent=below, break_long_words=False, break_on_hyphens=False)


def epilog(verb: str, width: int) -> str:
    """Return the exit codes and examples of a verb; no command is broken over lines."""
    return "\n".join(_lines(HELP_OF_VERBS[verb], width))


def print_error(text: str) -> None:
    """Print an error: as it is in a log, broken between words on a terminal."""
    columns = wrapping.width(sys.stderr) if sys.stderr.isatty() else None
    for line in text.splitlines():
        print("\n".join(wrapping.wrap(line, columns)), file=sys.stderr)


def _lines(entry: VerbHelp, width: int) -> Iterator[str]:
    yield "exit status:"
    for code, meaning in sorted({**BAD_INPUT, **entry.exit_codes}.items()):
        yield wrap(f"  {code}  {meaning}", width, below="     ")
    yield ""
    yield "examples:"
    for example in entry.examples:
        yield f"  # {example.meaning}"
        yield f"  {example.command}"
