"""Test the output for CI platforms: annotations for every cell that makes the run fail, and a summary that fits."""

from __future__ import annotations

from itertools import chain, combinations
from pathlib import Path

import msgspec
import pytest
from builders import MACHINES, record
from builders import case as tried
from builders import cell as planned
from specimens import RESET, combination, quick, quick_document, quick_record

from harness.__main__ import main
from harness.model import Expectation, Outcome, Phase, Step, Verdict, replace
from harness.model.report_types import Document
from harness.reports import document, publishing
from harness.reports.text import github_annotations

ALL = ("unexpected", "stale", "inconclusive", "unavailable", "not_run")


def reds(count: int, decisive: str | None = None) -> Document:
    """Return a report of so many broken cells, each for a reason of its own unless one is given."""
    made = quick_document()
    red = next(cell for cell in made.cells if cell.verdict is Verdict.PARTIAL and cell.as_expected is False)
    cells = [msgspec.structs.replace(red, id=f"quick/{at}", decisive=decisive or f"reason {at}") for at in range(count)]
    return msgspec.structs.replace(made, cells=tuple(cells), stale=())


def test_every_cell_that_fails_is_named() -> None:
    """Worst first: what is not as expected, then what could not be told or was not run where that was asked."""
    lines = github_annotations.github(quick_document(), ("unexpected", "not_run")).splitlines()

    assert lines == [
        "::error title=quick/py3.11_gymnasium-0.29.1_mujoco-1.50::unresolvable in resolve: Because there is no"
        " mujoco==1.50",
        "::error title=quick/py3.11_gymnasium-0.29.1_mujoco-3.3.7::partial in render: AttributeError:"
        " 'mujoco._structs.MjData' object has no attribute 'solver_iter'",
        "::error title=quick/py3.11_gymnasium-1.2.3_mujoco-2.3.7::partial in vector: ValueError: XML Error: bad | worse"
        " / Element 'default', line 0",
        "::error title=quick/py3.13_gymnasium-1.2.3_mujoco-2.3.7::not run",
    ]


def test_cells_with_one_reason_share_an_annotation() -> None:
    """The same line is told once, with every cell that ended so."""
    (line,) = github_annotations.github(reds(3, "no\nsuch 100% file"), ("unexpected",)).splitlines()

    assert line == (
        "::error title=quick/0 and 2 more cells::partial in render: no%0Asuch 100%25 file%0Aalso:%0Aquick/1%0Aquick/2"
    )


def test_an_annotation_stays_readable() -> None:
    """Of a great many cells with one reason some are named, and the others counted."""
    (line,) = github_annotations.github(reds(100, "gone"), ("unexpected",)).splitlines()

    assert line.startswith("::error title=quick/0 and 99 more cells::")
    assert line.endswith("quick/18%0Aquick/19%0Aand 80 more cells")


def test_properties_are_escaped() -> None:
    """A colon or a comma in a title does not end it."""
    cell = msgspec.structs.replace(reds(1).cells[0], id="quick/a:b,c%d")
    made = msgspec.structs.replace(reds(1), cells=(cell,))

    assert github_annotations.github(made, ("unexpected",)).startswith("::error title=quick/a%3Ab%2Cc%25d::partial")


@pytest.mark.parametrize(
    ("count", "title"),
    [(9, "quick/8"), (10, "quick/9"), (11, "and 2 more reasons to fail"), (25, "and 16 more reasons to fail")],
)
def test_the_platform_shows_ten(count: int, title: str) -> None:
    """More than are shown end with how many more there are."""
    lines = github_annotations.github(reds(count), ("unexpected",)).splitlines()

    assert len(lines) == min(count, 10)
    assert lines[-1].startswith(f"::error title={title}::")


def test_the_expected_failure_is_named() -> None:
    """Another failure than the expected one says both; an expectation that was not met makes it so."""
    expect = Expectation(verdict=Verdict.BROKEN, phase=Phase.SINGLE, reason="known")
    made = document.build(
        [quick_record(combination("3.11", "1.2.3", "3.3.7", expect), tried("ppfp"))],
        [replace(quick()[0], cells=(combination("3.11", "1.2.3", "3.3.7", expect),))],
        MACHINES,
        "2026-11-21T12:30:00Z",
    )

    told = github_annotations.github(made, ("unexpected", "stale")).splitlines()

    assert told == [
        "::error title=quick/py3.11_gymnasium-1.2.3_mujoco-3.3.7::partial in vector, where the matrix expects broken in"
        " single: ant vector",
        "::error title=expectation out of date::quick/py3.11_gymnasium-1.2.3_mujoco-3.3.7 does better than expected:"
        " partial instead of broken",
    ]


def test_several_machines_are_named() -> None:
    """The same cell red on two machines is named with each of them."""
    made = reds(1)
    twice = [msgspec.structs.replace(made.cells[0], machine=name) for name in ("one", "two")]
    made = msgspec.structs.replace(made, cells=tuple(twice), machines={"one": {}, "two": {}})

    assert "title=quick/0 on one and 1 more cell::" in github_annotations.github(made, ("unexpected",))


def test_there_are_annotations_exactly_when_the_report_fails() -> None:
    """Whatever is to fail, a red step has a reason on the page and a green one has none."""
    plan, _ = quick()
    infra = Step(phase=Phase.RESOLVE, outcome=Outcome.INFRA, decisive=RESET)
    unsure = record(of=planned(), resolve=infra, install=None)
    inconclusive = document.build([unsure], [replace(plan, cells=(unsure.cell,))], MACHINES, "2026-11-21T12:30:00Z")
    assert [cell.verdict for cell in inconclusive.cells] == [Verdict.INCONCLUSIVE]
    for whole in (quick_document(), inconclusive, *(_alone(quick_document(), at) for at in range(len(plan.cells)))):
        for fail_on in chain.from_iterable(combinations(ALL, count) for count in range(len(ALL) + 1)):
            failed = document.exit_code(whole, fail_on) != 0
            assert bool(github_annotations.github(whole, fail_on)) == failed, (
                fail_on,
                [cell.id for cell in whole.cells],
            )


def _alone(whole: Document, at: int) -> Document:
    return msgspec.structs.replace(whole, cells=(whole.cells[at],), stale=())


class TestSummary:
    def test_a_page_that_fits_is_whole(self) -> None:
        """Up to the limit not a byte is changed."""
        page = "é" * 10
        assert github_annotations.summary(page, 20) == page

    def test_a_long_page_is_cut_at_a_line(self) -> None:
        """A longer one ends with a whole line and a sentence that says so, within the limit."""
        page = "".join(f"| ünf {number} |\n" for number in range(200))

        cut = github_annotations.summary(page, 1000)

        assert len(cut.encode()) <= 1000
        kept, _, sentence = cut.partition("\n\n")
        assert page.startswith(kept + "\n")
        assert len(kept.encode()) > 850
        assert sentence == (
            "This page is cut off here, at the platform's limit; the whole one is in the uploaded report.\n"
        )


class TestReport:
    @pytest.fixture(autouse=True)
    def folder(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)
        Path("report.json").write_bytes(document.encode(quick_document()))

    def test_annotations(self, capsys: pytest.CaptureFixture[str]) -> None:
        """`report --format github` prints the annotations of what `--fail-on` names; the exit code is that of `run`."""
        assert main(["report", ".", "--format", "github", "--fail-on", "not_run"]) == 1
        assert capsys.readouterr().out == "::error title=quick/py3.13_gymnasium-1.2.3_mujoco-2.3.7::not run\n"

    def test_summary(self, capsys: pytest.CaptureFixture[str]) -> None:
        """`report --format github-summary` prints the page."""
        from harness.reports.tables import tables

        main(["report", ".", "--format", "github-summary"])
        assert capsys.readouterr().out == publishing.page(tables.report(quick_document()))
