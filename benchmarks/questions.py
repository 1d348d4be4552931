"""Ask forty questions of threads, "does A work with B on Python X": `python -m benchmarks.questions`.

The list, `questions.toml`, was collected before anything was measured for it. Each question is typed into
`simmatrix recommend --offline`, whose answers come from the committed reports, and `questions.md` shows the answers.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import shlex
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.__main__ import main as simmatrix

HERE = Path(__file__).parent
LIST = HERE / "questions.toml"
PAGE = HERE / "questions.md"
LINES = 16
"""How many lines of an answer the page shows."""

VERDICTS = ("works", "partly", "fails", "missing")
HEAD = """# Forty questions of threads

Made by `python -m benchmarks.questions`. People asked "does A work with B on Python X" in threads of 2025 and 2026.
The list, [questions.toml](questions.toml), was collected before anything was measured for it. Each question is typed
into `simmatrix recommend`, which answers from the committed reports without a network.

- **works**, **partly** and **fails** come from measured combinations of what was asked: of all tasks that were tried,
  all pass, some pass, or none does.
- **missing**: no such combination was measured. The answer says so, and what to type to measure it.
"""


@dataclass(frozen=True)
class Answer:
    """One question and what the terminal says to it."""

    question: Mapping[str, Any]
    verdict: str
    text: str

    @property
    def command(self) -> str:
        """Return the command line to type."""
        return shlex.join(["simmatrix", "recommend", *typed(self.question)])


def main(arguments: Sequence[str] | None = None) -> None:
    """Ask all questions and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args(arguments)
    questions = tomllib.loads(LIST.read_text(encoding="utf-8"))["question"]
    answers = [ask(question) for question in questions]
    PAGE.write_text(page(answers), encoding="utf-8")
    print(totals(answers))


def typed(question: Mapping[str, Any]) -> list[str]:
    """Return the arguments of `recommend` for a question."""
    options = {"--python": question.get("python"), "--env": question.get("env")}
    return [*question["asked"], *(part for name, value in options.items() if value for part in (name, value))]


def ask(question: Mapping[str, Any]) -> Answer:
    """Type a question, once for a reader and once for a program."""
    text, document = (_run([*typed(question), "--offline", *more]) for more in ((), ("--json",)))
    return Answer(question, judge(json.loads(document)), text)


def judge(document: Mapping[str, Any]) -> str:
    """Return whether what was asked was measured, and works."""
    if document["measured"]:
        return "works"
    if document["partly"] or document["doubtful"]:
        return "partly"
    return "fails" if document["red"] else "missing"


def _run(arguments: Sequence[str]) -> str:
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(io.StringIO()):
        simmatrix(["recommend", *arguments])
    return output.getvalue()


def totals(answers: Sequence[Answer]) -> str:
    """Return how many answers there are of each verdict."""
    counts = Counter(answer.verdict for answer in answers)
    measured = len(answers) - counts["missing"]
    figures = ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS)
    return f"Of {len(answers)} questions {measured} are answered from measured combinations: {figures}."


def page(answers: Sequence[Answer]) -> str:
    """Return the page: the totals, a table, and each answer."""
    rows = [
        f"| [{answer.question['id']}](#{answer.question['id'].replace('.', '').replace('/', '')}) "
        f"| {answer.question['text']} | {answer.verdict} |"
        for answer in answers
    ]
    table = ["| thread | question | answer |", "| --- | --- | --- |", *rows]
    return "\n".join([HEAD, f"**{totals(answers)}**\n", *table, "", *map(section, answers)])


def section(answer: Answer) -> str:
    """Return the part of the page about one question."""
    question, lines = answer.question, answer.text.rstrip().replace("```", "'''").splitlines()
    shown = [f"$ {answer.command}", *lines[:LINES], *(["..."] if len(lines) > LINES else [])]
    sentence = f"[{question['text']}]({question['link']}) ({question['date']}): **{answer.verdict}**."
    return "\n".join([f"## {question['id']}\n", f"{sentence}\n", "```", *shown, "```\n"])


if __name__ == "__main__":
    main()
