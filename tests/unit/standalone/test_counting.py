"""Count the known failures that fit a failure, and those that an expectation may name."""

from __future__ import annotations

import pytest
from builders import case, cell, entry, make_knowledge, phase, record, signature

from harness.judging.assess import assess
from harness.model import Expectation, Outcome, Phase, Verdict
from harness.reports.tables import counted_failures
from harness.standalone.failures.counting import Fit, is_stated, nameable, select_counting

DEEP = Fit("deep", masks=False, generic=False, seen="no such field", says=True)
BROAD = Fit("broad", masks=False, generic=True, seen="no such field", says=True)
ELSEWHERE = Fit("elsewhere", masks=False, generic=True, seen="another line", says=False)
MASK = Fit("mask", masks=True, generic=True, seen="a worker is gone", says=True)
LOGGED = MASK._replace(diagnosis="logged", says=False)


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
def test_what_counts(fits: list[Fit], counted: tuple[str, ...], named: tuple[str, ...]) -> None:
    """Causes before masks, of a line the specific one; an expectation may name the general one of that line, too."""
    assert (select_counting(fits), nameable(fits)) == (counted, named)


def test_a_line_says_why_where_it_has_what_was_seen() -> None:
    """A known failure is seen by a part of a line."""
    assert is_stated("is gone", ["x", "a worker is gone"])
    assert not is_stated("is gone", ["x"])


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

    assert found.failure == counted_failures.failure(stored)
    assert found.failure
    assert found.failure.causes == ("deep",)
    assert found.as_expected is stored.as_expected is (named in counted_failures.nameable(stored)) is (named != "mask")
