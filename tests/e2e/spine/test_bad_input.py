"""Bad input, and readers that close the pipe early."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from commandline import SMALL, Desk


def test_a_reader_that_goes_away_changes_no_exit_code(desk_with_results: Desk) -> None:
    """`run | head -1` of a red matrix is 1, and its report is written; `report | head -1` of a green one is 0."""
    report = desk_with_results.state / "reports" / "small" / "report.json"
    report.unlink()
    for words, code in ((("run", "small.toml"), 1), (("report", "quickstart"), 0)):
        with desk_with_results.started(*words) as process:
            assert process.stdout
            process.stdout.close()
            ended = process.wait(timeout=120)
        assert (words, ended) == (words, code)
    assert report.is_file()


def test_a_product_that_nobody_could_measure_is_refused_at_once(desk: Desk) -> None:
    """A matrix of 2 to the 40th combinations is refused first, with their number, the key at fault and what to do."""
    text = SMALL.read_text().replace("[axes]\n", "[axes]\n" + "".join(f'a{n} = ["1.0", "2.0"]\n' for n in range(40)))
    ran = desk.run("plan", desk.matrix("small", text), "--offline")
    assert ran.code == 2
    assert "combinations (2 a0 x 2 a1" in ran.err
    assert "at most 20,000 can be planned" in ran.err


def test_a_state_whose_name_is_too_long_is_bad_input(desk: Desk) -> None:
    """A name that no file system can hold ends the command with one sentence."""
    ran = desk.run("run", desk.matrix("small", SMALL.read_text()), HARNESS_STATE="a" * 300)
    assert (ran.code, ran.err.count("\n")) == (2, 1)
    assert ran.err.endswith("...: File name too long; name another path\n")


def test_a_named_pipe_is_not_waited_for(desk: Desk) -> None:
    """A matrix, a requirement file, a report and a log that are pipes with a name are refused."""
    pipe = desk.folder / "pipe.toml"
    os.mkfifo(pipe)
    for words in (("plan", pipe), ("try", "-r", pipe), ("report", pipe), ("explain", pipe), ("run", pipe)):
        try:
            ran = desk.run(*words)
        except subprocess.TimeoutExpired:
            pytest.fail(f"{words[0]} waits for a pipe")
        assert (words[0], ran.code) == (words[0], 2)


@pytest.mark.parametrize(
    ("streams", "code"), [("> /dev/full", 3), ("2> /dev/full", 0), ("> /dev/full 2> /dev/full", 3)]
)
def test_output_that_cannot_be_written_is_the_machines_trouble(desk: Desk, streams: str, code: int) -> None:
    """A full disk under stdout ends with code 3, reported once; under stderr alone it cannot be reported."""
    ran = subprocess.run(
        ["sh", "-c", f'exec "$0" -m harness schema {streams}', sys.executable],
        cwd=desk.folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ran.returncode, ran.stderr.count("\n")) == (code, 1 if streams == "> /dev/full" else 0)
