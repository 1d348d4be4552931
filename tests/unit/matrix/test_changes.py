"""Single changes: which cells they make, what they replace, what they did, and which remedies they prove."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
import specimens
from builders import case, cell, document_of, make_knowledge, make_plan, matrix, phase, record, signature, step
from specimens import RESET, SOLVER, XML

from harness.matrix import changes, matrix_remedies, plan
from harness.matrix.signatures import Signature
from harness.model import Cell, CellRecord, Change, Expectation, Outcome, Phase, Plan, Question, Tried, Verdict, replace
from harness.model.errors import BadInput
from harness.model.report_types import Document
from harness.reports import document, publishing
from harness.reports.tables import change_effects, tables
from harness.reports.tables.table_types import Effect
from harness.standalone.failures import remedies

MATRIX = """
requirements = ["gymnasium[mujoco]"]
constraints = ["numpy<2"]
environment = { MUJOCO_GL = "egl" }
axes = { python = ["3.10", "3.11"], mujoco = ["2.3.7", "3.3.7"], GL = { variable = ["egl", ""] } }
cases = [{ env = "Ant-v5", api = "gymnasium" }]
"""
CHANGE = '[[change]]\nname = "old"\nreason = "before it broke"\n'
OLD = CHANGE + 'cells = "py3.11_mujoco-3.3.7_egl"\nrequirements = ["mujoco<3"]\n'


def planned(text: str, known: tuple[Signature, ...] = ()) -> Plan:
    """Return the plan of a matrix called demo."""
    return make_plan(matrix_remedies.fill(matrix(MATRIX + text), known))


def changed(text: str, known: tuple[Signature, ...] = ()) -> dict[str, Cell]:
    """Return the changed cells of a matrix, by label."""
    return {cell.label: cell for cell in planned(text, known).cells if cell.base}


def refused(text: str, known: tuple[Signature, ...] = ()) -> str:
    """Return the message with which a matrix is refused."""
    with pytest.raises(BadInput) as told:
        planned(text, known)
    return str(told.value)


class TestCells:
    """The cells that a matrix with changes plans."""

    def test_a_changed_cell_stands_behind_its_base(self) -> None:
        """It has the axes and cases of that, an id of its own, and tells what was tried and why."""
        found = planned(OLD + 'advice = true\nlink = "https://example.org/1"\nsystem = ["libgl1"]').cells
        place = [cell.label for cell in found].index("py3.11_mujoco-3.3.7_egl_with-old")
        base, made = found[place - 1], found[place]
        assert len(found) == 8 + 1
        assert (made.base, made.axes, made.python) == (base.id, base.axes, "3.11")
        assert made.cases is base.cases
        assert made.question.requirements == ("gymnasium[mujoco]", "mujoco<3")
        assert made.system == ("libgl1",)
        assert made.tried == Tried(
            name="old",
            reason="before it broke",
            change=Change(requirements=("mujoco<3",)),
            also=("system `libgl1`",),
            advice=True,
            link="https://example.org/1",
        )

    def test_cells_are_chosen_by_glob_and_by_when(self) -> None:
        """Both have to fit; what was chosen by a strategy or left out has no changes."""
        text = CHANGE + 'cells = "*-egl"\nwhen = { mujoco = ">=3", python = "3.10" }\npython = "3.12"\n'
        assert list(changed(text)) == ["py3.10_mujoco-3.3.7_egl_with-old-on-py3.12"]
        assert changed(text)["py3.10_mujoco-3.3.7_egl_with-old-on-py3.12"].python == "3.12"
        gone = '[[exclude]]\nwhen = { mujoco = ">=3" }\nreason = "none"\n'
        assert planned(text + gone).stale == ('demo.toml: change[0] ("old") matches no cell',)

    def test_a_variable_of_an_axis_gives_way(self) -> None:
        """A change wins over whatever the matrix, a value or a variable axis says."""
        text = CHANGE + 'cells = "py3.11_mujoco-3.3.7_egl"\nenvironment = { GL = "osmesa", MUJOCO_GL = "" }\n'
        (made,) = changed(text).values()
        assert made.environment == {"MUJOCO_GL": "", "GL": "osmesa"}

    def test_a_change_that_leaves_a_cell_as_it_is_is_left_out(self) -> None:
        """A change without effect is listed as left out, with the reason."""
        text = CHANGE + 'cells = "py3.11_mujoco-3.3.7_*"\nenvironment = { GL = "egl" }\n'
        found = planned(text)
        assert [cell.label for cell in found.cells if cell.base] == ["py3.11_mujoco-3.3.7_unset_with-old"]
        assert [(gone.id, gone.reason) for gone in found.dropped] == [
            ("demo/py3.11_mujoco-3.3.7_egl_with-old", "the change leaves the cell as it is")
        ]

    def test_a_changed_cell_has_its_own_expectation(self) -> None:
        """Its own expectation, else to work; those of other cells do not hold, unless their glob says `_with-`."""
        other = '[[expect]]\nwhen = { mujoco = ">=3" }\nverdict = "broken"\nreason = "all of them"\n'
        broad = '[[expect]]\ncells = "*"\nverdict = "broken"\nreason = "everything"\n'
        (made,) = changed(other + broad + OLD).values()
        assert made.expect is None
        own = OLD + 'expect = { verdict = "partial", phase = "render", match = "x" }\n'
        (made,) = changed(other + broad + own).values()
        assert made.expect
        told = (made.expect.verdict, made.expect.reason, made.expect.phase, made.expect.match)
        assert told == (Verdict.PARTIAL, "before it broke", Phase.RENDER, "x")
        named = '[[expect]]\ncells = "*_with-old"\nverdict = "broken"\nreason = "named"\n'
        (made,) = changed(named + own).values()
        assert made.expect
        assert made.expect.reason == "named"
        assert planned(named + own).stale == ()

    @pytest.mark.parametrize(
        ("text", "sentence"),
        [
            (CHANGE + 'python = "3.9"', 'change[0]: say which cells: a glob as "cells", or a "when"'),
            (CHANGE + 'cells = "*"', "change[0]: it changes nothing; say what, such as requirements, environment or"),
            (OLD + 'python = "new"', 'change[0].python: "new" is not a version; ids name resolved versions only'),
            (OLD + "exspect = {}", 'change[0].exspect: unknown key; did you mean "expect"?'),
            (OLD + 'when = { mujocco = ">=3" }', 'change[0].when.mujocco: there is no such axis; did you mean'),
            (OLD + 'extras = ["x"]', "change[0].extras: there is no package under test to have it"),
            (OLD + 'expect = { verdict = "not_run" }', 'change[0].expect: "not_run" does not test packages'),
            (OLD + 'expect = { verdict = "broken", phase = "suite" }', 'change[0].expect: no cell goes through'),
            (OLD + OLD, 'change[1]: another change of demo/py3.11_mujoco-3.3.7_egl is called "old", too'),
            (OLD + 'overlay = ["gim"]', 'change[0]: no recipe repairs "gim"'),
            (OLD + 'remedy_of = "x"', 'change[0]: it is the remedy of "x", and cannot change "requirements" besides'),
            (CHANGE + 'cells = "*"\nremedy_of = "x"', 'change[0].remedy_of: no signature is called "x"'),
            (OLD + 'expect = { signature = "x" }', 'change[0].expect.signature: no signature is called "x"'),
        ],
    )  # fmt: skip
    def test_mistakes(self, text: str, sentence: str) -> None:
        """Each mistake is reported with its place in the file."""
        assert refused(text).startswith(f"demo.toml: {sentence}")

    def test_changes_are_tried_on_what_a_strategy_chose(self) -> None:
        """A combination that it leaves out has no changes either."""
        text = 'strategy = "baseline"\n'
        read = matrix(text + MATRIX + CHANGE + 'cells = "*"\npython = "3.12"\n')
        found = plan.make_plan(plan.Sources(matrix=read, host_python="3.12.1")).cells
        bases = [cell.id for cell in found if not cell.base]
        assert 0 < len(bases) < 8
        assert [cell.base for cell in found if cell.base] == bases

    def test_a_strategy_is_made_from_the_same_with_changes(self) -> None:
        """They have no say in which combinations are chosen: a choice that was made stays good."""

        def made_from(text: str) -> str:
            read = matrix(MATRIX + text)
            return plan.candidates(plan.Sources(matrix=read, host_python="3.12.1")).made_from

        assert made_from(OLD) == made_from("")


def signature_with_remedy(name: str, **remedy: Any) -> Signature:
    """Return a known failure with this remedy."""
    return signature(name, remedy=remedy)


class TestRemedies:
    """Changes that are the fix of a known issue."""

    def test_it_does_what_the_remedy_says(self) -> None:
        """The change applies every part of the remedy, and has the words of the signature."""
        known = signature_with_remedy(
            "it",
            requirements=("mujoco<3",),
            constraints=("numpy<1.25",),
            environment={"A": "b"},
            python="3.10",
            text="or",
        )
        text = CHANGE + 'cells = "py3.11_mujoco-3.3.7_egl"\nremedy_of = "it"\n'
        (made,) = changed(text, (known,)).values()
        assert made.tried
        assert made.tried.change == known.remedy.change
        assert (made.question.constraints, made.python, made.environment["A"]) == (("numpy<1.25",), "3.10", "b")
        assert refused(text, (signature_with_remedy("it", text="buy a GPU"),)) == (
            'demo.toml: change[0].remedy_of: no machine can apply the remedy of "it": buy a GPU'
        )


# --- what is replaced ------------------------------------------------------------------------------------------

QUESTION = Question(
    requirements=("gymnasium[mujoco]", "gymnasium==0.29.1", "numpy==1.26.4"),
    constraints=("numpy<2", "scipy<2"),
    overrides=("numpy<1.27",),
    build_constraints=("setuptools<66",),
    build_variables={"A": "1"},
    only_binary=("mujoco",),
    absent=("gym",),
    snapshot="2026-11-20T23:59:59Z",
)


def changed_question(**change: Any) -> Question:
    """Return the question of a cell after a change."""
    return changes.apply(cell(question=QUESTION), Change(**change), {}).question


def test_a_requirement_replaces_every_line_about_its_package() -> None:
    """Requirements, constraints and overrides; extras stay, unless it has some of its own; the rest is as it was."""
    made = changed_question(requirements=("Gymnasium>=1", "numpy>=2"))
    assert made.requirements == ("Gymnasium[mujoco]>=1", "numpy>=2")
    assert (made.constraints, made.overrides) == (("scipy<2",), ())
    assert changed_question(requirements=("gymnasium[box2d]",)).requirements == ("numpy==1.26.4", "gymnasium[box2d]")
    assert changed_question(requirements=("gym==0.21.0",)).absent == ()
    same = replace(
        made, requirements=QUESTION.requirements, constraints=("numpy<2", "scipy<2"), overrides=("numpy<1.27",)
    )
    assert same == QUESTION


def test_bounds_replace_bounds_of_the_same_package() -> None:
    """A bound replaces the bound of the same package; requirements stay as they are."""
    made = changed_question(
        constraints=("numpy<1.24",), overrides=("numpy<1.25",), build_constraints=("setuptools<58", "wheel<1")
    )
    assert made.requirements == QUESTION.requirements
    assert (made.constraints, made.overrides) == (("scipy<2", "numpy<1.24"), ("numpy<1.25",))
    assert made.build_constraints == ("setuptools<58", "wheel<1")


def test_a_removed_package_is_required_by_nobody() -> None:
    """Neither by the cell nor by what it installs."""
    made = changed_question(uninstall=("numpy",))
    assert (made.requirements, made.constraints) == (QUESTION.requirements[:2], ("scipy<2",))
    assert (made.overrides, made.absent) == (("numpy ; python_version < '0'",), ("gym", "numpy"))


def test_the_rest_is_added() -> None:
    """Variables of builds and of the cell, wheels, instant, Python."""
    made = changed_question(build_variables={"B": "2"}, only_binary=("mujoco", "numpy"), as_of="2024-01-01T00:00:00Z")
    assert (made.build_variables, made.only_binary) == ({"A": "1", "B": "2"}, ("mujoco", "numpy"))
    assert made.snapshot == "2024-01-01T00:00:00Z"
    around = cell(environment={"A": "1"}, empty=("B", "C"))
    told = changes.apply(around, Change(environment={"B": "2"}, python="3.12"), {})
    assert (told.environment, told.empty, told.python) == ({"A": "1", "B": "2"}, ("C",), "3.12")


REPAIR = replace(specimens.REPAIR, name="gym", version="0.21.0", uploaded="2021-10-03T00:00:00Z")


def test_repairs_are_those_that_fit_what_is_asked_for_now() -> None:
    """A repair is in the question where its release may be chosen."""
    known = {"gym": (REPAIR,)}
    old, new = (
        changes.apply(cell(question=QUESTION), Change(overlay=("gym",), requirements=(line,)), known)
        for line in ("gym==0.21.0", "gym>=0.26")
    )
    assert (old.question.overlay, new.question.overlay) == ((REPAIR,), ())
    assert changes.produces(cell(question=QUESTION), Change(overlay=("gym",), requirements=("gym==0.21.0",)), old)
    assert not changes.produces(cell(question=QUESTION), Change(requirements=("gym==0.21.0",)), old)


@pytest.mark.parametrize(
    ("change", "is_it"),
    [
        (Change(requirements=("numpy<2", "mujoco<3")), True),
        (Change(requirements=("mujoco<3", "numpy<2")), True),
        (Change(requirements=("mujoco<3",)), False),
        (Change(requirements=("numpy<2", "mujoco<3.1")), False),
        (Change(requirements=("numpy<2", "mujoco<3"), environment={"A": "b"}), False),
        (Change(requirements=("numpy<2", "mujoco<3"), python="3.12"), False),
    ],
)
def test_a_change_is_a_remedy_if_it_comes_to_the_same(change: Change, is_it: bool) -> None:
    """A change is the remedy if it asks for the same, in any order, and nothing besides."""
    base = cell(question=QUESTION)
    other = changes.apply(base, Change(requirements=("numpy<2", "mujoco<3")), {})
    assert changes.produces(base, change, replace(other, id="quick/x", base=base.id)) is is_it


def test_a_change_that_does_nothing_is_no_remedy() -> None:
    """A remedy that a cell already has proves nothing."""
    base = cell(python="3.11")
    assert not changes.produces(base, Change(python="3.11"), base)


def test_a_change_in_words() -> None:
    """Each part of a change has its words; a remedy adds advice that no machine can follow."""
    told = changes.describe(
        Change(
            requirements=("a<2", "b"),
            overrides=("c<3",),
            uninstall=("d",),
            environment={"E": "1", "F": ""},
            python="3.10",
            as_of="2024-01-01T00:00:00Z",
        )
    )
    assert told == (
        "install `a<2`, `b`", "override `c<3`", "uninstall `d`", "set `E=1`", "unset `F`", "Python 3.10",
        "resolved as of 2024-01-01T00:00:00Z",
    )  # fmt: skip
    assert remedies.in_words({"build_constraints": ["x<1"], "text": "Or wait."}) == "build with `x<1`. Or wait."
    assert remedies.in_words({"text": "Wait."}) == "Wait."


# --- what came of it -------------------------------------------------------------------------------------------

KNOWN = (
    msgspec.structs.replace(signature_with_remedy("solver", requirements=("mujoco<3",)), phases=(Phase.RENDER,)),
    signature_with_remedy("words", text="nobody can do this"),
)
BASE = cell(question=Question(requirements=("gymnasium==0.29.1", "mujoco==3.3.7")))
SOLVED = case("pppf", render=phase(Phase.RENDER, Outcome.FAILED, SOLVER))


def changed_cell(name: str, change: Change) -> Cell:
    """Return the base cell with a change applied."""
    made = changes.apply(BASE, change, {})
    return replace(made, id=f"{BASE.id}_with-{name}", base=BASE.id, tried=Tried(name=name, reason="why", change=change))


CURE = changed_cell("cure", Change(requirements=("mujoco<3",)))
OTHER = changed_cell("other", Change(requirements=("mujoco<2",)))


def report_of(*records: CellRecord) -> Document:
    """Return a document of these cells, judged with the failures known above."""
    return document_of(*records, knowledge=make_knowledge(*KNOWN), axes=tuple(records[0].cell.axes))


def proofs(whole: Document) -> list[tuple[str, bool, str | None]]:
    """Return each signature of the first cell, whether its remedy is proven, and by which cell."""
    return [(one.signature, one.proven, one.proof) for one in whole.cells[0].diagnoses]


RED, GREEN = record(SOLVED, of=BASE), record(case("pppp"), of=CURE)


class TestProof:
    """A remedy is proven by the cell that it makes of this one, measured here, and working."""

    def test_it_works(self) -> None:
        """The change says whose remedy it is, the diagnosis which cell is its proof."""
        whole = report_of(RED, GREEN)
        assert whole.cells[1].change
        assert whole.cells[1].change.remedy_of == ("solver",)
        assert proofs(whole) == [("solver", True, CURE.id), ("words", False, None)]

    @pytest.mark.parametrize(
        "other",
        [
            pytest.param(record(SOLVED, of=CURE), id="it does not work"),
            pytest.param(record(case("pppp"), of=OTHER), id="another change"),
            pytest.param(record(case("pppp"), of=CURE, machine="elsewhere"), id="another machine"),
            pytest.param(record(case("ppps"), of=replace(CURE, base="quick/another")), id="another cell"),
        ],
    )
    def test_it_is_not(self, other: CellRecord) -> None:
        """A cell that fails, or is of another change, machine or base, proves nothing."""
        assert [proven for _, proven, _ in proofs(report_of(RED, other))] == [False, False]

    def test_shards_prove_together(self) -> None:
        """The base was measured in one, the changed cell in another, whose plan has both."""
        whole = report_of(RED, GREEN)
        parts = [
            msgspec.structs.replace(report_of(RED), cells=report_of(RED).cells),
            msgspec.structs.replace(whole, cells=(whole.cells[1],)),
        ]
        assert proofs(parts[0])[0] == ("solver", False, None)
        assert proofs(document.combine(parts))[0] == ("solver", True, CURE.id)
        assert proofs(document.combine([whole, parts[0]]))[0] == ("solver", True, CURE.id)


XML_RED = case("ppfp", vector=phase(Phase.VECTOR, Outcome.FAILED, XML, masked_by=RESET))
UNRESOLVED = record(resolve=step(Phase.RESOLVE, Outcome.FAILED, "no numpy"), install=None, installed=None, of=BASE)


@pytest.mark.parametrize(
    ("before", "after", "effect"),
    [
        pytest.param(RED, GREEN, Effect.CURES, id="works then"),
        pytest.param(GREEN, RED, Effect.BREAKS, id="worked before"),
        pytest.param(GREEN, GREEN, Effect.NOTHING, id="works as before"),
        pytest.param(RED, RED, Effect.NOTHING, id="the same line"),
        pytest.param(record(XML_RED), RED, Effect.UNCOVERS, id="fails later"),
        pytest.param(RED, record(XML_RED), Effect.BREAKS, id="fails earlier"),
        pytest.param(RED, UNRESOLVED, Effect.BREAKS, id="does not resolve any more"),
        pytest.param(UNRESOLVED, RED, Effect.UNCOVERS, id="resolves now"),
        pytest.param(RED, record(of=BASE, cases=(), resolve=None, install=None), Effect.UNTOLD, id="not run"),
        pytest.param(record(case("pppi")), GREEN, Effect.UNTOLD, id="nothing was known"),
        pytest.param(record(case("ppff")), record(case("pppf")), Effect.PARTLY, id="one check less fails"),
        pytest.param(record(case("pppf")), record(case("pffn")), Effect.BREAKS, id="the loop fails now"),
        pytest.param(record(case("ppfp")), record(case("ppff")), Effect.BREAKS, id="one check more fails"),
    ],
)
def test_the_effect_of_a_change(before: CellRecord, after: CellRecord, effect: Effect) -> None:
    """The effect follows from the verdict, then the failing checks, then cause or line, then the phase."""
    assert change_effects.effect(report_of(before).cells[0], report_of(after).cells[0]) is effect


@pytest.mark.parametrize(
    ("line", "effect"),
    [
        ("TypeError: in step, gym/core.py line 12, mujoco 3.1.6", Effect.NOTHING),
        ("TypeError: in step, gym/core.py line 99, mujoco 3.3.7", Effect.NOTHING),
        ("TypeError: in reset, gym/core.py line 12, mujoco 3.1.6", Effect.UNCOVERS),
    ],
)
def test_lines_are_the_same_but_for_versions_and_places(line: str, effect: Effect) -> None:
    """Without a known failure, two lines are the same if only versions and line numbers differ."""
    lines = ("TypeError: in step, gym/core.py line 12, mujoco 3.1.6", line)
    before, after = (record(case("pppf", render=phase(Phase.RENDER, Outcome.FAILED, each))) for each in lines)
    assert change_effects.effect(report_of(before).cells[0], report_of(after).cells[0]) is effect


def test_the_same_cause_in_other_words_is_no_difference() -> None:
    """A known failure tells better than its line."""
    before, after = (
        record(case("pppf", render=phase(Phase.RENDER, Outcome.FAILED, f"{word} solver_iter"))) for word in ("a", "b")
    )
    assert change_effects.effect(report_of(before).cells[0], report_of(after).cells[0]) is Effect.NOTHING


# --- how it is shown -------------------------------------------------------------------------------------------


def test_the_page_shows_before_after_and_proof() -> None:
    """The cause with its remedy and what proves it; the changes in a table; none of them in the small table."""
    other = record(SOLVED, of=OTHER)
    whole = report_of(RED, replace(GREEN, lock="locks/1.txt"), other)
    sheet = tables.report(whole).sheets[0]
    (trouble,) = sheet.troubles
    assert [(one.signature, one.remedy, one.proofs) for one in trouble.explanations[0].causes] == [
        ("solver", "install `mujoco<3`", (("py3.11_gymnasium-1.2.3_with-cure", "locks/1.txt"),)),
        ("words", "nobody can do this", ()),
    ]
    page = publishing.page(tables.report(whole))
    line = f"partial in render: {SOLVER}"
    assert f"\n### `py3.11_gymnasium-1.2.3`\n\n    {line}\n\n| effect |" in page
    assert "| **fixes it** | cure: install `mujoco<3` | why | `works` |" in page
    assert f"| **no difference** | other: install `mujoco<2` | why | `{line}` |" in page
    cells = "`py3.11_gymnasium-1.2.3`, `py3.11_gymnasium-1.2.3_with-other`"
    assert f"### `solver`\n\n**{cells}: ◐ partial in render.**\n\nBecause.\n\n    {SOLVER}\n\n" in page
    assert (
        "**Fix** (proven by `py3.11_gymnasium-1.2.3_with-cure`, for 1 of 2): Install `mujoco<3`.\n\n"
        "```sh\npip install 'mujoco<3'\n```\n\n"
        "- Proven: `py3.11_gymnasium-1.2.3_with-cure` works, with the lock [locks/1.txt](locks/1.txt)\n"
    ) in page
    assert "\n- `words` fits some of them, too: " in page
    assert "Fix: Nobody can do this." in page


def test_changed_cells_are_not_in_the_small_table() -> None:
    """They have the axes of their bases, and would change what those squares say."""
    axes = {"python": "3.11", "mujoco": "3.3.7"}
    two = replace(BASE, id="quick/two", axes={"python": "3.10", "mujoco": "2.3.7"})
    records = [record(SOLVED, of=replace(BASE, axes=axes)), record(case("pppp"), of=replace(CURE, axes=axes))]
    records.append(record(case("pppp"), of=two))
    pivot = tables.report(report_of(*records)).sheets[0].pivot
    assert pivot
    squares = [square for row in pivot.squares for square in row for square in square]
    assert sorted((square.verdict, square.passed, square.tried, square.fixed) for square in squares) == [
        (Verdict.PARTIAL, 0, 1, True), (Verdict.WORKS, 1, 1, False),
    ]  # fmt: skip


def test_an_expected_change_needs_no_explanation() -> None:
    """It has its row among the changes; one that is not as expected is explained."""
    red = record(SOLVED, of=OTHER)
    sheet = tables.report(report_of(RED, red)).sheets[0]
    assert [why.cells for one in sheet.troubles for why in one.explanations] == [
        ("py3.11_gymnasium-1.2.3", "py3.11_gymnasium-1.2.3_with-other"),
    ]  # fmt: skip
    foreseen = replace(OTHER, expect=Expectation(verdict=Verdict.PARTIAL, reason="known"))
    sheet = tables.report(report_of(RED, record(SOLVED, of=foreseen))).sheets[0]
    assert [why.cells for one in sheet.troubles for why in one.explanations] == [("py3.11_gymnasium-1.2.3",)]
