"""Silent known issues: which cases they speak of, and what is said of what is green."""

from __future__ import annotations

import textwrap
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from builders import case, entry, make_knowledge, record, render_phase
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from harness.judging.assess import Assessed, assess
from harness.judging.known_failures import Knowledge
from harness.matrix import signatures
from harness.matrix.signatures import Signature
from harness.model import CaseRecord, CellRecord, Outcome, Phase, Verdict, replace
from harness.model.report_types import CaseEntry, CellEntry, Document
from harness.reports import document
from harness.reports.tables import change_effects
from harness.running.signatures import shipped_signatures
from harness.standalone.failures import silent
from harness.standalone.failures.silent import CaseResult

REPORTS = Path(__file__).parents[3] / "reports"
TEXT = """
[[signature]]
id = "camera-elsewhere"
silent = true
phases = ["render"]
opengl = true
envs = ["Ant-v*"]
apis = ["gymnasium"]
check = "render.camera"
packages = ["gymnasium==1.2.3"]
cause = "The camera looks elsewhere."
remedy = { requirements = ["gymnasium>1.2.3"] }
"""
KNOWN = signatures.read({"silent.toml": textwrap.dedent(TEXT)})
NAME = "silent:camera-elsewhere"


def knowledge() -> Knowledge:
    """Return the known issues of these tests."""
    return make_knowledge(*KNOWN)


def camera_case(camera: Outcome | None) -> CaseRecord:
    """Return a case that drew by OpenGL, and how its camera check ended, if it ran."""
    return case("pppp", render=render_phase(camera, "off", gl={"api": "egl"}))


def ant_case(**changed: object) -> CaseResult:
    """Return an Ant case that drew, with the changes that a test needs."""
    usual = CaseResult("Ant-v5", "gymnasium", {"single": "passed", "render": "passed"}, {}, opengl=True)
    return usual._replace(**changed)


@pytest.mark.parametrize(
    ("changed", "fits"),
    [
        ({}, True),
        ({"env": "gymnasium:Ant-v4"}, True),
        ({"env": "Hopper-v5"}, False),
        ({"api": "gym"}, False),
        ({"opengl": False}, False),
        ({"phases": {"single": "passed", "render": "skipped"}}, False),
        ({"checks": {"render.camera": "passed"}}, False),
        ({"checks": {"render.camera": "skipped"}}, True),
        ({"checks": {"render.camera": "failed"}}, False),
    ],
)
def test_an_issue_is_open_where_it_fits_and_nothing_shows_or_refutes_it(changed: dict[str, object], fits: bool) -> None:
    """Environment, API, phase and picture must fit; a failed check has shown the issue, a passed one refutes it."""
    assert silent.open_issues(KNOWN, ant_case(**changed)) == ((NAME,) if fits else ())


def test_an_exclusion_leaves_environments_out() -> None:
    """`!Ant-*` speaks of all but those."""
    (one,) = signatures.read({"a.toml": textwrap.dedent(TEXT).replace('"Ant-v*"', '"!Ant-*"')})

    assert not silent.concerns(one, "gymnasium:Ant-v5", "gymnasium")
    assert silent.concerns(one, "Own-v0", "gymnasium")
    assert silent.concerns(one, None, None)
    assert not silent.concerns(one, None, "gymnasium")


def judged(seen: CellRecord) -> tuple[Assessed, CellEntry]:
    """Return a record's assessment and its entry in a document."""
    return assess(seen, knowledge()), entry(seen, knowledge())


def test_a_green_cell_says_what_is_left_open() -> None:
    """It works, and is not plainly good: neither it nor a remedy that leads to it is handed out."""
    said, entry = judged(record(camera_case(None)))

    assert (said.verdict, said.unverified) == (Verdict.WORKS, (NAME,))
    assert not said.fulfilled
    assert not silent.plainly_good(entry.verdict, entry.unverified)
    assert not change_effects.works(entry)
    assert [one.unverified for one in entry.cases] == [(NAME,)]


def test_a_check_that_passed_refutes_it() -> None:
    """If the check of a silent issue passed, the cell is plainly good."""
    said, entry = judged(record(camera_case(Outcome.PASSED)))

    assert said.unverified == entry.unverified == ()
    assert silent.plainly_good(entry.verdict, entry.unverified)


def test_a_check_that_failed_names_it() -> None:
    """The case misleads, and the issue is the cell's diagnosis, by the line of the check."""
    said, entry = judged(record(camera_case(Outcome.FAILED)))

    assert (said.verdict, said.unverified) == (Verdict.MISLEADS, ())
    assert [one.misleads for one in entry.cases] == [("render.camera",)]
    assert [(one.signature, one.phase, one.seen) for one in entry.diagnoses] == [
        ("camera-elsewhere", Phase.RENDER, "off")
    ]
    assert entry.as_expected is False


def test_other_releases_are_not_spoken_of() -> None:
    """The packages have to be there in those versions."""
    said, _ = judged(replace(record(camera_case(None)), installed={"gymnasium": "1.3.0"}))

    assert said.unverified == ()


# --- what is committed -----------------------------------------------------------------------------------------


def committed() -> list[Document]:
    """Return every committed report."""
    return [document.read(path.read_bytes(), path.parent.name) for path in sorted(REPORTS.glob("*/report.json"))]


def is_installed(one: Signature, entry: CellEntry) -> bool:
    """Tell whether all packages of a known issue are installed in versions that fit, read by `packaging` alone."""
    installed = entry.installed or {}
    parts = [[Requirement(text) for text in part] for part in one.packages]
    fits = [
        any(each.name in installed and each.specifier.contains(installed[each.name]) for each in part) for part in parts
    ]
    return all(fits) and (one.python is None or SpecifierSet(one.python).contains(entry.python or "0"))


def is_relevant(one: Signature, tested: CaseEntry) -> bool:
    """Tell whether a known issue speaks of a case in which something passed that it would show in."""
    plain = (tested.env or "").rpartition(":")[2]
    named = [pattern for pattern in one.envs if not pattern.startswith("!")]
    left_out = [pattern[1:] for pattern in one.envs if pattern.startswith("!")]
    fits = [
        any(fnmatchcase(name, pattern) for pattern in patterns for name in (plain, tested.env or ""))
        for patterns in (named, left_out)
    ]
    passed = [tested.phases.get(phase) is Outcome.PASSED for phase in one.phases or (Phase.SINGLE,)]
    drew = bool(tested.drawn) or not one.opengl
    return (fits[0] or not named) and not fits[1] and any(passed) and drew and tested.api in (one.apis or {tested.api})


def test_no_committed_green_fits_a_silent_issue_without_saying_so() -> None:
    """Each case that one fits misleads by its check, or says that it is left open, unless the check refuted it."""
    issues = [one for one in shipped_signatures.load_all() if one.silent]
    fitting = [
        (entry, tested, one)
        for made in committed()
        for entry in made.cells
        for one in issues
        if is_installed(one, entry)
        for tested in entry.cases
        if is_relevant(one, tested)
    ]
    silently = [
        (entry.id, tested.case, one.id)
        for entry, tested, one in fitting
        if not (
            one.check in tested.misleads
            or tested.checks.get(one.check or "") is Outcome.PASSED
            or (f"silent:{one.id}" in tested.unverified and f"silent:{one.id}" in entry.unverified)
        )
    ]

    assert silently == []
    assert {"mujoco-before-numpy2-vectors", "gymnasium-robotics131-fetch-misplaced"} <= {one.id for *_, one in fitting}


def test_silent_issues_are_read_apart() -> None:
    """Reading them alone gives what reading all of them gives."""
    whole = [one.as_file for one in shipped_signatures.load_all() if one.silent]
    assert len(whole) > 5
    assert [one.as_file for one in shipped_signatures.silent()] == whole
