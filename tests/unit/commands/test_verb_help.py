"""Test the help of every verb: its width, its exit codes, and examples that its own parser accepts."""

from __future__ import annotations

import argparse
import importlib
import re
import shlex
from typing import Any

import pytest

from harness import __main__ as command_line
from harness.commands.verb_help import HELP_OF_VERBS, Example

WIDTH = 80
EXAMPLES = [(verb, example) for verb, entry in HELP_OF_VERBS.items() for example in entry.examples]


def parser_of(verb: str) -> tuple[argparse.ArgumentParser, Any]:
    """Return the parser of a verb, and its module."""
    module = importlib.import_module(command_line.VERBS[verb][0])
    return command_line.verb_parser(verb, module), module


@pytest.fixture(autouse=True)
def _narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(WIDTH))


def test_every_verb_has_an_entry() -> None:
    """No verb lacks exit codes and examples, and none is left over."""
    assert set(HELP_OF_VERBS) == set(command_line.VERBS)


@pytest.mark.parametrize("verb", command_line.VERBS)
def test_help_fits_a_terminal(verb: str) -> None:
    """No line is longer than a terminal of 80 columns; the text is a sentence, and every option has one."""
    parser, module = parser_of(verb)
    text = parser.format_help()

    assert [line for line in text.splitlines() if len(line) > WIDTH] == []
    assert module.HELP[0].isupper()
    assert module.HELP.endswith(".")
    assert [action.dest for action in parser._actions if not action.help] == []


@pytest.mark.parametrize("verb", command_line.VERBS)
def test_help_ends_with_exit_codes_and_two_examples(verb: str) -> None:
    """Examples are whole commands of the verb, each with its meaning, and do different things."""
    options, exits, examples = re.split(r"^(?:exit status|examples):\n", parser_of(verb)[0].format_help(), flags=re.M)
    meanings, commands = examples.splitlines()[::2], examples.splitlines()[1::2]

    assert options.startswith("usage: ")
    assert {"0", "2"} <= set(re.findall(r"^  (\d)  ", exits, re.M))
    assert len(commands) >= 2
    assert all(command.startswith(f"  simmatrix {verb}") for command in commands)
    assert all(meaning.startswith("  # ") for meaning in meanings)
    assert len(set(commands)) == len(set(meanings)) == len(commands) == len(meanings)


@pytest.mark.parametrize(("verb", "example"), EXAMPLES, ids=[example.command for _, example in EXAMPLES])
def test_examples_are_parsed(verb: str, example: Example) -> None:
    """The verb's own parser accepts the command; quotes are closed."""
    program, name, *words = shlex.split(example.command)
    parser, module = parser_of(verb)
    ours = module.split(words)[0] if hasattr(module, "split") else words

    assert (program, name) == ("simmatrix", verb)
    assert parser.parse_args(ours)


def test_a_long_command_stays_on_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal narrower than a command breaks sentences, not the command."""
    monkeypatch.setenv("COLUMNS", "50")
    text = parser_of("compare")[0].format_help()

    assert max(map(len, text.partition("options:")[0].splitlines())) <= 50
    assert all(f"\n  {example.command}\n" in f"{text}\n" for example in HELP_OF_VERBS["compare"].examples)


def test_an_error_names_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    """A wrong argument says what is wrong and where all options are explained."""
    with pytest.raises(SystemExit) as ended:
        command_line.main(["run", "quickstart", "--until", "rendr"])
    *usage, hint, error = capsys.readouterr().err.splitlines()

    assert ended.value.code == 2
    assert usage[0].startswith("usage: simmatrix run ")
    assert hint == "`simmatrix run --help` explains every option, with examples."
    assert error.startswith("simmatrix run: error: argument --until: invalid choice: 'rendr' (choose from ")
