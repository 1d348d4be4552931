"""Stored probe runs of a case become its phases; a run is asked for again where judging needs one, and only there."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
import readings
from readings import CASE, DIED, FAILED, GOOD, HERE, PASSED, PYTHON, Check, passed, plan_case, reading

from harness.judging.runs import check as judging_check
from harness.judging.runs.case import phases
from harness.judging.runs.check import TAKEN_AWAY
from harness.judging.runs.fold import CasePlan, Folded, add_run, fold
from harness.judging.runs.todo import todo
from harness.model import Outcome, Phase, PhaseRecord, replace
from harness.model.machine_trouble import SHOT
from harness.probes import wire
from harness.probes.evidence import Host, Reading, Request, RunEnd

ALL = ("import.modules", "single.loop", "vector.sync", "vector.async.fork", "render.rgb_array")
KILLED = RunEnd(signal=9, seconds=2.0)
CRASH = RunEnd(signal=11, seconds=2.0)
OVERRAN = RunEnd(signal=9, killed="limit of 120 s", overran=120.0, seconds=121.0)
WHOLE = Request(case=CASE, limits=dict.fromkeys(ALL, 120.0), followers=wire.followers_of(ALL))
AGAIN = Request(case=CASE, limits={"single.repeat": 240.0})
COMPARED = reading(AGAIN, passed("single.repeat"))


def first(wanted: CasePlan) -> Request:
    """Return the first request for a case without stored runs."""
    request = todo(wanted, Folded())
    assert request
    return request


def next_checks(wanted: CasePlan, *runs: Reading) -> list[str]:
    """Return the checks of the request that comes after these runs; none if nothing is left to ask."""
    request = todo(wanted, fold(wanted, runs))
    return list(request.limits) if request else []


def phases_after(wanted: CasePlan, *runs: Reading) -> dict[Phase, PhaseRecord]:
    """Return the phases of a case after these runs."""
    return phases(wanted, fold(wanted, runs))


def outcomes(found: Mapping[Phase, PhaseRecord]) -> dict[str, str]:
    """Return the outcome of each phase."""
    return {str(phase): str(record.outcome) for phase, record in found.items()}


# --- one run after the other ----------------------------------------------------------------------------------------


def test_all_checks_are_asked_of_one_process() -> None:
    """Imports are the cost."""
    assert list(first(plan_case()).limits) == list(ALL)


def test_a_case_that_passes_is_compared_with_a_second_process_and_done() -> None:
    """The same seed, another process, twice the time."""
    whole = reading(WHOLE, passed(*ALL))

    assert todo(plan_case(), fold(plan_case(), [whole])) == AGAIN
    assert next_checks(plan_case(), whole, COMPARED) == []
    assert set(outcomes(phases_after(plan_case(), whole, COMPARED)).values()) == {"passed"}


@pytest.mark.parametrize(
    ("second", "text"),
    [
        (["a", "b"], None),
        (["a", "c"], "the same seed gives another trajectory in another process, from step 1 on"),
        ([], "the same seed gives another trajectory in another process"),
    ],
)
def test_another_trajectory_is_a_finding(second: list[str], text: str | None) -> None:
    """A trajectory that differs is a finding, with the first step that differs."""
    loop = [Check(name="single.loop", facts={"trajectory": ["a", "b"]})]
    whole = reading(WHOLE, [*passed("import.modules"), *loop, *passed(*ALL[2:])])
    other = reading(AGAIN, [Check(name="single.repeat", facts={"trajectory": second})])

    found = phases_after(plan_case(), whole, other)[Phase.SINGLE].findings
    assert [one.text for one in found] == ([text] if text else [])


def test_after_a_death_the_rest_goes_on_in_a_fresh_process() -> None:
    """A crash ends the check that was running; those that need it are not asked for."""
    died = reading(WHOLE, [*passed(*ALL[:2]), Check(name="vector.sync", outcome=DIED)], end=CRASH)

    assert next_checks(plan_case(), died) == ["vector.async.fork", "render.rgb_array"]
    dead = reading(WHOLE, [*passed(*ALL[:1]), Check(name="single.loop", outcome=DIED)], end=CRASH)
    assert next_checks(plan_case(), dead) == []
    assert outcomes(phases_after(plan_case(), dead)) == {"import": "passed", "single": "crashed"}
    assert phases_after(plan_case(), dead)[Phase.SINGLE].decisive == "killed by SIGSEGV"


def test_a_limit_that_ran_out_is_doubled_once() -> None:
    """The second time it is the outcome."""
    slow = reading(WHOLE, [*passed(*ALL[:1]), Check(name="single.loop", outcome=DIED)], end=OVERRAN)
    again = todo(plan_case(), fold(plan_case(), [slow]))

    assert again
    assert again.limits["single.loop"] == 240.0
    second = reading(again, [Check(name="single.loop", outcome=DIED)], end=replace(OVERRAN, overran=240.0))
    found = phases_after(plan_case(), slow, second)[Phase.SINGLE]
    assert (found.outcome, found.decisive, found.attempts) == (Outcome.TIMED_OUT, "no end within 240 s", 2)


@pytest.mark.parametrize("checks", [(), (*passed(*ALL[:1]), Check(name="single.loop", outcome=DIED))])
def test_a_process_that_somebody_killed_is_tried_once_more(checks: tuple[Check, ...]) -> None:
    """The second time it is a trouble of this machine, and no package is blamed."""
    killed = reading(WHOLE, checks, end=KILLED)
    again = todo(plan_case(), fold(plan_case(), [killed]))

    assert again
    second = reading(again, [Check(name=next(iter(again.limits)), outcome=DIED)], end=KILLED)
    found = list(phases_after(plan_case(), killed, second).values())[-1]
    assert (found.outcome, found.decisive, found.attempts) == (Outcome.INFRA, SHOT, 2)


def test_an_environment_in_pieces_is_met_twice_before_it_is_reported() -> None:
    """The first time the same is asked once more."""
    failed = [*passed(*ALL[:1]), Check(name="single.loop", outcome=FAILED, message="no file")]
    broken = reading(WHOLE, failed, host=replace(HERE, stood=False))

    assert todo(plan_case(), fold(plan_case(), [broken])) == WHOLE
    found = phases_after(plan_case(), broken, broken)[Phase.IMPORT]
    assert (found.outcome, found.decisive) == (Outcome.INFRA, TAKEN_AWAY)


def test_broken_byte_code_is_compiled_again() -> None:
    """Python keeps what it could write of it where a disk was full."""
    check = Check(name="import.modules", outcome=FAILED, message="EOFError: marshal data too short")
    cut = reading(WHOLE, [check])

    assert todo(plan_case(), fold(plan_case(), [cut])) == replace(WHOLE, recompiled=True)
    whole = reading(replace(WHOLE, recompiled=True), passed(*ALL))
    assert set(outcomes(phases_after(plan_case(), cut, whole)).values()) == {"passed"}


def test_a_probe_that_did_not_start() -> None:
    """No package was tried; where Python alone does not start with what is installed, one is at fault."""
    printed = {"log.txt": b"Fatal Python error: no module named encodings\n"}
    silent = reading(WHOLE, texts=printed, end=RunEnd(exit_code=1))
    found = phases_after(plan_case(), silent)[Phase.IMPORT]
    assert found.outcome is Outcome.INFRA
    assert found.decisive == "the probe did not start: Fatal Python error: no module named encodings"

    why = "Python does not start with what is installed: ValueError: bad .pth"
    blamed = reading(WHOLE, end=RunEnd(exit_code=1), host=replace(HERE, bare_start=why))
    found = phases_after(plan_case(), blamed)[Phase.IMPORT]
    assert (found.outcome, found.decisive) == (Outcome.FAILED, why)


def test_another_python_tries_nothing() -> None:
    """An environment whose interpreter was replaced says nothing of the packages."""
    other = reading(WHOLE, passed(*ALL), host=replace(HERE, python="3.12.1"))

    found = phases_after(plan_case(), other)[Phase.IMPORT]
    assert (found.outcome, found.decisive) == (
        Outcome.INFRA,
        f"the environment's Python is {PYTHON}, not 3.12.1",
    )


# --- confirmation ---------------------------------------------------------------------------------------------------


def verified(*ended: str) -> tuple[list[Reading], CasePlan]:
    """Return runs of `--verify` in which the loop ended with these outcomes in turn, and the question of the runs."""
    wanted, made = plan_case(replace(CASE, checks=ALL[:2]), verify=True), []
    folded = Folded()
    outcomes = iter((PASSED, *ended))
    while request := todo(wanted, folded):
        (name,) = request.limits
        made.append(reading(request, [Check(name=name, outcome=next(outcomes, PASSED), message="boom")]))
        folded = add_run(wanted, folded, made[-1])
    return made, wanted


def test_each_check_has_a_process_of_its_own() -> None:
    """With `--verify` each check runs in its own process, and the loop in a second one for comparison."""
    made, _ = verified()

    assert [list(one.run.request.limits) for one in made] == [["import.modules"], ["single.loop"], ["single.repeat"]]


@pytest.mark.parametrize(
    ("ended", "outcome", "decisive"),
    [
        ((FAILED, FAILED, FAILED), Outcome.FAILED, "RuntimeError: boom"),
        ((FAILED, PASSED, FAILED), Outcome.FLAKY, "passed 1 of 3 runs; else: RuntimeError: boom"),
    ],
)
def test_a_failure_is_confirmed(ended: tuple[str, ...], outcome: Outcome, decisive: str) -> None:
    """A failure is run again; a check that also passes is flaky."""
    made, wanted = verified(*ended)

    found = phases_after(wanted, *made)[Phase.SINGLE]
    assert (found.outcome, found.decisive) == (outcome, decisive)
    assert [one.run.request.confirms for one in made] == [False, False, True, True]


def test_runs_that_confirmed_are_no_less_without_that() -> None:
    """Runs of `--verify` are not made again without it; the other way round they are."""
    made, _ = verified(FAILED, FAILED, FAILED)
    plain = plan_case(replace(CASE, checks=ALL[:2]))

    assert next_checks(plain, *made) == []
    whole = reading(first(plain), [*passed(*ALL[:1]), Check(name="single.loop", outcome=FAILED)])
    assert next_checks(plan_case(replace(CASE, checks=ALL[:2]), verify=True), whole) == ["import.modules"]


# --- what is taken over ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("check", [one for one in ALL if one != "single.loop"])
def test_a_changed_check_measures_that_check_alone(check: str) -> None:
    """All others are known from the run that showed them."""
    whole = reading(WHOLE, passed(*ALL))

    assert next_checks(plan_case(program={check: "changed"}), whole, COMPARED) == [check]


def test_a_changed_check_that_follows_another_is_looked_at_alone() -> None:
    """The one that it follows is run to lead to it, and counts for nothing."""
    loop = Check(name="single.loop", findings=("odd loop",))
    whole = reading(WHOLE, [*passed("import.modules"), loop, *passed(*ALL[2:])])
    changed = plan_case(program={"single.state": "changed"})
    request = todo(changed, fold(changed, [whole, COMPARED]))
    assert request
    assert (list(request.limits), request.followers, request.leads) == (["single.loop"], ("single.state",), True)

    new = reading(
        request,
        [Check(name="single.loop", findings=("another loop",)), Check(name="single.state", findings=("odd state",))],
        program={"single.loop": "of-today", "single.state": "changed"},
    )
    found = phases_after(changed, whole, COMPARED, new)[Phase.SINGLE]
    assert next_checks(changed, whole, COMPARED, new) == []
    assert [one.text for one in found.findings] == ["odd loop", "odd state"]
    assert found.checks[0].check == "single.loop"


@pytest.mark.parametrize("checks", [(), (Check(name="single.loop", outcome=FAILED),)])
def test_a_check_that_could_not_follow_is_asked_for_once_in_a_run(checks: tuple[Check, ...]) -> None:
    """The next run asks for it again: a loop that did not pass this time says nothing of a check that follows it."""
    whole = reading(WHOLE, passed(*ALL))
    changed = plan_case(program={"single.contact": "changed"})
    request = todo(changed, fold(changed, [whole, COMPARED]))
    assert request
    program = {"single.loop": "of-today", "single.contact": "changed"}
    runs = [whole, COMPARED, reading(request, checks, program=program)]

    assert next_checks(changed, *runs) == []
    assert outcomes(phases_after(changed, *runs))["single"] == "passed"
    assert todo(changed, fold(changed, runs).reusable("here", failed_too=True)) == request


def test_findings_of_a_changed_check_go_with_it() -> None:
    """Those of the others stay, though all were made in one process."""
    loop = Check(name="single.loop", findings=("odd loop",))
    sync = Check(name="vector.sync", findings=("odd workers",))
    whole = reading(WHOLE, [*passed("import.modules"), loop, sync, *passed(*ALL[3:])])
    changed = plan_case(program={"vector.sync": "changed"})
    request = todo(changed, fold(changed, [whole]))
    assert request
    new = reading(request, passed("vector.sync"), program={"vector.sync": "changed"})

    found = phases_after(changed, whole, new, COMPARED)
    assert [one.text for record in found.values() for one in record.findings] == ["odd loop"]


def test_a_later_run_counts() -> None:
    """Evidence is only added; a check ends with the last run that showed it."""
    failed = reading(WHOLE, [*passed(*ALL[:4]), Check(name="render.rgb_array", outcome=FAILED, message="no EGL")])
    drawn = Request(case=CASE, limits={"render.rgb_array": 120.0}, followers=wire.FOLLOWERS["render.rgb_array"])
    again = reading(drawn, passed("render.rgb_array"))

    assert outcomes(phases_after(plan_case(), failed, again))["render"] == "passed"


TROUBLE = RunEnd(exit_code=1, full=True)


@pytest.mark.parametrize(
    ("end", "host", "again", "reused"),
    [
        (GOOD, HERE, False, True),
        (GOOD, replace(HERE, conditions="elsewhere"), False, False),
        (GOOD, replace(HERE, conditions=None), False, True),
        (GOOD, HERE, True, False),
        (TROUBLE, HERE, False, False),
    ],
)
def test_a_failure_is_reused_where_it_says_something(end: RunEnd, host: Host, again: bool, reused: bool) -> None:
    """A failure is not reused under other conditions, on request, or after trouble of this machine."""
    failed = reading(WHOLE, [Check(name="import.modules", outcome=FAILED, message="no")], end=end, host=host)

    known = fold(plan_case(), [failed]).reusable("here", failed_too=not again)
    assert bool(known.ended) is reused


def test_better_judging_asks_again_for_what_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that is seen to be the machine's fault now was a failure before: it alone is measured again."""
    line = "RuntimeError: the moon is full"
    failed = reading(
        WHOLE, [*passed(*ALL[:4]), Check(name="render.rgb_array", outcome=FAILED, message="the moon is full")]
    )
    runs = [failed, COMPARED]
    assert phases_after(plan_case(), *runs)[Phase.RENDER].decisive == line
    assert next_checks_after_reuse(runs) == []

    monkeypatch.setattr(judging_check, "MACHINE_TROUBLE", judging_check.re.compile("the moon is full"))
    assert phases_after(plan_case(), *runs)[Phase.RENDER].outcome is Outcome.INFRA
    assert next_checks_after_reuse(runs) == ["render.rgb_array"]


def next_checks_after_reuse(runs: list[Reading]) -> list[str]:
    """Return the checks that a later run of the program asks for."""
    request = todo(plan_case(), fold(plan_case(), runs).reusable("here", failed_too=True))
    return list(request.limits) if request else []


def test_a_crash_is_judged_again_without_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its signal is stored, not what was made of it."""
    dead = reading(WHOLE, [*passed(*ALL[:1]), Check(name="single.loop", outcome=DIED)], end=CRASH)
    assert phases_after(plan_case(), dead)[Phase.SINGLE].decisive == "killed by SIGSEGV"

    monkeypatch.setattr(
        "harness.judging.runs.check.describe_death", lambda _code, signal, _stacks: f"signal {signal}, read better"
    )
    assert phases_after(plan_case(), dead)[Phase.SINGLE].decisive == "signal 11, read better"


# --- findings -------------------------------------------------------------------------------------------------------


def test_written_files_and_stray_processes_are_findings() -> None:
    """Written files, stray processes and native errors are findings of the phase of the run's first check."""
    end = replace(GOOD, written=("a.so", "b.so"), stray=2)
    texts = {"log.txt": b"[Error] [carb.gym.plugin] no\n"}
    found = phases_after(plan_case(), reading(WHOLE, passed(*ALL), end=end, texts=texts))[Phase.IMPORT].findings

    assert [(one.check, one.text) for one in found] == [
        ("import.written", "wrote into its own environment (kept from other runs): a.so, b.so"),
        ("import.stray", "left 2 process(es) behind at its end"),
        ("import.native", "[Error] [carb.gym.plugin] no"),
    ]


def test_findings_go_with_the_run_that_counts() -> None:
    """Findings of an attempt that was repeated are not told."""
    slow = Check(name="single.loop", outcome=DIED, findings=("slow",))
    first_try = reading(WHOLE, [*passed(*ALL[:1]), slow], end=OVERRAN)
    request = todo(plan_case(), fold(plan_case(), [first_try]))
    assert request
    second = reading(request, [Check(name="single.loop", findings=("fine",)), *passed(*ALL[2:])])

    told = {one.text for one in phases_after(plan_case(), first_try, second)[Phase.SINGLE].findings}
    assert told == {"fine"}


def test_nothing_of_a_check_is_believed_of_another_program() -> None:
    """A run of which every check is outdated is as good as none."""
    old = reading(WHOLE, passed(*ALL), program=dict.fromkeys(ALL, "older"))

    assert fold(plan_case(), [old]) == Folded()
    assert readings.PROGRAM not in old.run.program.values()
