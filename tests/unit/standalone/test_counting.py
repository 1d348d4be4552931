"""Count the known failures that fit a failure, and those that an expectation may name."""

from __future__ import annotations

from typing import NamedTuple

import pytest
from builders import case, cell, entry, make_knowledge, phase, record, signature

from harness.judging import known_failures
from harness.judging.assess import assess
from harness.judging.identity import failure
from harness.model import Expectation, Outcome, Phase, Verdict
from harness.standalone.failures.counting import select_counting, select_nameable, stated_in


class Fit(NamedTuple):
    """A known failure that fits; `says` is whether its line says why."""

    name: str
    masks: bool
    generic: bool
    seen: str
    says: bool


DEEP = Fit("deep", masks=False, generic=False, seen="no such field", says=True)
BROAD = Fit("broad", masks=False, generic=True, seen="no such field", says=True)
ELSEWHERE = Fit("elsewhere", masks=False, generic=True, seen="another line", says=False)
MASK = Fit("mask", masks=True, generic=True, seen="a worker is gone", says=True)
LOGGED = MASK._replace(name="logged", says=False)


@pytest.mark.parametrize(
    ("fits", "counted", "named"),
    [
        pytest.param([], (), (), id="nothing is known"),
        pytest.param([DEEP, ELSEWHERE], ("deep", "elsewhere"), ("deep", "elsewhere"), id="of two lines"),
        pytest.param([DEEP, BROAD], ("deep",), ("deep", "broad"), id="a general one of the same line"),
        pytest.param([BROAD, DEEP], ("deep",), ("broad", "deep"), id="a general one that comes first"),
        pytest.param([BROAD], ("broad",), ("broad",), id="a general one alone"),
        pytest.param([DEEP, MASK], ("deep",), ("deep",), id="a mask behind which the cause is known"),
        pytest.param([MASK], ("mask",), ("mask",), id="a mask that is what it says"),
        pytest.param([LOGGED], (), (), id="a mask that stands in a log alone"),
        pytest.param([LOGGED, MASK], ("mask",), ("mask",), id="one of two masks is what it says"),
    ],
)
def test_failures_that_count(fits: list[Fit], counted: tuple[str, ...], named: tuple[str, ...]) -> None:
    """Causes before masks, of a line the specific one; an expectation may name the general one of that line, too."""
    results = (select(fits, lambda fit: fit.says) for select in (select_counting, select_nameable))
    assert [tuple(one.name for one in found) for found in results] == [counted, named]


def test_a_line_says_why_where_it_has_what_was_seen() -> None:
    """A known failure is seen by a part of a line."""
    gone = MASK._replace(seen="is gone")
    assert stated_in(["x", "a worker is gone"])(gone)
    assert not stated_in(["x"])(gone)


@pytest.mark.parametrize("named", ["deep", "broad", "mask"])
def test_a_cell_and_its_entry_count_alike(named: str) -> None:
    """A record and its document have the same causes and meet the same expectations."""
    expect = Expectation(verdict=Verdict.PARTIAL, reason="known", signature=named)
    vector = phase(Phase.VECTOR, Outcome.FAILED, "no such field", masked_by="a worker is gone")
    known = make_knowledge(
        signature("deep", "such field"),
        signature("broad", "no such field", generic=True, packages=["numpy"]),
        signature("mask", "a worker is gone", masks=True),
    )

    found = assess(record(case("ppfp", vector=vector), of=cell(expect=expect)), known)
    stored = entry(found.record, known)

    assert found.failure == failure(stored)
    assert found.failure
    assert found.failure.causes == ("deep",)
    assert (
        found.as_expected
        is stored.as_expected
        is (named in [one.name for one in known_failures.select_nameable(stored)])
        is (named != "mask")
    )
