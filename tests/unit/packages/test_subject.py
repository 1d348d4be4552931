"""The package under test: what a matrix says of it, what is resolved for it, and what its own tests come to."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest
from builders import GENERATED, MACHINES, case, cell, interpreter, lock, make_plan, pin, plain, record

from harness import model
from harness.judging.assess import Assessed, assess
from harness.judging.runs.check import Ending
from harness.judging.runs.pytest_report import Report, outcome_of
from harness.model import (
    CaseRecord,
    Cell,
    Lock,
    Outcome,
    Phase,
    PhaseRecord,
    Question,
    Step,
    Subject,
    Suite,
    Verdict,
    replace,
)
from harness.model.errors import BadInput
from harness.model.vocabulary import SELF
from harness.packages import package_under_test
from harness.reports import document
from harness.running import own_suites

AXES = 'axes = { python = ["3.11"] }\n'
PYTHON = interpreter()


def cells(text: str) -> dict[str, Cell]:
    """Return the cells of a matrix called demo, by label."""
    return {cell.label: cell for cell in make_plan(text).cells}


def subject(found: Cell) -> Subject:
    """Return the subject of a cell."""
    assert found.subject
    return found.subject


# --- what a matrix says ----------------------------------------------------------------------------------------


def test_extras_and_groups_are_axes() -> None:
    """A value is one extra or several; none is named, and neither changes what the matrix itself asks for."""
    found = cells(
        'subject = "."\nextras = ["Base"]\n[axes]\npython = ["3.11"]\n'
        'extra = { extra = ["", "mujoco", "mujoco+Box_2d"] }\ntools = { group = ["", "dev"] }\n'
    )

    assert {label: (subject(one).extras, subject(one).groups) for label, one in found.items()} == {
        "py3.11_no-extra_no-group": (("base",), ()),
        "py3.11_no-extra_dev": (("base",), ("dev",)),
        "py3.11_mujoco_no-group": (("base", "mujoco"), ()),
        "py3.11_mujoco_dev": (("base", "mujoco"), ("dev",)),
        "py3.11_mujoco+box-2d_no-group": (("base", "mujoco", "box-2d"), ()),
        "py3.11_mujoco+box-2d_dev": (("base", "mujoco", "box-2d"), ("dev",)),
    }
    assert found["py3.11_no-extra_no-group"].axes == {"python": "3.11", "extra": "none", "tools": "none"}
    assert {one.question.requirements for one in found.values()} == {()}


def test_a_bundle_brings_extras() -> None:
    """Extras and groups are changes like others, which a value of an axis brings to its cells."""
    found = cells(
        'subject = "."\n[axes]\npython = ["3.11"]\n[axes.api.new]\nextras = ["new"]\ngroups = ["dev"]\n[axes.api.old]\n'
    )

    assert {label: (subject(one).extras, subject(one).groups) for label, one in found.items()} == {
        "py3.11_new": (("new",), ("dev",)),
        "py3.11_old": ((), ()),
    }


def test_conditions_name_extras() -> None:
    """A `when` speaks of an axis of extras by name, none included."""
    found = cells(
        'subject = "."\nexclude = [{ when = { extra = "none" }, reason = "of no use" }]\n'
        '[axes]\npython = ["3.11"]\nextra = { extra = ["", "mujoco"] }\n'
    )

    assert list(found) == ["py3.11_mujoco"]


def test_without_cases_its_modules_are_imported() -> None:
    """A matrix of a subject needs no case: then what it installs is imported; a case may need it to be registered."""
    (bare,) = cells('subject = "."\n' + AXES).values()
    (given,) = cells('subject = "."\n' + AXES + '[[cases]]\nenv = "Own-v0"\napi = "gymnasium"\n').values()

    assert [(one.id, one.env, one.checks, one.packages) for one in bare.cases] == [
        ("import-subject", None, ("import.modules",), (SELF,))
    ]
    assert [one.packages for one in given.cases] == [(SELF,)]


def test_a_suite_runs_where_it_is_asked_for() -> None:
    """The suite's own `when` says in which cells; its keys are told to the cell."""
    found = cells(
        'subject = "."\n[axes]\npython = ["3.11", "3.12"]\n[suite]\narguments = ["-q", "tests"]\ngroups = ["Test"]\n'
        'extras = ["x"]\nrequirements = ["pytest<9"]\ntimeout = 60\nmemory_mb = 100\nwhen = { python = "3.12" }\n'
    )

    assert subject(found["py3.11"]).suite is None
    assert subject(found["py3.12"]).suite == Suite(
        arguments=("-q", "tests"),
        requirements=("pytest<9",),
        extras=("x",),
        groups=("test",),
        seconds=60,
        memory_mb=100,
    )


MISTAKES = {
    "extras-of-nothing": (
        AXES + 'extras = ["x"]',
        'demo.toml: extras: there is no package under test to have it; write for instance subject = "."',
    ),
    "axis-of-nothing": (
        'axes = { python = ["3.11"], extra = { extra = ["x"] } }',
        'demo.toml: axes.extra: there is no package under test to have it; write for instance subject = "."',
    ),
    "suite-of-nothing": (
        AXES + "[suite]",
        'demo.toml: suite: there is no package under test to have it; write for instance subject = "."',
    ),
    "empty": (
        'subject = " "\n' + AXES,
        'demo.toml: subject: write a folder, such as ".", a wheel, or git+ADDRESS@REFERENCE',
    ),
    "no-name": (
        'subject = "."\naxes = { python = ["3.11"], extra = { extra = ["a b"] } }',
        'demo.toml: axes.extra.extra[0]: "a b" is not the name of a package',
    ),
    "twice": (
        'subject = "."\naxes = { python = ["3.11"], extra = { extra = ["A", "a"] } }',
        'demo.toml: axes.extra.extra[1]: "a" is listed twice',
    ),
    "when-misspelt": (
        'subject = "."\nexclude = [{ when = { extra = "mujco" }, reason = "-" }]\n'
        'axes = { python = ["3.11"], extra = { extra = ["", "mujoco"] } }',
        'demo.toml: exclude[0].when.extra: no value of this axis is "mujco"; did you mean "mujoco"?',
    ),
    "phase-without-suite": (
        'subject = "."\nexpect = [{ cells = "*", verdict = "partial", phase = "suite", reason = "-" }]\n' + AXES,
        'demo.toml: expect[0]: no cell goes through the phase "suite" yet',
    ),
}


@pytest.mark.parametrize(("text", "sentence"), MISTAKES.values(), ids=MISTAKES.keys())
def test_mistakes_are_one_sentence(text: str, sentence: str) -> None:
    """Settings of a subject need a subject; each mistake in them is reported in one sentence."""
    with pytest.raises(BadInput) as error:
        cells(text)

    assert str(error.value) == sentence


# --- what is resolved for it -----------------------------------------------------------------------------------


def ready(*requires: str, groups: dict[str, list[object]] | None = None) -> package_under_test.SubjectWheel:
    """Return the wheel of a package `own` with these requirements."""
    return package_under_test.SubjectWheel(
        path=Path("own-1.0-py3-none-any.whl"),
        tested=model.Tested(name="own", version="1.0", sha256="0", content="0"),
        requires=requires,
        extras=("draw", "fast", "all"),
        modules=("own",),
        groups=groups or {},
    )


OWN = ready(
    "numpy>=1.2",
    "old; python_version < '3.9'",
    "new ; python_version >= '3.9'",
    "pygame>=2 ; extra == 'draw'",
    "numba; extra == 'fast' and python_version < '3.9'",
    "jax ; extra == 'fast' and python_version >= '3.9'",
    "Own[draw, fast] ; extra == 'all'",
    groups={"test": ["pytest", {"include-group": "extra"}], "extra": ["own[draw]", "hypothesis"]},
)


def question_for(subject: Subject, question: Question | None = None) -> Question:
    """Return the question that is resolved for the package `own`."""
    return package_under_test.complete_question(
        question or Question(requirements=("numpy==1.26.4",)), subject, OWN, PYTHON
    )


@pytest.mark.parametrize(
    ("extras", "groups", "requirements"),
    [
        ((), (), ("numpy>=1.2", "new")),
        (("draw",), (), ("numpy>=1.2", "new", "pygame>=2")),
        (("all",), (), ("numpy>=1.2", "new", "pygame>=2", "jax")),
        ((), ("test",), ("numpy>=1.2", "new", "pytest", "hypothesis", "pygame>=2")),
    ],
    ids=["plain", "extra", "extra-of-extras", "group-of-groups"],
)
def test_the_projects_requirements_come_first(
    extras: tuple[str, ...], groups: tuple[str, ...], requirements: tuple[str, ...]
) -> None:
    """Its requirements hold for this Python and these extras, before the matrix's own; it is itself never asked for."""
    question = question_for(Subject(source=".", extras=extras, groups=groups))

    assert question.requirements == (*requirements, "numpy==1.26.4")
    assert question.overrides == ("own ; sys_platform == 'never'",)


@pytest.mark.parametrize(
    ("wanted", "question", "sentence"),
    [
        (Subject(source=".", extras=("drw",)), None, 'own has no extra "drw"; did you mean "draw"?'),
        (Subject(source=".", groups=("tset",)), None, 'own has no dependency group "tset"; did you mean "test"?'),
        (
            Subject(source="."),
            Question(requirements=("Own[all]>=1",)),
            "own is the subject, which no requirement, override or axis may name; its extras are for `extras`",
        ),
        (
            Subject(source="."),
            Question(requirements=(), overrides=("own==0.9",)),
            "own is the subject, which no requirement, override or axis may name; its extras are for `extras`",
        ),
    ],
    ids=["extra", "group", "by-name", "override"],
)
def test_a_missing_extra_or_group_is_named_with_the_nearest(
    wanted: Subject, question: Question | None, sentence: str
) -> None:
    """An extra or a group that it does not have is told with the nearest; the matrix may not ask for it by name."""
    with pytest.raises(BadInput) as error:
        question_for(wanted, question)

    assert str(error.value) == sentence


def locked(**versions: str) -> Lock:
    """Return a lock of these versions."""
    return lock(*(pin(name, version) for name, version in versions.items()))


@pytest.mark.parametrize(
    ("suite", "more"),
    [
        (Suite(), ("pytest",)),
        (Suite(groups=("test",), requirements=("mock",)), ("pytest", "hypothesis", "pygame>=2", "mock")),
        (Suite(requirements=("PyTest<8",)), ("PyTest<8",)),
    ],
    ids=["bare", "group", "own-pytest"],
)
def test_packages_of_a_suite(suite: Suite, more: tuple[str, ...]) -> None:
    """The suite's environment holds the cell's packages at the cell's versions, what its tests need, and pytest."""
    own = Subject(source=".", suite=suite)
    cell_question = question_for(own)
    question = own_suites.question(cell_question, locked(numpy="1.26.4", new="2"), own, OWN, PYTHON)

    assert question.constraints == ("numpy==1.26.4", "new==2")
    assert sorted(question.requirements) == sorted({*cell_question.requirements, *more})
    assert question.overrides == cell_question.overrides


def test_a_suite_asks_for_extras_by_their_key() -> None:
    """A requirement that is the subject itself would be passed over, extras and all."""
    own = Subject(source=".", suite=Suite(requirements=("own[draw]",)))

    with pytest.raises(BadInput) as error:
        own_suites.question(question_for(own), locked(numpy="1.26.4"), own, OWN, PYTHON)

    assert str(error.value) == (
        "own is the subject, which no requirement, override or axis may name; its extras are for `suite.extras`"
    )


def test_installed_sources_are_taken_out_of_the_copy(tmp_path: Path) -> None:
    """Wherever a project keeps its sources, none of them can be met; tests and what only bears their name stay."""
    modules = {"own/__init__.py": "\n", "own/core.py": "A = 1\n", "own/more/it.py": "B = 1\n", "own/empty.py": ""}
    with zipfile.ZipFile(tmp_path / "own-1.0-py3-none-any.whl", "w") as wheel:
        for name, text in {**modules, "own-1.0.dist-info/METADATA": ""}.items():
            wheel.writestr(name, text)
    copy = tmp_path / "copy"
    texts = {f"python/deep/{name}": text for name, text in modules.items()}
    texts |= {"src/own/core.py": "", "tests/own/__init__.py": "\n", "tests/own/core.py": "A = 1\n", "setup.py": ""}
    texts |= {"examples/own/__init__.py": "\n", "examples/own/core.py": "C = 1\n", "python/other.py": ""}
    for name, text in texts.items():
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        (copy / name).write_text(text)

    own_suites.remove_modules(copy, replace(OWN, path=tmp_path / "own-1.0-py3-none-any.whl"))

    assert sorted(path.relative_to(copy).as_posix() for path in copy.rglob("*.py")) == [
        "examples/own/__init__.py",
        "examples/own/core.py",
        "python/other.py",
        "setup.py",
        "tests/own/__init__.py",
        "tests/own/core.py",
    ]


def test_a_moved_pin_is_named() -> None:
    """A package of the cell that the tests' lock holds at another version, or not at all, is named."""
    cell_lock = locked(numpy="2.1.0", new="2", jax="1")

    assert own_suites.describe_version_changes(cell_lock, locked(numpy="2.1.0", new="2", jax="1", pytest="8")) is None
    assert (
        own_suites.describe_version_changes(cell_lock, locked(numpy="1.26.4", jax="1"))
        == "the tests ask for numpy 1.26.4 instead of 2.1.0, new gone instead of 2"
    )


# --- what its tests come to ------------------------------------------------------------------------------------

JUNIT = """<?xml version="1.0"?><testsuites><testsuite>
<testcase classname="tests.test_a.TestOne" name="test_good"/>
<testcase classname="tests.test_a" name="test_left"><skipped message="no GPU"/></testcase>
<testcase classname="tests.test_a" name="test_bad[1]">
<failure message="AssertionError: assert 1 == 2&#10; +1"/></testcase>
<testcase classname="tests.test_a" name="test_worse"><failure message="ValueError: no"/></testcase>
</testsuite></testsuites>"""
COLLECTION = """<testsuites><testsuite><testcase classname="" name="tests.test_b"><error message="collection failure">
tests/test_b.py:1: in &lt;module&gt;
    import own
E   ModuleNotFoundError: No module named 'box'</error></testcase></testsuite></testsuites>"""
GOOD = Report(tests={"passed": 2})
SUITES = {
    "passed": (GOOD, Ending(exit_code=0), "", Outcome.PASSED, None),
    "failed": (
        Report.read(JUNIT),
        Ending(exit_code=1),
        "",
        Outcome.FAILED,
        "tests.test_a.test_bad[1]: AssertionError: assert 1 == 2 (2 of 4 tests)",
    ),
    "not-collected": (
        Report.read(COLLECTION),
        Ending(exit_code=2),
        "",
        Outcome.FAILED,
        "tests.test_b: ModuleNotFoundError: No module named 'box' (1 of 1 tests)",
    ),
    "conftest": (
        Report(tests={}),
        Ending(exit_code=4),
        "ImportError while loading conftest '$SUBJECT/conftest.py'.\nE   ModuleNotFoundError: No module named 'box'\n",
        Outcome.FAILED,
        "ModuleNotFoundError: No module named 'box'",
    ),
    "usage": (
        Report(tests={}),
        Ending(exit_code=4),
        "ERROR: usage: pytest\nERROR: unrecognized arguments: --cov\n",
        Outcome.INFRA,
        "pytest cannot be run like this: unrecognized arguments: --cov",
    ),
    "internal": (
        Report(tests={}),
        Ending(exit_code=3),
        "INTERNALERROR> KeyError: 'a'\n",
        Outcome.INFRA,
        "pytest itself failed: KeyError: 'a'",
    ),
    "no-test": (Report(tests={}), Ending(exit_code=5), "", Outcome.SKIPPED, "there is no test to run"),
    "all-skipped": (
        Report(tests={"skipped": 3}),
        Ending(exit_code=0),
        "",
        Outcome.SKIPPED,
        "all 3 tests were skipped",
    ),
    "crashed": (
        GOOD,
        Ending(signal=11),
        'Fatal Python error: Segmentation fault\n  File "$ENV/own.py", line 3 in step',
        Outcome.CRASHED,
        "killed by SIGSEGV (Fatal Python error: Segmentation fault) in step, $ENV/own.py line 3",
    ),
    "exited": (GOOD, Ending(exit_code=77), "bye\n", Outcome.CRASHED, "Python ended with code 77: bye"),
    "timed-out": (GOOD, Ending(signal=9, overran=60), "", Outcome.TIMED_OUT, "no end within 60 s"),
    "ended-by-us": (GOOD, Ending(signal=9, trouble="interrupted"), "", Outcome.INFRA, "interrupted"),
    "disk": (
        Report(tests={"failed": 1}, fault="test_a: OSError: [Errno 28] No space left on device"),
        Ending(exit_code=1),
        "",
        Outcome.INFRA,
        "test_a: OSError: [Errno 28] No space left on device (1 of 1 tests)",
    ),
    "only-words": (Report(tests={}), Ending(exit_code=1), "FAIL Required coverage of 90%\n", Outcome.FAILED,
                   "FAIL Required coverage of 90%"),
}  # fmt: skip


@pytest.mark.parametrize(("report", "ending", "text", "outcome", "decisive"), SUITES.values(), ids=SUITES.keys())
def test_the_outcome_of_a_test_run(
    report: Report, ending: Ending, text: str, outcome: Outcome, decisive: str | None
) -> None:
    """Failures are of the packages, what pytest could not run says nothing of them, no test is no success."""
    assert outcome_of(report, ending, text) == (outcome, decisive)


def test_a_report_is_counted() -> None:
    """Tests are counted by how they ended; what is no plain XML counts as none."""
    assert Report.read(JUNIT).tests == {"failed": 2, "passed": 1, "skipped": 1}
    assert Report.read(JUNIT).bad == ("tests.test_a.test_bad[1]", "tests.test_a.test_worse")
    assert Report.read(COLLECTION).bad == ("tests.test_b",)
    assert Report.read("<testsuites") == Report(tests={})
    assert Report.read('<!DOCTYPE x [<!ENTITY y "z">]><testsuites/>') == Report(tests={})


# --- what that does to the verdict -----------------------------------------------------------------------------


def judged(tried: CaseRecord, ended: Outcome | None, *, asked: bool = True) -> Assessed:
    """Return the judgement of a cell with one case and a suite with this outcome."""
    own = Subject(source=".", suite=Suite() if asked else None)
    suite = PhaseRecord(phase=Phase.SUITE, outcome=ended, decisive="test_a: no") if ended else None
    return assess(record(tried, of=cell(cases=[tried.case], subject=own), suite=suite))


@pytest.mark.parametrize(
    ("tried", "ended", "expected", "at"),
    [
        ("pppp", Outcome.PASSED, Verdict.WORKS, None),
        ("pppp", Outcome.FAILED, Verdict.PARTIAL, Phase.SUITE),
        ("pppp", Outcome.CRASHED, Verdict.PARTIAL, Phase.SUITE),
        ("pppp", Outcome.TIMED_OUT, Verdict.PARTIAL, Phase.SUITE),
        ("pppp", Outcome.FLAKY, Verdict.PARTIAL, Phase.SUITE),
        ("pppp", Outcome.INFRA, Verdict.INCONCLUSIVE, Phase.SUITE),
        ("pppp", Outcome.UNAVAILABLE, Verdict.WORKS, None),
        ("pppp", Outcome.SKIPPED, Verdict.WORKS, None),
        ("pppp", None, Verdict.WORKS, None),
        ("pfnn", Outcome.PASSED, Verdict.PARTIAL, Phase.SINGLE),
        ("pfnn", Outcome.FAILED, Verdict.BROKEN, Phase.SINGLE),
        ("pfnn", Outcome.INFRA, Verdict.INCONCLUSIVE, Phase.SUITE),
        ("ppfn", Outcome.INFRA, Verdict.PARTIAL, Phase.VECTOR),
        ("fnnn", None, Verdict.IMPORT_FAILS, Phase.IMPORT),
        ("punn", Outcome.PASSED, Verdict.UNAVAILABLE, Phase.SINGLE),
        ("pnnn", Outcome.PASSED, Verdict.NOT_RUN, None),
        ("psss", Outcome.PASSED, Verdict.WORKS, None),
        ("psss", Outcome.SKIPPED, Verdict.NOT_RUN, None),
        ("psss", Outcome.FAILED, Verdict.BROKEN, Phase.SUITE),
        ("psss", Outcome.INFRA, Verdict.INCONCLUSIVE, Phase.SUITE),
        ("psss", None, Verdict.NOT_RUN, None),
    ],
)
def test_a_suite_counts_after_the_import(
    tried: str, ended: Outcome | None, expected: Verdict, at: Phase | None
) -> None:
    """A failed suite makes a cell partial, one that could not be told inconclusive where it could change the verdict.

    A passed one shows that a cell works only where no case asks for an environment.
    """
    found = judged(case(tried), ended)

    assert (found.verdict, found.phase) == (expected, at)
    assert found.phases[Phase.SUITE] is (ended or Outcome.NOT_REACHED)


@pytest.mark.parametrize(
    ("ended", "told"), [(None, ("suite",)), (Outcome.UNAVAILABLE, ("suite",)), (Outcome.PASSED, ())]
)
def test_a_suite_that_was_not_run_is_named(ended: Outcome | None, told: tuple[str, ...]) -> None:
    """A working cell says that its suite was not verified."""
    assert judged(case("pppp"), ended).unverified == told


def test_a_suite_without_an_environment_leaves_the_verdict_to_the_cases() -> None:
    """Tests that could not be run are named with the reason: exit code 3, and 1 where a case failed besides."""
    refused = Step(phase=Phase.INSTALL, outcome=Outcome.FAILED, decisive="no swig", log="evidence/build")
    suite = own_suites.not_run("the environment of the tests cannot be made: no swig", refused)
    own = Subject(source=".", suite=Suite())
    for letters, expected, code in (("pppp", Verdict.WORKS, 3), ("pfnn", Verdict.BROKEN, 1)):
        tried = case(letters)
        made = record(tried, of=cell(cases=[tried.case], subject=own), suite=suite)
        whole = document.build([made], [model.Plan(matrix="quick", cells=(made.cell,))], MACHINES, GENERATED)
        entry = whole.cells[0]

        assert (entry.verdict, entry.phases[Phase.SUITE]) == (expected, Outcome.NOT_REACHED)
        assert entry.suite
        assert (entry.suite.not_run, entry.suite.decisive) == (True, suite.decisive)
        assert document.exit_code(whole, ("unexpected", "stale")) == code
    only = replace(case("psss"), phases=tuple(one for one in case("psss").phases if one.phase is Phase.IMPORT))
    asked = replace(cell(subject=own), cases=(replace(cell().cases[0], checks=("import.modules",)),))
    imported = assess(record(only, of=asked, suite=suite))
    assert imported.decisive == f"only the import was tried; its tests were not run: {suite.decisive}"


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        (Step(phase=Phase.INSTALL, outcome=Outcome.FAILED), Outcome.NOT_REACHED),
        (Step(phase=Phase.INSTALL, outcome=Outcome.TIMED_OUT), Outcome.NOT_REACHED),
        (Step(phase=Phase.RESOLVE, outcome=Outcome.TIMED_OUT), Outcome.INFRA),
        (Step(phase=Phase.INSTALL, outcome=Outcome.INFRA), Outcome.INFRA),
        (Step(phase=Phase.RESOLVE, outcome=Outcome.UNAVAILABLE), Outcome.UNAVAILABLE),
    ],
)
def test_a_suite_that_cannot_run_ends_by_its_cause(step: Step, expected: Outcome) -> None:
    """Packages at fault leave it out of reach; the network and this machine stay what they are."""
    assert own_suites.not_run("why", step).outcome is expected


def test_no_suite_no_phase() -> None:
    """Only a cell that is to run a suite has the phase."""
    assert Phase.SUITE not in plain(judged(case("pppp"), None, asked=False).phases)


@pytest.mark.parametrize("letters", ["fn", "pf", "fp", "ff", "fi", "if", "uf"])
def test_no_suite_makes_up_for_a_failure(letters: str) -> None:
    """However a suite ends, a cell whose import or environment failed is not one that works."""
    found = {judged(case(f"{letters}nn"), ended).verdict for ended in (*Outcome, None)}

    assert Verdict.WORKS not in found
