"""Parts of the site: addresses, excuses, the nearest cell that works, titles, similar issues, streaks."""

from __future__ import annotations

import re

import pytest
from builders import measured_case, measured_cell
from msgspec.structs import replace
from specimens import quick_document

from harness.model import Verdict
from harness.model.measured import Measured
from harness.model.report_types import CellEntry, DiagnosisEntry
from harness.reports.site import addresses, excuses, issue_page, package_page
from harness.reports.site.page_writer import link, prose
from harness.reports.site.site_facts import SiteFacts
from harness.running.signatures import shipped_signatures

CELLS = quick_document().cells
PARTIAL = CELLS[1]
"""gymnasium 0.29.1 with mujoco 3.3.7 on Python 3.9."""


# --- addresses and text ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["py3.11_gymnasium-1.2.3", "Ant-v5", "mujoco"])
def test_a_plain_name_is_its_own_address(text: str) -> None:
    """People can type it."""
    assert addresses.name_for(text) == text


@pytest.mark.parametrize(
    "text", ["..", ".", "", "a/b", "dm_control:cheetah/run", "é", "x" * 500, "a b", "<b>", "\udcff"]
)
def test_any_other_name_gets_a_plain_address(text: str) -> None:
    """It is the name of one file on every system, and no two names share it."""
    assert re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9.-]{0,119}", addresses.name_for(text))
    assert addresses.name_for(text) != addresses.name_for(f"{text}!")


def test_code_and_links_are_escaped() -> None:
    """Only what stands between backticks becomes code, and only web addresses become links."""
    assert prose("take `numpy<2` & <b>") == "take <code>numpy&lt;2</code> &amp; &lt;b&gt;"
    assert link("javascript:alert(1)") == "<code>javascript:alert(1)</code>"
    assert link("https://github.com/a/b/issues/3").endswith(">a/b#3</a>")


# --- excuses ---------------------------------------------------------------------------------------------------


def diagnosed(cell: CellEntry, proof: str | None = None, **remedy: object) -> CellEntry:
    """Return a cell with a known issue as its cause."""
    cause = DiagnosisEntry(
        signature="numpy124-aliases-of-builtins", cause="c", remedy=dict(remedy), proven=bool(proof), masks=False,
        references=("https://example.org/1",), seen=str(cell.decisive), proof=proof,
    )  # fmt: skip
    return replace(cell, diagnoses=(cause,))


def test_a_cell_that_works_needs_no_excuse() -> None:
    """One with an open doubt says which check would settle it."""
    assert excuses.excuses(CELLS[0], None, {}) == []
    doubted = replace(CELLS[0], unverified=("silent:quiet-one",))
    assert ["`quiet-one`" in one.text for one in excuses.excuses(doubted, None, {})] == [True]


def test_excuses_say_who_can_do_what() -> None:
    """You, by the fix and whether it was measured; the maintainers, by a new release; you, by the nearest cell."""
    signatures = {str(one.id): one for one in shipped_signatures.load_all()}
    near = excuses.nearest(PARTIAL, CELLS)
    fixed = diagnosed(PARTIAL, requirements=["mujoco<3"], text="or wait")
    texts = [f"{one.who}: {one.text}" for one in excuses.excuses(fixed, near, signatures)]
    assert texts == [
        "You: Install `mujoco<3`. Nobody has measured this fix here yet.",
        "You: Or wait.",
        "The maintainers of numpy: A new release without this cause gets a square of its own. This square keeps its "
        "versions, and so it stays red. They can start from the references above.",
        "You: Take the nearest combination that works: mujoco 2.3.7.",
    ]
    proven = diagnosed(PARTIAL, proof="quick/other", requirements=["mujoco<3"])
    first = excuses.excuses(proven, near, signatures)[0]
    assert (first.text, first.proof) == ("Install `mujoco<3`. This was measured, and works.", "quick/other")


@pytest.mark.parametrize(
    ("verdict", "who"),
    [
        (Verdict.UNAVAILABLE, "Somebody with another machine"),
        (Verdict.INCONCLUSIVE, "Anyone who runs it again"),
        (Verdict.BROKEN, "Anyone"),
    ],
)
def test_excuses_without_a_cause(verdict: Verdict, who: str) -> None:
    """A result that is no statement on packages has to be measured elsewhere; an unknown cause has to be found."""
    cell = replace(PARTIAL, verdict=verdict, diagnoses=())
    assert [one.who for one in excuses.excuses(cell, None, {})] == [who]


def test_the_nearest_cell_differs_least() -> None:
    """It works without a doubt, and differs in one axis rather than in two."""
    near = excuses.nearest(PARTIAL, CELLS)
    assert near
    assert near.cell.id == CELLS[0].id
    assert near.differs == {"mujoco": ("3.3.7", "2.3.7")}
    doubted = tuple(replace(one, unverified=("silent:x",)) for one in CELLS)
    assert excuses.nearest(PARTIAL, doubted) is None


# --- known issues ----------------------------------------------------------------------------------------------


def test_titles_are_lines_of_the_examples() -> None:
    """Every title is a line of the first example, word for word, and none is empty."""
    for signature in (one for one in shipped_signatures.load_all() if one.examples):
        title = issue_page.title(signature)
        assert title.strip()
        assert title.removesuffix("…") in signature.examples[0]


def test_similar_issues() -> None:
    """No issue is similar to itself, and the two on what gym's metadata asks for are similar to each other."""
    similar = issue_page.alike({str(one.id): one for one in shipped_signatures.load_all()})
    assert not [name for name, others in similar.items() if name in others]
    assert "gym021-wheel-invalid-requirement" in similar["gym021-extras-require-setuptools"]


# --- families --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("row", "links"),
    [
        ("Ant-v4, v5", [("Ant-v4", "Ant-v4"), ("v5", "Ant-v5")]),
        ("Ant-v4", [("Ant-v4", "Ant-v4")]),
        ("dm_control:cheetah/run", [("dm_control:cheetah/run", "dm_control:cheetah/run")]),
        ("odd, name", [("odd, name", "odd, name")]),
    ],
)
def test_each_environment_of_a_row_is_a_link(row: str, links: list[tuple[str, str]]) -> None:
    """Versions of an environment that behave alike share a row; each of them leads to its own page."""
    named = facts(("works", "3.8.0", "2")).environment_links(row)
    assert [(text, name) for text, name, _ in named] == links


# --- streaks ---------------------------------------------------------------------------------------------------


def facts(*cells: tuple[str, str, str]) -> SiteFacts:
    """Return facts on cells of (verdict, version of mujoco, version of numpy)."""
    locks = {f"lock{place}": (("mujoco", mujoco), ("numpy", numpy)) for place, (_, mujoco, numpy) in enumerate(cells)}
    measured = tuple(
        measured_cell(
            f"cell{place}", verdict, axes={"mujoco": mujoco}, lock=f"lock{place}", requirements=["mujoco"],
            cases=[measured_case(exercised=["mujoco"])],
        )
        for place, (verdict, mujoco, _) in enumerate(cells)
    )  # fmt: skip
    hashes = {f"{name}=={version}": () for pins in locks.values() for name, version in pins}
    results = Measured(generated="", machines={}, cells=measured, locks=locks, hashes=hashes, taken={})
    return SiteFacts(sources=(), measured=results, signatures={}, issues=())


def test_a_red_streak_says_since_when_and_what_moved() -> None:
    """The newest releases are red; the two cells at the turn differ in two packages."""
    known = facts(("works", "3.8.0", "2.2"), ("works", "3.9.0", "2.2"), ("broken", "3.10.0", "2.3"),
                  ("broken", "3.11.0", "2.3"))  # fmt: skip
    streak = package_page.streak(package_page.releases(known, "mujoco"))
    assert streak
    assert (streak.works, streak.since, streak.length, streak.before) == (False, "3.10.0", 2, "3.9.0")
    assert streak.cells == ("m/cell1", "m/cell2")
    assert streak.moved == {"mujoco": ("3.9.0", "3.10.0"), "numpy": ("2.2", "2.3")}


def test_a_streak_without_a_turn() -> None:
    """All releases work: the streak begins with the first."""
    streak = package_page.streak(
        package_page.releases(facts(("works", "3.8.0", "2"), ("works", "3.9.0", "2")), "mujoco")
    )
    assert streak
    assert (streak.works, streak.since, streak.length, streak.cells) == (True, "3.8.0", 2, ("", ""))
    assert package_page.streak([]) is None


def test_inferred_releases_lie_between_two_that_work() -> None:
    """A release is inferred only where nothing was measured and both neighbours work."""
    known = facts(("works", "3.8.0", "2"), ("works", "3.9.0", "2"), ("broken", "3.10.0", "2"))
    measured = package_page.releases(known, "mujoco")
    published = dict.fromkeys(["3.7.0", "3.8.0", "3.8.1", "3.9.0", "3.9.1", "3.10.0"], "")
    assert package_page.inferred(known, "mujoco", measured, published) == ["3.8.1"]
