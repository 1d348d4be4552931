"""Strategies: which combinations are planned, what is left out for which reason, and what a choice is made from."""

import json
from collections.abc import Callable, Sequence
from itertools import combinations

import msgspec
import pytest
from builders import CASE, make_plan, matrix
from packaging.version import Version

from harness.matrix import plan, version_ranges
from harness.matrix.matrix_types import Chosen, Expansion, Unresolvable
from harness.matrix.version_ranges import Breaks
from harness.model import Cell, Dropped, Plan, Question
from harness.model.errors import BadInput, CouldNotTell

THREE = """
[axes]
python = ["3.10", "3.11", "3.12"]
gymnasium = ["0.29.1", "1.0.0", "1.2.3"]
mujoco = ["2.3.7", "3.0.0", "3.3.7"]
"""
BREAKS: Breaks = {"mujoco": (Version("3.0.0"), Version("3.2.0"))}
INSTANT = "2026-11-20T23:59:59Z"

Resolves = Callable[[str, Question], str | None]


def planned(text: str, chosen: Expansion | None = None, breaks: Breaks = BREAKS) -> Plan:
    """Return the plan of a matrix called demo."""
    return make_plan(text, expansion=chosen, breaks=breaks)


def labels(text: str, chosen: Expansion | None = None) -> list[str]:
    """Return the labels of the cells, in order."""
    return [cell.label for cell in planned(text, chosen).cells]


def refused(text: str, chosen: Expansion | None = None) -> str:
    """Return the message with which planning a matrix is refused."""
    with pytest.raises(BadInput) as error:
        planned(text, chosen)
    return str(error.value)


class Resolver:
    """Answers questions by a rule, and remembers them."""

    def __init__(self, rule: Resolves = lambda python, question: None) -> None:
        self.rule = rule
        self.asked: list[tuple[str, tuple[str, ...]]] = []

    def __call__(self, cells: Sequence[Cell]) -> list[str | None]:
        """Answer each question."""
        self.asked += [(cell.python, cell.question.requirements) for cell in cells]
        return [self.rule(cell.python, cell.question) for cell in cells]


def chosen(text: str, resolver: Resolver | None = None) -> Expansion:
    """Return the expansion of a matrix with its covering array."""
    read = matrix(text)
    made = version_ranges.expand(read, {}, INSTANT)
    known = plan.candidates(plan.Sources(matrix=read, expansion=made, host_python="3.12.1", breaks=BREAKS))
    return msgspec.structs.replace(made, chosen=plan.choose(known, resolver or Resolver(), lambda _: None))


def pairs(text: str, made: Expansion) -> set[frozenset[tuple[str, str]]]:
    """Return the pairs of axis values that some cell has."""
    return {
        frozenset(pair) for cell in planned(text, made).cells for pair in combinations(sorted(cell.axes.items()), 2)
    }


class TestReading:
    @pytest.mark.parametrize(
        ("written", "names"),
        [
            ('"full"', ()),
            ('"pairwise"', ("pairwise",)),
            ('"listed"', ("listed",)),
            ("{ ways = 3 }", ("3-way",)),
            ('["boundaries", "baseline"]', ("baseline", "boundaries")),
            ('["pairwise", { baseline = { python = "3.11" } }, { ways = 3 }]', ("baseline", "3-way")),
            ('{ ways = 2, baseline = { python = "3.11" } }', ("baseline", "pairwise")),
        ],
    )
    def test_a_name_a_table_or_several(self, written: str, names: tuple[str, ...]) -> None:
        """A list is the union of its members, and so is a table that names more than one thing."""
        assert matrix(f"strategy = {written}\n{THREE}{CASE}").strategy.names == names

    @pytest.mark.parametrize(
        ("written", "sentence"),
        [
            ('"pairwize"', 'strategy: unknown value "pairwize"; did you mean "pairwise"?'),
            ('["pairwise", "boundary"]', 'strategy[1]: unknown value "boundary"; did you mean "boundaries"?'),
            ("{ way = 2 }", 'strategy.way: unknown key; did you mean "ways"?'),
            ("{ ways = 0 }", "strategy.ways: expected an integer >= 1"),
            ("[]", "strategy: expected a list that is not empty"),
            ("{}", 'strategy: an empty table is no strategy; write "ways" or "baseline"'),
            (
                '{ baseline = { pyton = "3.11" } }',
                'strategy.baseline.pyton: there is no such axis; did you mean "python"?',
            ),
            (
                '{ baseline = { mujoco = "3.x" } }',
                'strategy.baseline.mujoco: "3.x" is not a version; ids name resolved versions only',
            ),
        ],
    )
    def test_mistakes(self, written: str, sentence: str) -> None:
        """A mistake in a strategy is refused with its place."""
        with pytest.raises(BadInput) as error:
            matrix(f"strategy = {written}\n{THREE}{CASE}")

        assert str(error.value) == f"demo.toml: {sentence}"


class TestBaseline:
    def test_one_axis_varied_at_a_time(self) -> None:
        """Cells differ from the baseline in at most one axis; what is left out is one line."""
        text = f'strategy = {{ baseline = {{ python = "3.11", mujoco = "3.0.0" }} }}\n{THREE}{CASE}'

        assert labels(text) == [
            "py3.10_gymnasium-1.2.3_mujoco-3.0.0",
            "py3.11_gymnasium-0.29.1_mujoco-3.0.0",
            "py3.11_gymnasium-1.0.0_mujoco-3.0.0",
            "py3.11_gymnasium-1.2.3_mujoco-2.3.7",
            "py3.11_gymnasium-1.2.3_mujoco-3.0.0",
            "py3.11_gymnasium-1.2.3_mujoco-3.3.7",
            "py3.12_gymnasium-1.2.3_mujoco-3.0.0",
        ]
        assert planned(text).dropped == (Dropped(id="demo/*", reason="not chosen by baseline", count=20),)

    def test_without_values_the_newest_version_and_the_first_name(self) -> None:
        """Versions are compared as versions, wherever they stand; `absent` is none; names have no age."""
        text = (
            'strategy = "baseline"\naxes = { python = ["3.10", "3.9"], gymnasium = ["1.10.0", "1.9.0", "absent"], '
            'api = { old = {}, new = {} }, GL = { variable = ["egl", ""] } }\n' + CASE
        )

        assert labels(text) == [
            "py3.10_gymnasium-1.10.0_old_egl",
            "py3.10_gymnasium-1.10.0_old_unset",
            "py3.10_gymnasium-1.10.0_new_egl",
            "py3.10_gymnasium-1.9.0_old_egl",
            "py3.10_gymnasium-absent_old_egl",
            "py3.9_gymnasium-1.10.0_old_egl",
        ]

    def test_two_baselines(self) -> None:
        """The cells of both baselines are planned, each once."""
        text = 'strategy = ["baseline", { baseline = { python = "3.10" } }]\n' + THREE + CASE

        assert len(labels(text)) == 11

    def test_exclusions_are_honoured(self) -> None:
        """An excluded combination keeps its own reason and is not counted with the others."""
        text = (
            f'strategy = "baseline"\n{THREE}{CASE}[[exclude]]\nwhen = {{ python = "3.10", gymnasium = ">=1.2" }}\n'
            'reason = "not supported"'
        )
        dropped = planned(text).dropped

        assert "py3.10_gymnasium-1.2.3_mujoco-3.3.7" not in labels(text)
        assert [gone.reason for gone in dropped] == ["not supported"] * 3 + ["not chosen by baseline"]
        assert len(labels(text)) + sum(gone.count for gone in dropped) == 27

    def test_a_baseline_that_is_left_out_is_refused(self) -> None:
        """Nothing can be varied around a combination that is not run."""
        text = f'strategy = "baseline"\n{THREE}{CASE}[[exclude]]\nwhen = {{ python = "3.12" }}\nreason = "too new"'

        assert refused(text) == (
            'demo.toml: strategy: the baseline "py3.12_gymnasium-1.2.3_mujoco-3.3.7" is left out (too new); '
            "name another: { baseline = { ... } }"
        )

    def test_a_value_that_the_axis_does_not_have_is_refused(self) -> None:
        """A baseline is one of the combinations."""
        text = f'strategy = {{ baseline = {{ mujoco = "3.3.6" }} }}\n{THREE}{CASE}'

        assert refused(text) == (
            'demo.toml: strategy.baseline.mujoco: the axis has no value "3.3.6"; did you mean "3.3.7"?'
        )

    def test_cases_of_the_baseline_alone(self) -> None:
        """A case with `only` exists in the cells of the baseline, whatever other strategy chose further cells."""
        text = f'strategy = ["baseline", "boundaries"]\n{THREE}{CASE}[[cases]]\nenv = "Ant-v5"\n'
        text += 'api = "gymnasium"\nonly = "baseline"'
        cells = {cell.label: [case.id for case in cell.cases] for cell in planned(text).cells}

        assert len(cells) == 27
        assert cells["py3.12_gymnasium-1.2.3_mujoco-2.3.7"] == ["CartPole-v1", "Ant-v5"]
        assert sum(len(cases) == 2 for cases in cells.values()) == 7

    def test_cases_of_a_baseline_that_there_is_not(self) -> None:
        """`only = "baseline"` without that strategy is a mistake."""
        text = f'{THREE}{CASE}only = "baseline"'

        assert refused(text) == (
            'demo.toml: cases[0].only: the strategy has no baseline; write strategy = "baseline", or a list with it'
        )


class TestBoundaries:
    TEXT = (
        'strategy = "boundaries"\n[axes]\npython = ["3.11"]\n'
        'mujoco = ["2.3.6", "2.3.7", "3.0.0", "3.0.1", "3.1.0", "3.1.5", "3.1.6", "3.2.0", "3.2.1", "3.2.7"]\n' + CASE
    )

    def test_newest_patches_and_both_sides_of_each_break(self) -> None:
        """2.3.7 and 3.0.0 stand at a break, 3.1.6 and 3.2.0 at another; 3.0.1 and 3.2.7 are newest patches."""
        assert labels(self.TEXT) == [
            f"py3.11_mujoco-{version}" for version in ("2.3.7", "3.0.0", "3.0.1", "3.1.6", "3.2.0", "3.2.7")
        ]
        assert planned(self.TEXT).dropped == (Dropped(id="demo/*", reason="not chosen by boundaries", count=4),)

    def test_without_known_breaks_the_newest_patches(self) -> None:
        """A package of which nothing is known is measured at its newest patches."""
        cells = planned(self.TEXT, breaks={}).cells

        assert [cell.axes["mujoco"] for cell in cells] == ["2.3.7", "3.0.1", "3.1.6", "3.2.7"]


class TestListed:
    INCLUDED = '[[include]]\naxes = { python = "3.12", mujoco = "3.3.7" }\nreason = "as people type it"\n'

    def test_only_what_is_included(self) -> None:
        """The axes are not multiplied, so their product neither is planned nor counts as left out."""
        text = f'strategy = "listed"\n[axes]\npython = ["3.11"]\nmujoco = ["2.3.7", "3.0.1"]\n{CASE}{self.INCLUDED}'

        assert labels(text) == ["py3.12_mujoco-3.3.7"]
        assert planned(text).dropped == ()

    def test_a_long_list(self) -> None:
        """Values whose product would be too large can be listed."""
        values = json.dumps([f"3.{minor}.0" for minor in range(200)])
        text = f"[axes]\npython = {values}\nmujoco = {values}\n{CASE}{self.INCLUDED}"

        with pytest.raises(BadInput, match="at most 20,000 can be planned"):
            planned(text)
        assert labels(f'strategy = "listed"\n{text}') == ["py3.12_mujoco-3.3.7"]

    def test_together_with_another_strategy(self) -> None:
        """In a list it adds nothing to what the other strategy chooses."""
        text = f"{THREE}{CASE}"

        assert labels(f'strategy = ["listed", "baseline"]\n{text}') == labels(f'strategy = "baseline"\n{text}')


class TestCovering:
    TEXT = f'strategy = "pairwise"\n{THREE}{CASE}'

    def test_every_pair_is_in_a_cell(self) -> None:
        """27 pairs take few of 27 combinations; 9 is the least there can be."""
        made = chosen(self.TEXT)

        assert 9 <= len(labels(self.TEXT, made)) <= 11
        assert len(pairs(self.TEXT, made)) == 27
        assert planned(self.TEXT, made).dropped == (
            Dropped(
                id="demo/*",
                reason="not chosen by pairwise; each pair of values is in some cell",
                count=27 - len(labels(self.TEXT, made)),
            ),
        )

    def test_the_union_with_a_baseline_builds_upon_it(self) -> None:
        """Cells that are there anyway cover their pairs, so that few more are needed."""
        text = f'strategy = ["baseline", "pairwise"]\n{THREE}{CASE}'
        made = chosen(text)

        assert isinstance(made.chosen, Chosen)
        assert len(pairs(text, made)) == 27
        assert len(labels(text, made)) == 7 + len(made.chosen.combinations) <= 7 + 8

    def test_three_axes_at_a_time(self) -> None:
        """With as many ways as axes all combinations are chosen."""
        text = f"strategy = {{ ways = 3 }}\n{THREE}{CASE}"

        assert len(labels(text, chosen(text))) == 27

    def test_more_ways_than_axes_are_refused(self) -> None:
        """There is no combination of four values out of three axes."""
        text = f"strategy = {{ ways = 4 }}\n{THREE}{CASE}"

        with pytest.raises(BadInput) as error:
            chosen(text)
        assert str(error.value) == "demo.toml: strategy: 4-way needs 4 axes, the matrix has 3"

    def test_not_chosen_yet(self) -> None:
        """A plan is made of what was committed: it asks nobody whether something resolves."""
        assert refused(self.TEXT) == (
            'demo.toml: strategy: the combinations are not chosen yet; run "simmatrix lock demo.toml"'
        )

    @pytest.mark.parametrize(
        "changed",
        [
            pytest.param(TEXT.replace('"3.12"', '"3.13"'), id="axis"),
            pytest.param(TEXT.replace('"pairwise"', "{ ways = 3 }"), id="strategy"),
            pytest.param('requirements = ["scipy"]\n' + TEXT, id="requirements"),
            pytest.param('constraints = [{ require = "numpy<2", when = { mujoco = "<3" } }]\n' + TEXT, id="constraint"),
            pytest.param('only_binary = [":all:"]\n' + TEXT, id="wheels-only"),
            pytest.param(TEXT + '[[exclude]]\nwhen = { python = "3.12" }\nreason = "no"', id="exclude"),
            pytest.param(TEXT.replace(CASE, CASE + 'when = { mujoco = ">=3" }'), id="combinations-without-a-case"),
            pytest.param("snapshot = 2026-11-19\n" + TEXT, id="snapshot"),
        ],
    )
    def test_a_choice_made_from_something_else(self, changed: str) -> None:
        """Whatever decides which combinations there are and resolve makes a choice useless when it changes."""
        assert refused(changed, chosen(self.TEXT)) == (
            "demo.toml: strategy: the matrix has changed since they were chosen; "
            'run "simmatrix lock demo.toml --upgrade"'
        )

    def test_a_choice_of_what_there_is_not(self) -> None:
        """A combination or a value that somebody wrote into the expansion is no part of the matrix."""
        made = chosen(self.TEXT)
        assert isinstance(made.chosen, Chosen)
        strange = Unresolvable(axes={"python": "2.7"}, reason="too old")
        for changes in ({"combinations": (("3.10", "1.0.0", "9.9"),)}, {"unresolvable": (strange,)}):
            edited = msgspec.structs.replace(made, chosen=msgspec.structs.replace(made.chosen, **changes))

            assert "has changed since they were chosen" in refused(self.TEXT, edited)

    @pytest.mark.parametrize(
        "changed",
        [
            pytest.param(TEXT + '[[cases]]\nenv = "Ant-v5"\napi = "gymnasium"', id="case"),
            pytest.param('environment = { A = "1" }\ndescription = "words"\n' + TEXT, id="surroundings"),
            pytest.param(TEXT + '[[expect]]\ncells = "*"\nverdict = "broken"\nreason = "so"', id="expectation"),
        ],
    )
    def test_a_choice_that_still_holds(self, changed: str) -> None:
        """A choice of cells stays valid if only cases, environment variables, descriptions or expectations change."""
        assert labels(changed, chosen(self.TEXT)) == labels(self.TEXT, chosen(self.TEXT))

    def test_an_included_combination_is_not_counted_as_left_out(self) -> None:
        """One that was not chosen can be asked for by name."""
        made = chosen(self.TEXT)
        left = next(label for label in labels(THREE + CASE) if label not in labels(self.TEXT, made))
        axes = next(cell.axes for cell in planned(THREE + CASE).cells if cell.label == left)
        inline = ", ".join(f'{name} = "{text}"' for name, text in axes.items())
        text = f'{self.TEXT}[[include]]\naxes = {{ {inline} }}\nreason = "asked for"'

        assert left in labels(text, made)
        assert sum(gone.count for gone in planned(text, made).dropped) == 27 - len(labels(text, made))

    def test_written_and_read_again(self) -> None:
        """The committed text reads as the choice it was made from."""
        made = chosen(self.TEXT)

        assert version_ranges.read(version_ranges.text_of(made), "demo.expanded.json") == made
        assert "chosen" not in version_ranges.text_of(version_ranges.expand(matrix(self.TEXT), {}, INSTANT))


def no_old_mujoco(python: str, question: Question) -> str | None:
    """Return the reason if a question needs a wheel of MuJoCo 2.3.7 for Python 3.12, which has none."""
    gone = python == "3.12" and "mujoco==2.3.7" in question.requirements
    return "mujoco 2.3.7 has no wheel" if gone else None


class TestResolving:
    TEXT = TestCovering.TEXT

    def test_only_combinations_that_resolve_are_chosen(self) -> None:
        """All pairs but the impossible one are covered; the reason is kept once, for all that it speaks of."""
        made = chosen(self.TEXT, Resolver(no_old_mujoco))

        assert all("py3.12" not in label or "mujoco2.3.7" not in label for label in labels(self.TEXT, made))
        assert len(pairs(self.TEXT, made)) == 26
        first, rest = planned(self.TEXT, made).dropped
        assert first == Dropped(
            id="demo/py3.12_*_mujoco-2.3.7", reason="does not resolve: mujoco 2.3.7 has no wheel", count=3
        )
        assert rest.reason == (
            "not chosen by pairwise; each pair of values is in some cell, but for these, excluded or without a "
            "resolution: python 3.12 with mujoco 2.3.7"
        )
        assert len(labels(self.TEXT, made)) + first.count + rest.count == 27

    def test_values_without_a_part_in_a_failure_are_set_aside(self) -> None:
        """One failure is enough to know of all combinations that fail alike: no second one is asked for."""
        resolver = Resolver(no_old_mujoco)
        chosen(self.TEXT, resolver)
        whole = [asked for asked in resolver.asked if len(asked[1]) == 2]

        assert sum(no_old_mujoco(python, Question(requirements=asked)) is not None for python, asked in whole) == 1

    def test_a_value_that_nothing_has(self) -> None:
        """A release that resolves nowhere is told as such, not pair by pair."""
        made = chosen(
            self.TEXT,
            Resolver(lambda python, question: "yanked" if "gymnasium==1.0.0" in question.requirements else None),
        )
        *gone, rest = planned(self.TEXT, made).dropped

        assert [(each.id, each.reason, each.count) for each in gone] == [
            (f"demo/py{python}_gymnasium-1.0.0_*", "does not resolve: yanked", 3) for python in ("3.10", "3.11", "3.12")
        ]
        assert rest.reason == (
            "not chosen by pairwise; each pair of values is in some cell, but for these, excluded or without a "
            "resolution: gymnasium 1.0.0"
        )

    def test_nothing_resolves(self) -> None:
        """Then there is no cell, and the reasons are there."""
        made = chosen(self.TEXT, Resolver(lambda python, question: "no index"))

        assert labels(self.TEXT, made) == []
        assert {gone.reason for gone in planned(self.TEXT, made).dropped} == {"does not resolve: no index"}

    def test_a_pin_that_rules_elsewhere_is_not_set_aside(self) -> None:
        """A constraint may hold for one version only: then a failure speaks of that version alone."""
        text = 'constraints = [{ require = "numpy<2", when = { gymnasium = "1.0.0" } }]\n' + self.TEXT
        made = chosen(text, Resolver(lambda python, question: "numpy" if "numpy<2" in question.constraints else None))

        assert isinstance(made.chosen, Chosen)
        assert {tuple(each.axes) for each in made.chosen.unresolvable} == {("python", "gymnasium")}
        assert len(pairs(text, made)) == 21

    @pytest.mark.parametrize(
        "gymnasium",
        [
            pytest.param('["0.29.1", "1.0.0rc1"]', id="a-pre-release-is-let-in-by-its-pin"),
            pytest.param('["0.29.1", "absent"]', id="without-a-pin-it-may-be-brought-in"),
            pytest.param('["0.29.1", { version = "1.0.0", overrides = ["numpy<2"] }]', id="an-override-may-mend-it"),
        ],
    )
    def test_an_axis_whose_values_do_more_than_pin_is_not_set_aside(self, gymnasium: str) -> None:
        """A combination that fails with one value of such an axis, and without it, may resolve with another value."""
        text = f'strategy = "pairwise"\n[axes]\npython = ["3.12"]\ngymnasium = {gymnasium}\n'
        text += f'mujoco = ["2.3.7", "3.0.0"]\n{CASE}'
        made = chosen(
            text, Resolver(lambda _, question: "no" if "gymnasium==0.29.1" in question.requirements else None)
        )

        assert isinstance(made.chosen, Chosen)
        assert {entry.axes.get("gymnasium") for entry in made.chosen.unresolvable} == {"0.29.1"}
        assert len(labels(text, made)) == 2

    def test_values_that_add_nothing_are_set_aside_without_a_question(self) -> None:
        """Environment variables and bundles without requirements have no part in a failure, so it is told once."""
        text = 'strategy = "pairwise"\n' + THREE + 'GL = { variable = ["egl", ""] }\nbox = { a = {}, b = {} }\n' + CASE
        made = chosen(text, Resolver(no_old_mujoco))

        assert isinstance(made.chosen, Chosen)
        assert [entry.axes for entry in made.chosen.unresolvable] == [{"python": "3.12", "mujoco": "2.3.7"}]

    def test_a_bundle_with_a_value_that_fixes_it_is_not_set_aside(self) -> None:
        """A value that adds nothing stands beside one that adds an override: they fail each by itself."""
        text = 'strategy = "pairwise"\n' + THREE + 'api = { plain = {}, mended = { overrides = ["numpy<2"] } }\n' + CASE
        made = chosen(text, Resolver(lambda _, question: None if question.overrides else "numpy"))

        assert isinstance(made.chosen, Chosen)
        assert {entry.axes["api"] for entry in made.chosen.unresolvable} == {"plain"}
        assert {label.rpartition("_")[2] for label in labels(text, made)} == {"mended"}

    def test_a_cell_of_the_baseline_that_does_not_resolve_is_left_out(self) -> None:
        """In a matrix whose combinations were asked for, what does not resolve is left out by every strategy."""
        text = 'strategy = ["pairwise", { baseline = { python = "3.12", mujoco = "2.3.7" } }]\n' + THREE + CASE
        made = chosen(text, Resolver(no_old_mujoco))
        names = labels(text, made)

        assert {"py3.10_gymnasium-1.2.3_mujoco-2.3.7", "py3.11_gymnasium-1.2.3_mujoco-2.3.7"} <= set(names)
        assert not [name for name in names if "py3.12" in name and "mujoco2.3.7" in name]
        assert len(pairs(text, made)) == 26
        assert planned(text, made).dropped[0] == Dropped(
            id="demo/py3.12_*_mujoco-2.3.7", reason="does not resolve: mujoco 2.3.7 has no wheel", count=3
        )

    def test_a_failed_network_ends_the_choice(self) -> None:
        """Without the network nothing is chosen, rather than too little."""

        def unreachable(python: str, question: Question) -> str | None:
            message = "the index does not answer"
            raise CouldNotTell(message)

        with pytest.raises(CouldNotTell):
            chosen(self.TEXT, Resolver(unreachable))
