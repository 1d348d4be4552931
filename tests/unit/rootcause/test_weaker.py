"""A change is never a weaker test: what a repaired cell has to show, and how far a failing one came."""

from __future__ import annotations

import pytest
from builders import case, make_knowledge, record, render_phase, signature, step

from harness.judging.assess import assess
from harness.model import CaseRecord, CellRecord, Outcome, Phase, Verdict, replace
from harness.rootcause.bench import Trial
from harness.rootcause.bisection.predicate import Predicate, has_package_failure
from harness.rootcause.repair.lab import describe_result, fails_further, find_lost_check, passes
from harness.rootcause.search import Answer


def trial(*cases: CaseRecord, **more: object) -> Trial:
    """Return the assessed trial of a cell with these cases."""
    made: CellRecord = record(*cases, **more)
    found = assess(made)
    return Trial(assessed=found, failure=found.failure, seconds=1.0, at_hand=False)


@pytest.mark.parametrize(
    ("before", "after", "why"),
    [
        pytest.param("pfnn", "pppp", None, id="all that was requested"),
        pytest.param(
            "ppfp", "ppsp", "vector.sync of ant was failed before and is skipped now", id="what failed is left out"
        ),
        pytest.param(
            "pppf", "pppu", "render.rgb_array of ant was failed before and is unavailable now", id="cannot be shown"
        ),
        pytest.param("ppfp", "pppu", "render.rgb_array of ant was passed before and is unavailable now", id="is lost"),
        pytest.param("pfnn", "pppu", None, id="what nobody had come to before"),
    ],
)
def test_weaker(before: str, after: str, why: str | None) -> None:
    """Checks that failed or passed before must pass; those never reached before may be unavailable."""
    one, other = trial(case(before)), trial(case(after))
    assert other.works
    assert find_lost_check(one, other) == why


def test_a_case_that_is_gone_is_a_weaker_test() -> None:
    """A missing case makes the test weaker, however well the others do."""
    before, after = trial(case("pfnn"), case("pppp", "hopper")), trial(case("pppp"))
    assert find_lost_check(before, after) == "import.modules of hopper was passed before and is not_reached now"


def test_further() -> None:
    """Another failure counts as one behind the first only where it is not met earlier."""
    single, vector, render = trial(case("pfnn")), trial(case("ppfp")), trial(case("pppf"))
    assert fails_further(single, vector)
    assert fails_further(vector, render)
    assert not fails_further(vector, single)
    assert not fails_further(single, trial(case("pfnn")))
    assert not fails_further(single, trial(case("pppp")))
    assert not fails_further(single, trial(case("pinn")))


def test_passing_up_to_a_phase() -> None:
    """A run that stopped early says how far it came, and no more."""
    unasked = replace(step(Phase.INSTALL), outcome=Outcome.FAILED, decisive="no wheel")
    assert passes(trial(case("ppnn")), Phase.SINGLE)
    assert passes(trial(case("pnnn")), Phase.IMPORT)
    assert not passes(trial(case("pfnn")), Phase.SINGLE)
    assert not passes(trial(install=unasked), Phase.INSTALL)
    assert (describe_result(trial(case("pnnn")), Phase.IMPORT), describe_result(trial(case("pfnn")), Phase.SINGLE)) == (
        "passes import",
        "broken in single",
    )


# --- what misleads ----------------------------------------------------------------------------------------------


def camera_cell(camera: Outcome) -> Trial:
    """Return a cell that drew a picture, with this outcome of its camera check."""
    return trial(case("pppp", render=render_phase(camera)))


def doubtful() -> Trial:
    """Return a cell that works but for a silent issue that no check has refuted."""
    lurks = signature("camera-elsewhere", None, silent=True, packages=["gymnasium"], check="render.camera")
    return Trial(assessed=assess(record(case("pppp")), make_knowledge(lurks)), failure=None, seconds=1.0, at_hand=False)


def test_a_misleading_cell_is_no_cure() -> None:
    """A search takes it for red; what cures it passes the same check, in which a skip is no answer."""
    before = camera_cell(Outcome.FAILED)

    assert before.assessed.verdict is Verdict.MISLEADS
    assert not before.works
    assert has_package_failure(before)
    assert find_lost_check(before, camera_cell(Outcome.PASSED)) is None
    assert (
        find_lost_check(before, camera_cell(Outcome.SKIPPED))
        == "render.camera of ant was failed before and is skipped now"
    )
    assert find_lost_check(camera_cell(Outcome.PASSED), camera_cell(Outcome.SKIPPED)) is None


def test_an_unrefuted_change_is_no_cure() -> None:
    """It works, and is never handed out; nor is it a bad end."""
    assert doubtful().assessed.verdict is Verdict.WORKS
    assert not doubtful().works
    assert doubtful().doubtful
    assert not has_package_failure(doubtful())


def test_a_bisection_asks_for_the_same_misleading() -> None:
    """A candidate that misleads alike is bad, one that passes the check is good, and one not refuted is unknown."""
    asked = Predicate(failure=camera_cell(Outcome.FAILED).failure)

    assert asked.classify(camera_cell(Outcome.FAILED)).answer is Answer.BAD
    assert asked.classify(camera_cell(Outcome.PASSED)).answer is Answer.GOOD
    assert asked.classify(doubtful()).answer is Answer.UNTESTABLE
    assert (
        Predicate(failure=trial(case("pppf")).failure).classify(camera_cell(Outcome.FAILED)).answer is Answer.UNTESTABLE
    )
