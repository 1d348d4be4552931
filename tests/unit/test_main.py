"""The door of the command line: the list of verbs, the version, verbs that do not exist."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import pytest

from harness.__main__ import GROUPS, VERBS, main

WIDTH = 80


def test_without_a_verb_all_are_listed_by_purpose(capsys: pytest.CaptureFixture[str]) -> None:
    """The list exits with 0, and fits a terminal."""
    with pytest.raises(SystemExit) as ended:
        main([])
    lines = capsys.readouterr().out.splitlines()
    assert ended.value.code == 0
    assert [line.rstrip(":") for line in lines if line.rstrip(":") in GROUPS] == list(GROUPS)
    assert {line.split()[0] for line in lines if line.startswith("  ") and line.split()[0] in VERBS} == set(VERBS)
    assert max(map(len, lines)) <= WIDTH


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    """`--version` prints the version of the distribution."""
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert (ended.value.code, capsys.readouterr().out) == (0, f"simmatrix {version('simmatrix')}\n")


def test_a_mistyped_verb(capsys: pytest.CaptureFixture[str]) -> None:
    """It is bad input, with the nearest name."""
    with pytest.raises(SystemExit) as ended:
        main(["tyr"])
    assert ended.value.code == 2
    assert 'there is no verb "tyr"; did you mean "try"?' in capsys.readouterr().err


@pytest.mark.parametrize("verb", VERBS)
def test_help_and_nonsense_of_every_verb(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    """`--help` is 0; an option that no verb has is 2, with one sentence after the usage."""
    with pytest.raises(SystemExit) as shown:
        main([verb, "--help"])
    assert shown.value.code == 0
    assert capsys.readouterr().out.startswith("usage: ")
    with pytest.raises(SystemExit) as refused:
        main([verb, "--no-such-option"])
    assert refused.value.code == 2
    assert f"simmatrix {verb}: error: " in capsys.readouterr().err


@pytest.mark.parametrize("verb", [["plan", "m.toml"], ["doctor"]], ids=["plan", "doctor"])
def test_a_working_folder_that_is_gone(
    verb: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is bad input, told in one sentence."""
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert main(verb) == 2
    assert capsys.readouterr().err == "simmatrix: the working folder does not exist any more; change to another one\n"
