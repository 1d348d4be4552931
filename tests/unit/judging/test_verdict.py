"""Judging: the table of verdicts, its order, and what no evidence may ever lead to."""

import itertools

import pytest
from builders import CHECKS, LETTERS, case, cell, phase, plain, record, render_phase, step, warning

from harness.judging import expectation
from harness.judging.assess import Assessed, assess
from harness.judging.counted_phases import ON_REQUEST, effective
from harness.judging.expectation import matches_line
from harness.judging.runs import misleading
from harness.model import (
    CASE_PHASES,
    CELL_PHASES,
    FAILING,
    Case,
    CaseRecord,
    CellRecord,
    CheckRecord,
    ControlRecord,
    Expectation,
    Finding,
    Level,
    Observation,
    Outcome,
    Phase,
    PhaseRecord,
    Verdict,
    replace,
    worst,
)
from harness.model.report_types import SEVERITY

IMPORT_ONLY = Case(id="numpy", env=None, api="gymnasium", checks=("import.modules",))


def imported(outcome: Outcome) -> CellRecord:
    """Return a cell whose only case has nothing but an import check."""
    probe = phase(Phase.IMPORT, outcome, "no numpy" if outcome in FAILING else None)
    tried = CaseRecord(case="numpy", env=None, api="gymnasium", required=(), phases=(probe,))
    return record(tried, of=replace(cell(), cases=(IMPORT_ONLY,)))


STEPS = {
    "no record at all": (CellRecord(cell=cell(), machine="m"), Verdict.NOT_RUN, None, None),
    "no interpreter here": (
        CellRecord(cell=cell(), machine="m", unavailable="no Python 3.14 here"),
        Verdict.UNAVAILABLE,
        Phase.RESOLVE,
        "no Python 3.14 here",
    ),
    "no solution": (
        record(resolve=step(Phase.RESOLVE, Outcome.FAILED, "Because a and b"), install=None),
        Verdict.UNRESOLVABLE,
        Phase.RESOLVE,
        "Because a and b",
    ),
    "index unreachable": (
        record(resolve=step(Phase.RESOLVE, Outcome.INFRA, "no route"), install=None),
        Verdict.INCONCLUSIVE,
        Phase.RESOLVE,
        "no route",
    ),
    "a resolution that timed out is infra": (
        record(resolve=step(Phase.RESOLVE, Outcome.TIMED_OUT, "600 s"), install=None),
        Verdict.INCONCLUSIVE,
        Phase.RESOLVE,
        "600 s",
    ),
    "vendor archive missing": (
        record(resolve=step(Phase.RESOLVE, Outcome.UNAVAILABLE, "set UV_FIND_LINKS"), install=None),
        Verdict.UNAVAILABLE,
        Phase.RESOLVE,
        "set UV_FIND_LINKS",
    ),
    "a build failed while installing": (
        record(install=step(Phase.INSTALL, Outcome.FAILED, "gcc")),
        Verdict.UNINSTALLABLE,
        Phase.INSTALL,
        "gcc",
    ),
    "a build that did not end in time": (
        record(install=step(Phase.INSTALL, Outcome.TIMED_OUT, "1800 s")),
        Verdict.INCONCLUSIVE,
        Phase.INSTALL,
        "1800 s",
    ),
    "a build failed while resolving": (
        record(resolve=None, install=step(Phase.INSTALL, Outcome.FAILED, "setup.py")),
        Verdict.UNINSTALLABLE,
        Phase.INSTALL,
        "setup.py",
    ),
    "disk full while installing": (
        record(install=step(Phase.INSTALL, Outcome.INFRA, "No space left")),
        Verdict.INCONCLUSIVE,
        Phase.INSTALL,
        "No space left",
    ),
    "stopped after resolve": (record(install=None), Verdict.NOT_RUN, None, None),
    "stopped after install": (record(of=cell()), Verdict.NOT_RUN, None, None),
    "what the cell needs was missing after resolve": (
        record(install=None, unavailable="needs a gpu"),
        Verdict.UNAVAILABLE,
        Phase.INSTALL,
        "needs a gpu",
    ),
}


@pytest.mark.parametrize(("evidence", "expected", "at", "why"), STEPS.values(), ids=STEPS.keys())
def test_steps_on_the_host(evidence: CellRecord, expected: Verdict, at: Phase | None, why: str | None) -> None:
    """A step that ends before any probe decides the verdict, with its phase and line."""
    judged = assess(evidence)

    assert (judged.verdict, judged.phase, judged.decisive) == (expected, at, why)


PROBES = {
    "everything passed": ("pppp", None, Verdict.WORKS, None, ()),
    "no vector API": ("ppsp", None, Verdict.WORKS, None, ()),
    "no EGL here": ("pppu", None, Verdict.WORKS, None, ("render",)),
    "nothing but single can run here": ("ppuu", None, Verdict.WORKS, None, ("vector", "render")),
    "stopped after single": ("ppnn", None, Verdict.WORKS, None, ("vector", "render")),
    "stopped after import": ("pnnn", None, Verdict.NOT_RUN, None, ()),
    "one case skips what the other passes": ("ppss", "pppp", Verdict.WORKS, None, ()),
    "one case has no GPU": ("pppp", "punn", Verdict.WORKS, None, ("single", "vector", "render")),
    "one case cannot even be imported here": (
        "pppp",
        "unnn",
        Verdict.WORKS,
        None,
        ("import", "single", "vector", "render"),
    ),
    "one case was never reached": ("pppp", "pnnn", Verdict.NOT_RUN, None, ()),
    "no GPU for any case": ("punn", "punn", Verdict.UNAVAILABLE, Phase.SINGLE, ()),
    "no GPU to import with": ("unnn", None, Verdict.UNAVAILABLE, Phase.IMPORT, ()),
    "import fails everywhere": ("fnnn", "cnnn", Verdict.IMPORT_FAILS, Phase.IMPORT, ()),
    "import fails, the other case has no GPU": ("fnnn", "unnn", Verdict.IMPORT_FAILS, Phase.IMPORT, ()),
    "import fails in one case only": ("fnnn", "pppp", Verdict.PARTIAL, Phase.IMPORT, ()),
    "import crashes in one case, the other never steps": ("cnnn", "pfnn", Verdict.BROKEN, Phase.IMPORT, ()),
    "single fails": ("pfnn", None, Verdict.BROKEN, Phase.SINGLE, ()),
    "single crashes": ("pcnn", None, Verdict.BROKEN, Phase.SINGLE, ()),
    "single hangs": ("ptnn", None, Verdict.BROKEN, Phase.SINGLE, ()),
    "single is flaky": ("pynn", None, Verdict.BROKEN, Phase.SINGLE, ()),
    "single fails in one case": ("pfnn", "pppp", Verdict.PARTIAL, Phase.SINGLE, ()),
    "vector fails": ("ppfp", None, Verdict.PARTIAL, Phase.VECTOR, ()),
    "render fails": ("pppf", None, Verdict.PARTIAL, Phase.RENDER, ()),
    "render fails, vector unavailable": ("ppuf", None, Verdict.PARTIAL, Phase.RENDER, ()),
    "infra in import": ("innn", None, Verdict.INCONCLUSIVE, Phase.IMPORT, ()),
    "infra in single": ("pinn", None, Verdict.INCONCLUSIVE, Phase.SINGLE, ()),
    "infra in render could still make it partial": ("pppi", None, Verdict.INCONCLUSIVE, Phase.RENDER, ()),
    "infra in render of what is partial anyway": ("ppfi", None, Verdict.PARTIAL, Phase.VECTOR, ()),
    "infra in a second case of what is partial anyway": ("pppf", "innn", Verdict.PARTIAL, Phase.RENDER, ()),
    "infra in a second case of what may be broken": ("pfnn", "pinn", Verdict.INCONCLUSIVE, Phase.SINGLE, ()),
    "infra beside an import that fails": ("fnnn", "innn", Verdict.INCONCLUSIVE, Phase.IMPORT, ()),
    "infra beside nothing that could run here": ("pinn", "punn", Verdict.INCONCLUSIVE, Phase.SINGLE, ()),
}


@pytest.mark.parametrize(("first", "second", "expected", "at", "unverified"), PROBES.values(), ids=PROBES.keys())
def test_probes(
    first: str, second: str | None, expected: Verdict, at: Phase | None, unverified: tuple[str, ...]
) -> None:
    """The outcomes of one or two cases decide the verdict, its phase, and what stays unverified."""
    cases = (case(first, "ant"), *([case(second, "pusher")] if second else []))

    judged = assess(record(*cases))

    assert (judged.verdict, judged.phase, judged.unverified) == (expected, at, unverified)


@pytest.mark.parametrize(
    ("outcomes", "line"),
    [("pfnn", "ant single"), ("pppi", "ant render"), ("pppp", None), ("pppu", None)],
)
def test_decisive_line(outcomes: str, line: str | None) -> None:
    """The decisive line is that of the first case in the deciding phase; a working cell has none."""
    assert assess(record(case(outcomes), case("pppp", "pusher"))).decisive == line


def test_decisive_line_of_a_check() -> None:
    """A phase without a line of its own takes that of its first check that ended as it did."""
    failed = phase(Phase.SINGLE, Outcome.FAILED, "KeyError: 'x'")
    bare = PhaseRecord(phase=Phase.SINGLE, outcome=Outcome.FAILED, checks=failed.checks)

    assert assess(record(case("pfnn", single=bare))).decisive == "KeyError: 'x'"


def test_import_alone_is_never_works() -> None:
    """A cell that was only imported was not run as far as a user is concerned, and says so."""
    judged = assess(imported(Outcome.PASSED))

    assert (judged.verdict, judged.phase, judged.decisive) == (Verdict.NOT_RUN, None, "only the import was tried")
    assert plain(judged.phases)["single"] == "skipped"


@pytest.mark.parametrize(
    ("said", "phases", "expected"),
    [
        (Verdict.NOT_RUN, "psss", True),
        (Verdict.NOT_RUN, "pnss", False),
        (Verdict.NOT_RUN, "nnnn", False),
        (Verdict.WORKS, "pppu", True),
        (Verdict.IMPORT_FAILS, "fsss", False),
    ],
)
def test_all_that_was_asked_for(said: Verdict, phases: str, expected: bool) -> None:
    """A cell that only imports may do all that is asked of it, though it never works."""
    letters = {"p": Outcome.PASSED, "s": Outcome.SKIPPED, "n": Outcome.NOT_REACHED, "u": Outcome.UNAVAILABLE,
               "f": Outcome.FAILED}  # fmt: skip
    found = {phase: letters[letter] for phase, letter in zip(CASE_PHASES, phases, strict=False)}
    assert expectation.is_fulfilled(said, found) is expected


def test_without_a_loop_nothing_is_works() -> None:
    """A case with batched environments alone names the phase that is missing and the phase that passed."""
    asked = Case(id="ant", env="Ant-v5", api="gymnasium", checks=("import.modules", "vector.sync"))
    judged = assess(record(case("psps"), of=replace(cell(), cases=(asked,))))

    assert (judged.verdict, judged.decisive) == (Verdict.NOT_RUN, "vector passed, but single was not tried")


def test_import_alone_can_fail() -> None:
    """The failure of an import that is all that was asked for is a verdict."""
    judged = assess(imported(Outcome.FAILED))

    assert (judged.verdict, judged.decisive) == (Verdict.IMPORT_FAILS, "no numpy")


def test_phases_are_the_worst_of_cases() -> None:
    """All six phases are told, each as the worst of the cases in the order of the outcomes."""
    judged = assess(record(case("ppfu"), case("pppn", "pusher")))

    assert plain(judged.phases) == {
        "resolve": "passed",
        "install": "passed",
        "import": "passed",
        "single": "passed",
        "vector": "failed",
        "render": "unavailable",
    }


def test_skipped_without_a_check_was_left_out() -> None:
    """A phase that was asked for, and skipped without a check that says so, counts as not reached."""
    left_out = PhaseRecord(phase=Phase.RENDER, outcome=Outcome.SKIPPED)

    judged = assess(record(case("pppp", render=left_out)))

    assert (judged.phases[Phase.RENDER], judged.unverified) == (Outcome.NOT_REACHED, ("render",))


def test_check_that_was_left_out() -> None:
    """A phase of which only one of two checks ran did not pass, however well that one went."""
    asked = replace(cell().cases[0], checks=(*CHECKS.values(), "vector.async.fork"))

    judged = assess(record(case("pppp"), of=replace(cell(), cases=(asked,))))

    assert (judged.phases[Phase.VECTOR], judged.unverified) == (Outcome.NOT_REACHED, ("vector",))


def test_case_without_record() -> None:
    """A case that the cell should have and of which nothing is known keeps the cell from working."""
    assert assess(record(case("pppp"), of=cell(cases=("ant", "pusher")))).verdict is Verdict.NOT_RUN


class TestRequired:
    REPEAT = "single.repeat.fresh"

    def with_finding(self, required: tuple[str, ...], level: Level = Level.WARNING) -> CellRecord:
        found = Finding(check=self.REPEAT, level=level, text="differs from step 3 on")
        single = phase(Phase.SINGLE, Outcome.PASSED, findings=(found,))
        return record(case("pppp", required=required, single=single))

    def test_warning_of_a_required_check_fails_its_phase(self) -> None:
        """A required finding turns its phase, and so the cell, red with the finding as the decisive line."""
        judged = assess(self.with_finding((self.REPEAT,)))

        assert (judged.verdict, judged.phase) == (Verdict.PARTIAL, Phase.SINGLE)
        assert judged.decisive == "single.repeat.fresh: differs from step 3 on"

    def test_other_findings_stay_findings(self) -> None:
        """A warning that no case requires, and a note, change no verdict."""
        assert assess(self.with_finding(("single.space",))).verdict is Verdict.WORKS
        assert assess(self.with_finding((self.REPEAT,), Level.NOTE)).verdict is Verdict.WORKS

    def test_failure_keeps_its_own_reason(self) -> None:
        """A phase that failed of itself is not retold by a finding."""
        failed = phase(Phase.SINGLE, Outcome.CRASHED, "killed by SIGSEGV", (warning(self.REPEAT),))

        assert effective(failed, (self.REPEAT,)) is failed

    def test_required_finding_at_import_is_no_failed_import(self) -> None:
        """A cell that runs is not said to fail at import because a required check warned there."""
        loud = phase(Phase.IMPORT, Outcome.PASSED, findings=(warning("import.deprecation"),))

        judged = assess(record(case("pppp", required=("import.deprecation",), **{"import": loud})))

        assert (judged.verdict, judged.phase) == (Verdict.PARTIAL, Phase.IMPORT)


# --- every combination -----------------------------------------------------------------------------------------

WAYS = ["".join(letters) for letters in itertools.product("pfiuns", repeat=4)]
REACHABLE = ["fnnn", "innn", "unnn", *(f"p{single}nn" for single in "fiun")] + [
    f"pp{vector}{render}" for vector in "pfiuns" for render in "pfiuns"
]
"""What a case can come to: without its import or single phase nothing that needs it is reached."""

RED = {Verdict.IMPORT_FAILS, Verdict.PARTIAL, Verdict.BROKEN}


def judged_letters(*cases: str) -> Assessed:
    """Judge cases written as letters."""
    return assess(record(*(case(letters, f"c{n}") for n, letters in enumerate(cases))))


def possible(both: str) -> set[Verdict]:
    """Return the verdicts of two cases for every way in which each `i` may really have passed or failed."""
    found = set()
    for world in itertools.product("pf", repeat=both.count("i")):
        drawn = iter(world)
        filled = "".join(next(drawn) if letter == "i" else letter for letter in both)
        found.add(judged_letters(filled[:4], filled[4:]).verdict)
    return found


def test_truths_that_hold_for_every_pair_of_cases() -> None:
    """No combination breaks the rules that matter most: never a wrong `works`, never blame without a failure."""
    for first, second in itertools.product(REACHABLE, repeat=2):
        both = first + second
        judged = judged_letters(first, second)
        deciding = judged.phases[judged.phase] if judged.phase else None
        if judged.verdict is Verdict.WORKS:
            assert not set("fi") & set(both)
            assert "p" in first[1] + second[1]
            assert set(judged.unverified) == {at for n, at in enumerate(CHECKS) if set("un") & {first[n], second[n]}}
        if judged.verdict in RED:
            assert "f" in both
            assert deciding in FAILING
            assert judged.decisive
        if judged.verdict is Verdict.PARTIAL:
            assert "p" in first[1:] + second[1:]
        if judged.verdict in {Verdict.UNAVAILABLE, Verdict.NOT_RUN}:
            assert not set("fi") & set(both)
        assert (judged.verdict is Verdict.INCONCLUSIVE) <= ("i" in both)
        assert tuple(judged.phases) == CELL_PHASES
        assert judged.verdict is judged_letters(second, first).verdict


@pytest.mark.parametrize("first", ["pppp", "pppf", "pfnn", "fnnn", "pppi", "piii", "iiii", "punn", "ppss", "pnnn"])
def test_inconclusive_exactly_where_infra_could_change_the_verdict(first: str) -> None:
    """If all possible outcomes of the infra trouble give one verdict, it is given; else the cell is inconclusive."""
    for second in ("pppp", "ppip", "ppii", "piii", "pfii", "fiii", "ppfi"):
        verdicts = possible(first + second)

        judged = judged_letters(first, second).verdict

        assert judged is (verdicts.pop() if len(verdicts) == 1 else Verdict.INCONCLUSIVE), (first, second)


def test_more_failures_never_make_a_better_verdict() -> None:
    """Turning any passed phase into a failed one leaves the verdict as bad or makes it worse."""
    for letters in (letters for letters in WAYS if "i" not in letters):
        before = SEVERITY.index(judged_letters(letters).verdict)
        for position in (n for n, letter in enumerate(letters) if letter == "p"):
            after = judged_letters(letters[:position] + "f" + letters[position + 1 :]).verdict

            assert SEVERITY.index(after) <= before, (letters, position)


def test_specimens_cover_every_outcome() -> None:
    """The letters of these tests stand for all outcomes, and every case phase has a check."""
    assert set(LETTERS.values()) == set(Outcome)
    assert tuple(CHECKS) == tuple(phase for phase in CASE_PHASES if phase not in ON_REQUEST)


# --- expectations and exit codes -------------------------------------------------------------------------------

TODAY = "2026-11-21T12:00:00Z"
BROKEN = assess(record(case("pfnn")))
PARTIAL = assess(record(case("ppfp")))
WORKS = assess(record(case("pppp")))
UNTOLD = assess(CellRecord(cell=cell(), machine="m"))


def expecting(what: Verdict, **more: str) -> Expectation:
    """Return an expectation with a reason."""
    return Expectation(verdict=what, reason="known", **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("expect", "judged", "as_expected", "stale"),
    [
        pytest.param(None, WORKS, True, None, id="works without expectation"),
        pytest.param(None, BROKEN, False, None, id="red without expectation"),
        pytest.param(None, UNTOLD, None, None, id="nothing run"),
        pytest.param(expecting(Verdict.BROKEN), UNTOLD, None, None, id="nothing run, something expected"),
        pytest.param(expecting(Verdict.BROKEN), BROKEN, True, None, id="red as expected"),
        pytest.param(expecting(Verdict.BROKEN, phase=Phase.SINGLE), BROKEN, True, None, id="in the phase expected"),
        pytest.param(expecting(Verdict.BROKEN, phase=Phase.RENDER), BROKEN, False, None, id="in another phase"),
        pytest.param(expecting(Verdict.BROKEN, match="ant s.ngle"), BROKEN, True, None, id="with the line expected"),
        pytest.param(expecting(Verdict.BROKEN, match="XML Error"), BROKEN, False, None, id="with another line"),
        pytest.param(expecting(Verdict.WORKS), BROKEN, False, None, id="worse than expected"),
        pytest.param(
            expecting(Verdict.BROKEN),
            PARTIAL,
            False,
            "quick/py3.11_gymnasium-1.2.3 does better than expected: partial instead of broken",
            id="better than expected",
        ),
        pytest.param(
            expecting(Verdict.BROKEN, until="2026-11-20"),
            BROKEN,
            True,
            "quick/py3.11_gymnasium-1.2.3 was expected to be broken until 2026-11-20, which has passed",
            id="its date has passed",
        ),
        pytest.param(expecting(Verdict.BROKEN, until="2026-11-21"), BROKEN, True, None, id="on its last day"),
    ],
)
def test_expectations(
    expect: Expectation | None, judged: Assessed, as_expected: bool | None, stale: str | None
) -> None:
    """A judgement is compared with verdict, phase and line; better than expected is stale, not as expected."""
    assert expectation.compare_expected(cell(expect=expect), judged, TODAY, tuple) == (as_expected, stale)


BLANK = Observation(check="render.rgb_array", code="render.blank", got=[0, 0, 0])
BLACK = "ContractViolation: blank frame: every pixel is [0, 0, 0]"


@pytest.mark.parametrize(
    ("code", "data", "line", "seen", "expected"),
    [
        ("render.blank", {}, "in other words", BLANK, True),
        ("render.blank", {"got": r"\[0, 0, 0\]"}, "in other words", BLANK, True),
        ("render.blank", {"got": r"\[1, .*"}, BLACK, BLANK, False),
        ("render.shape", {}, BLACK, BLANK, False),
        ("render.blank", {}, BLACK, None, True),
        ("render.blank", {"got": r"\[1, .*"}, BLACK, None, False),
        ("render.blank", {}, "ValueError: no", None, False),
        ("render.blank", {}, None, None, False),
    ],
)
def test_an_expected_code(
    code: str, data: dict[str, str], line: str | None, seen: Observation | None, expected: bool
) -> None:
    """The observation is compared; where a document has the line alone, that."""
    expect = Expectation(verdict=Verdict.PARTIAL, reason="known", code=code, data=data)
    assert matches_line(expect, line, seen) is expected


def test_the_observation_of_the_decisive_line() -> None:
    """Of the check that has this line, or of a finding that the case requires not to be there; of no library's line."""
    check = CheckRecord(check="render.rgb_array", outcome=Outcome.FAILED, decisive=BLACK, observed=BLANK)
    failed = replace(phase(Phase.RENDER, Outcome.FAILED, BLACK), checks=(check,))
    assert assess(record(case("pppp", render=failed))).observed == BLANK
    plain = replace(failed, checks=(replace(check, observed=None),))
    assert assess(record(case("pppp", render=plain))).observed is None
    found = Finding(check="render.blank", level=Level.WARNING, text="black", observed=BLANK)
    passed = phase(Phase.RENDER, Outcome.PASSED, findings=(found,))
    required = replace(case("pppp", render=passed), required=("render.blank",))
    judged = assess(record(required))
    assert (judged.decisive, judged.observed) == ("render.blank: black", BLANK)


BOTH = {"unexpected", "stale"}


@pytest.mark.parametrize(
    ("judged", "stale", "fail_on", "code"),
    [
        pytest.param([(Verdict.WORKS, True), (Verdict.BROKEN, True)], False, {"stale"}, 0, id="all as expected"),
        pytest.param([(Verdict.BROKEN, False), (Verdict.INCONCLUSIVE, None)], False, BOTH, 1, id="1 before 3"),
        pytest.param([(Verdict.BROKEN, False)], False, {"stale"}, 0, id="unexpected, and nobody minds"),
        pytest.param([(Verdict.WORKS, True), (Verdict.INCONCLUSIVE, None)], False, {"stale"}, 3, id="could not tell"),
        pytest.param([(Verdict.UNAVAILABLE, None), (Verdict.NOT_RUN, None)], False, {"stale"}, 0, id="nothing said"),
        pytest.param([(Verdict.UNAVAILABLE, None)], False, {"unavailable"}, 1, id="fail on what says nothing"),
        pytest.param([(Verdict.WORKS, True)], True, {"stale"}, 1, id="stale fails"),
        pytest.param([(Verdict.WORKS, True)], True, set(), 0, id="stale, and nobody minds"),
        pytest.param([], False, {"stale"}, 0, id="no cells"),
    ],
)
def test_exit_code(judged: list[tuple[Verdict, bool | None]], stale: bool, fail_on: set[str], code: int) -> None:
    """1 for what is not as expected, before 3 for what could not be told, before 0."""
    assert expectation.exit_code(judged, stale=stale, fail_on=fail_on) == code


# --- what misleads ----------------------------------------------------------------------------------------------

CAMERA = Case(id="Ant-v5", env="Ant-v5", api="gymnasium", checks=(*CHECKS.values(), "render.camera"))


def camera_case(camera: Outcome, *, single: Outcome = Outcome.PASSED) -> CaseRecord:
    """Return a case that drew a picture, with this outcome of its camera check."""
    picture = render_phase(camera, "lookat is (0.55, 0.55, 0.55)")
    render = replace(picture, outcome=worst(one.outcome for one in misleading.deciding_checks(picture.checks)))
    ended = phase(Phase.SINGLE, single, None if single is Outcome.PASSED else "no reset")
    return case("pppp", "Ant-v5", single=ended, render=render)


def test_a_misleading_check_that_fails_leaves_its_phase_and_makes_the_verdict() -> None:
    """The picture was drawn, so `render` passed; the cell misleads, by the line of the check."""
    seen = record(camera_case(Outcome.FAILED), of=replace(cell(), cases=(CAMERA,)))

    judged = assess(seen)

    assert (judged.verdict, judged.phase) == (Verdict.MISLEADS, Phase.RENDER)
    assert judged.decisive == "lookat is (0.55, 0.55, 0.55)"
    assert judged.phases[Phase.RENDER] is Outcome.PASSED
    assert expectation.compare_expected(seen.cell, judged, "2026-11-23", tuple)[0] is False
    assert not expectation.is_fulfilled(judged.verdict, judged.phases)


def test_misleads_comes_before_the_failures_of_other_phases() -> None:
    """A failure stays in `phases`, and a trouble of this machine elsewhere does not hide what was shown."""
    whole = replace(cell(), cases=(CAMERA,))
    failed = assess(record(camera_case(Outcome.FAILED, single=Outcome.FAILED), of=whole))
    infra = assess(record(camera_case(Outcome.FAILED, single=Outcome.INFRA), of=whole))

    assert failed.verdict is infra.verdict is Verdict.MISLEADS
    assert failed.phases[Phase.SINGLE] is Outcome.FAILED


@pytest.mark.parametrize("camera", [Outcome.PASSED, Outcome.SKIPPED, Outcome.UNAVAILABLE])
def test_a_misleading_check_that_shows_nothing_harms_nobody(camera: Outcome) -> None:
    """It passed, has no meaning here, or could not be measured: the cell works."""
    judged = assess(record(camera_case(camera), of=replace(cell(), cases=(CAMERA,))))

    assert judged.verdict is Verdict.WORKS
    assert judged.unverified == ()


def test_a_process_that_dies_in_a_misleading_check_is_a_failure() -> None:
    """A crash is loud: it fails the phase, and misleads nobody."""
    judged = assess(record(camera_case(Outcome.CRASHED), of=replace(cell(), cases=(CAMERA,))))

    assert (judged.verdict, judged.phases[Phase.RENDER]) == (Verdict.PARTIAL, Outcome.CRASHED)


def test_a_control_that_fails_the_same_misleading_check_makes_it_inconclusive() -> None:
    """A known-good lock that shows the same puts the blame on the check or on this machine."""
    seen = record(camera_case(Outcome.FAILED), of=replace(cell(), cases=(CAMERA,)))
    same = ControlRecord(control="control gymnasium-1", failed={"render.camera": "lookat"})
    other = ControlRecord(control="control gymnasium-1", failed={"single.contact": "passed through"})

    assert assess(replace(seen, controls={"gymnasium": same})).verdict is Verdict.INCONCLUSIVE
    assert assess(replace(seen, controls={"gymnasium": other})).verdict is Verdict.MISLEADS


def test_misleads_may_be_expected() -> None:
    """An expectation may name it; a cell that works then does better, and one that fails to import worse."""
    expect = Expectation(verdict=Verdict.MISLEADS, reason="numpy 2", phase=Phase.RENDER, match="lookat")
    whole = replace(cell(), cases=(CAMERA,), expect=expect)

    assert (
        expectation.compare_expected(whole, assess(record(camera_case(Outcome.FAILED), of=whole)), "2026", tuple)[0]
        is True
    )
    works = assess(record(camera_case(Outcome.PASSED), of=whole))
    assert expectation.compare_expected(whole, works, "2026", tuple) == (
        False,
        f"{whole.id} does better than expected: works instead of misleads",
    )
