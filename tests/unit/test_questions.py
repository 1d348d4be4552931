"""Questions of threads: the list keeps its rules, and an answer is judged by what was measured."""

from __future__ import annotations

import tomllib
from collections import Counter
from datetime import date
from typing import Any

import pytest
from packaging.requirements import Requirement

from benchmarks import questions

LISTED = tomllib.loads(questions.LIST.read_text(encoding="utf-8"))["question"]
NOTHING: dict[str, Any] = {"measured": [], "partly": [], "doubtful": [], "red": []}


def test_forty_questions_of_threads_of_two_years() -> None:
    """Each has an id, a thread and a day of its own, and asks for requirements."""
    assert len({question["id"] for question in LISTED}) == len({question["link"] for question in LISTED}) == 40
    for question in LISTED:
        assert date(2025, 1, 1) <= question["date"] < date(2026, 11, 26)
        assert all(Requirement(text).name for text in question["asked"])


def test_no_more_than_two_for_one_pair_of_packages() -> None:
    """The first two packages of a question are its pair."""
    pairs = Counter(tuple(Requirement(text).name for text in question["asked"][:2]) for question in LISTED)

    assert max(pairs.values()) <= 2


@pytest.mark.parametrize(
    ("found", "verdict"),
    [
        ({"measured": [{}], "red": [{}]}, "works"),
        ({"partly": [{}], "red": [{}]}, "partly"),
        ({"red": [{}]}, "fails"),
        ({}, "missing"),
    ],
)
def test_answers_are_judged_by_what_was_measured(found: dict[str, Any], verdict: str) -> None:
    """A combination that works counts more than failures of others."""
    assert questions.judge({**NOTHING, **found}) == verdict


def test_a_page_shows_the_command_and_the_answer() -> None:
    """With the options that the question names, cut where it is long."""
    question = {**LISTED[0], "python": "3.12", "env": "Ant-v5", "asked": ["gymnasium>=1"]}
    answer = questions.Answer(question, "works", "line\n" * 99)
    text = questions.page([answer])

    assert "$ simmatrix recommend 'gymnasium>=1' --python 3.12 --env Ant-v5\nline" in text
    assert text.count("\nline") == questions.LINES
    assert "Of 1 questions 1 are answered from measured combinations: 1 works" in text
