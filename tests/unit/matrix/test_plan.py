"""The plan of a matrix: which cells there are, what they ask for, what is dropped, and what is stale."""

import pytest
from builders import CASE, make_plan, matrix

from harness.matrix import version_ranges
from harness.model import Case, Cell, Dropped, Expectation, Phase, Question, Verdict
from harness.model.errors import BadInput
from harness.model.vocabulary import checks_of


def refused(text: str) -> str:
    """Return the message with which planning a matrix is refused."""
    with pytest.raises(BadInput) as error:
        make_plan(text)
    return str(error.value)


def labels(text: str) -> list[str]:
    """Return the labels of the cells, in order."""
    return [cell.label for cell in make_plan(text).cells]


def by_label(text: str) -> dict[str, Cell]:
    """Return the cells of a matrix by label."""
    return {cell.label: cell for cell in make_plan(text).cells}


class TestIds:
    def test_every_kind_of_axis_in_the_order_of_the_file(self) -> None:
        """A label names Python, package versions, bundle labels and variables, an empty variable as unset."""
        text = (
            'axes = { python = ["3.11"], gymnasium = ["1.2.3", "absent"], api = { old = {} }, '
            'GL = { variable = ["egl", ""] } }\n' + CASE
        )

        assert labels(text) == [
            "py3.11_gymnasium-1.2.3_old_egl",
            "py3.11_gymnasium-1.2.3_old_unset",
            "py3.11_gymnasium-absent_old_egl",
            "py3.11_gymnasium-absent_old_unset",
        ]

    def test_host_is_a_real_version(self) -> None:
        """The Python that runs the harness is named by its version and asked for as host."""
        cell = make_plan('axes = { python = ["host"] }\n' + CASE).cells[0]

        assert (cell.id, cell.axes, cell.python) == ("demo/py3.12.1", {"python": "3.12.1"}, "host")

    def test_values_that_differ_in_case_only_are_refused(self) -> None:
        """Ids become folders, also where those do not care for case."""
        text = 'axes = { python = ["3.11"], api = { new = {}, New = {} } }\n' + CASE

        assert refused(text) == 'demo.toml: axes.api: "new" and "New" cannot be told apart: both are "New"'

    def test_host_beside_its_own_version_is_refused(self) -> None:
        """The same Python twice would be the same cell twice."""
        assert (
            refused('axes = { python = ["host", "3.12.1"] }\n' + CASE)
            == 'demo.toml: axes.python: "host" and "3.12.1" cannot be told apart: both are "py3.12.1"'
        )

    def test_values_that_are_written_alike_are_refused(self) -> None:
        """`_` stands between parts only, and dots and dashes are one where a runner makes folders of ids."""
        for one, other in (("a.b", "a-b"), ("a_b", "a-b"), ("A", "a")):
            text = f'axes = {{ python = ["3.11"], a = {{ "{one}" = {{}}, "{other}" = {{}} }} }}\n{CASE}'

            told = f'demo.toml: axes.a: "{one}" and "{other}" cannot be told apart: both are'
            assert refused(text).startswith(told)

    def test_labels_have_a_longest_length(self) -> None:
        """A label is part of paths."""
        text = f'axes = {{ python = ["3.11"], api = {{ {"a" * 144} = {{}} }} }}\n{CASE}'

        assert refused(text) == (
            f'demo.toml: axes: "py3.11_{"a" * 144}" has 151 characters, at most 150 are allowed; shorten a label'
        )

    def test_versions_with_an_epoch_are_refused(self) -> None:
        """A version that cannot be part of an id is refused."""
        assert (
            refused('axes = { python = ["3.11"], x = ["1!2.0"] }\n' + CASE)
            == 'demo.toml: axes.x: "1!2.0" cannot be a label: use letters, digits and "._+-" only'
        )


class TestQuestions:
    def test_all_that_decides_a_resolution(self) -> None:
        """Everything of base, values and bundles that holds comes into the question, in order and once."""
        text = (
            """
            requirements = ["gymnasium[mujoco]", "scipy"]
            constraints = ["numpy<3", { require = "numpy<2", when = { gymnasium = "<1.0" } },
                           { require = "x<1", when = { gymnasium = ">=1.0" } }]
            overrides = ["y==1"]
            build_constraints = ["setuptools<67"]
            build_variables = { CC = "gcc" }
            only_binary = ["mujoco"]
            resolution = "lowest-direct"
            prerelease = "allow"
            torch_backend = "cu126"
            snapshot = 2026-11-20
            index = { find_links = ["wheels"], no_index = true }
            [axes]
            python = ["3.11"]
            gymnasium = [{ version = "0.29.1", constraints = ["numpy<3", "z<1"], only_binary = [":all:"] }]
            api = { old = { requirements = ["pygame"], build_variables = { CC = "clang" } } }
            """
            + CASE
        )

        assert make_plan(text).cells[0].question == Question(
            requirements=("gymnasium[mujoco]", "scipy", "pygame", "gymnasium==0.29.1"),
            constraints=("numpy<3", "numpy<2", "z<1"),
            overrides=("y==1",),
            build_constraints=("setuptools<67",),
            build_variables={"CC": "clang"},
            only_binary=("mujoco", ":all:"),
            resolution="lowest-direct",
            prerelease="allow",
            index=matrix(text).index,
            torch_backend="cu126",
            snapshot="2026-11-20T23:59:59Z",
        )

    def test_an_absent_package_is_neither_asked_for_nor_allowed(self) -> None:
        """`absent` takes the package out of the requirements and forbids it in the lock."""
        text = (
            'requirements = ["Gymnasium[mujoco]", "scipy"]\n'
            'axes = { python = ["3.11"], gymnasium = ["absent"] }\n' + CASE
        )

        assert make_plan(text).cells[0].question == Question(requirements=("scipy",), absent=("gymnasium",))

    def test_strings_are_plain(self) -> None:
        """Strings that others encode and compare are of the built-in type."""
        text = (
            'requirements = ["numpy"]\nconstraints = ["numpy<3"]\nsnapshot = 2026-11-20\naxes.python = ["3.11"]\n'
            + CASE
        )
        question = make_plan(text).cells[0].question
        written = (*question.requirements, *question.constraints, question.snapshot, question.torch_backend)

        assert {type(each) for each in written} == {str}

    def test_a_variable_never_changes_the_question(self) -> None:
        """Cells that differ in variables only share one question."""
        text = 'axes = { python = ["3.11"], GL = { variable = ["egl", "osmesa"] } }\n' + CASE
        first, second = make_plan(text).cells

        assert first.question is second.question

    @pytest.mark.parametrize(
        ("when", "holds"),
        [
            ('python = "3.11"', ["3.11", "3.11.7"]),
            ('python = ">=3.11"', ["3.11", "3.11.7", "3.12"]),
            ('python = ["3.9", ">3.11.5"]', ["3.9", "3.11.7", "3.12"]),
            ('x = "1.0"', ["3.9", "3.11", "3.11.7", "3.12"]),
            ('x = "absent"', []),
            ('x = "==1.*", python = "<3.11"', ["3.9"]),
        ],
    )
    def test_when(self, when: str, holds: list[str]) -> None:
        """A condition holds where every axis it names agrees with one of its patterns."""
        text = (
            f'constraints = [{{ require = "c", when = {{ {when} }} }}]\n'
            'axes = { python = ["3.9", "3.11", "3.11.7", "3.12"], x = ["1.0"] }\n' + CASE
        )

        assert [cell.python for cell in make_plan(text).cells if cell.question.constraints] == holds


class TestSurroundings:
    def test_variables_of_base_values_and_axes(self) -> None:
        """A bundle's variable takes the place of the matrix's, an axis that of both; empty ones stay."""
        text = (
            'environment = { A = "base", B = "base", C = "base" }\n'
            'axes = { python = ["3.11"], C = { variable = [""] }, '
            'api = { x = { environment = { B = "x", C = "x" } } } }\n' + CASE
        )
        cell = make_plan(text).cells[0]

        assert cell.environment == {"A": "base", "B": "x", "C": ""}
        assert cell.axes == {"python": "3.11", "C": "unset", "api": "x"}

    def test_needs_and_files(self) -> None:
        """Capabilities add up, files are texts of the matrix or of what lies beside it."""
        text = (
            'needs = ["egl"]\nsystem = ["patchelf"]\nfiles = { ".config/a" = "text", b = { source = "b.xml" } }\n'
            'axes = { python = ["3.11"], '
            'api = { x = { needs = ["egl", "gpu"], system = ["libglew-dev", "patchelf"], '
            'files = { ".config/a" = "other" } } } }\n' + CASE
        )
        cell = make_plan(text, texts={"b.xml": "<b/>"}).cells[0]

        assert cell.needs == ("egl", "gpu")
        assert cell.system == ("patchelf", "libglew-dev")
        assert cell.files == {".config/a": "other", "b": "<b/>"}

    def test_a_file_cannot_be_a_folder(self) -> None:
        """A file in whose place a folder has to be is refused, whichever values of the axes bring them."""
        text = 'files = { a = "text" }\naxes.python = [{ version = "3.11", files = { "a/b" = "" } }]\n' + CASE

        assert refused(text) == 'demo.toml: files: "a" cannot be a file, being the folder of a/b'


class TestCases:
    def test_a_case_as_it_runs(self) -> None:
        """Defaults are filled in: an id from the environment's, all checks."""
        text = (
            'axes.python = ["3.11"]\n'
            '[[cases]]\nenv = "gym:ALE/Pong-v5"\nkwargs = { a = 1 }\ntimeouts = { single = 60 }\n'
        )

        assert make_plan(text).cells[0].cases == (
            Case(
                id="gym-ALE-Pong-v5",
                env="gym:ALE/Pong-v5",
                api="gym",
                kwargs={"a": 1},
                checks=checks_of(()),
                timeouts={Phase.SINGLE: 60.0},
            ),
        )

    def test_phases_stand_for_their_checks_and_the_import_comes_first(self) -> None:
        """Checks come in the order of phases, and none without the import that it needs."""
        text = 'axes.python = ["3.11"]\n' + CASE + 'checks = ["vector", "single.loop"]'

        assert make_plan(text).cells[0].cases[0].checks == (
            "import.modules",
            "single.loop",
            "vector.sync",
            "vector.async.fork",
        )

    def test_modules_without_an_environment(self) -> None:
        """A case can be an import alone, of no API."""
        text = 'axes.python = ["3.11"]\n[[cases]]\nimports = ["mujoco"]\n'

        assert make_plan(text).cells[0].cases == (
            Case(id="import-mujoco", env=None, api="", checks=("import.modules",), imports=("mujoco",)),
        )

    def test_cases_follow_when_and_bundles(self) -> None:
        """A case exists where its `when` holds, a bundle's case with that value only."""
        text = """
            axes.python = ["3.10", "3.11"]
            axes.api.old.cases = [{ env = "Ant-v4", api = "gymnasium" }]
            axes.api.new.cases = [{ env = "Ant-v5", api = "gymnasium", when = { python = "3.11" } }]
            cases = [{ env = "CartPole-v1", api = "gymnasium", when = { python = "3.11" } }]
        """
        found = make_plan(text)

        assert {cell.label: [case.id for case in cell.cases] for cell in found.cells} == {
            "py3.10_old": ["Ant-v4"],
            "py3.11_old": ["CartPole-v1", "Ant-v4"],
            "py3.11_new": ["CartPole-v1", "Ant-v5"],
        }
        assert found.dropped == (Dropped(id="demo/py3.10_new", reason="no case exists for it"),)

    def test_equal_ids_in_one_cell_are_refused(self) -> None:
        """The same environment with other arguments needs an id of its own."""
        text = 'axes.python = ["3.11"]\n' + CASE + CASE + "kwargs = { a = 1 }"

        assert refused(text) == 'demo.toml: cases: two cases of one cell have the id "CartPole-v1"; give one an "id"'

    def test_equal_ids_in_different_cells_are_fine(self) -> None:
        """One id may stand for different cases where they never meet."""
        text = 'axes.python = ["3.10", "3.11"]\n' + "".join(
            f'{CASE}when = {{ python = "{python}" }}\nsteps = {steps}\n' for python, steps in (("3.10", 5), ("3.11", 6))
        )

        assert [cell.cases[0].steps for cell in make_plan(text).cells] == [5, 6]

    def test_a_case_that_exists_nowhere_is_stale(self) -> None:
        """A case that no cell has is told, not passed over."""
        text = (
            'axes = { python = ["3.11"], '
            'api = { x = { cases = [{ env = "E", api = "gym", when = { python = "<3" } }] } } }\n'
            + CASE
            + CASE
            + 'id = "second"\nwhen = { python = "3.12" }'
        )

        assert make_plan(text).stale == (
            'demo.toml: cases[1] ("second") exists in no cell',
            'demo.toml: axes.api.x.cases[0] ("E") exists in no cell',
        )


class TestExcludeAndInclude:
    AXES = 'axes = { python = ["3.10", "3.11"], gymnasium = ["0.29.1", "1.2.3"] }\n'

    def test_an_excluded_combination_keeps_its_reason(self) -> None:
        """The first exclusion that fits gives the reason; one that fits nothing is stale."""
        text = (
            self.AXES
            + CASE
            + '[[exclude]]\nwhen = { python = "3.10", gymnasium = ">=1" }\nreason = "needs 3.11"\n'
            + '[[exclude]]\nwhen = { python = "3.10", gymnasium = "1.2.3" }\nreason = "again"\n'
            + '[[exclude]]\nwhen = { python = "3.9" }\nreason = "too old"\n'
        )
        found = make_plan(text)

        assert found.dropped == (Dropped(id="demo/py3.10_gymnasium-1.2.3", reason="needs 3.11"),)
        assert [cell.label for cell in found.cells] == [
            "py3.10_gymnasium-0.29.1",
            "py3.11_gymnasium-0.29.1",
            "py3.11_gymnasium-1.2.3",
        ]
        assert found.stale == ('demo.toml: exclude[2] matches no combination (reason: "too old")',)

    def test_an_included_combination_may_have_other_values(self) -> None:
        """A combination outside the product is added, one that was excluded comes back."""
        text = (
            self.AXES
            + CASE
            + '[[exclude]]\nwhen = { python = "3.10" }\nreason = "old"\n'
            + '[[include]]\naxes = { python = "3.8", gymnasium = "0.26.3" }\nreason = "older still"\n'
            + '[[include]]\naxes = { python = "3.10", gymnasium = "1.2.3" }\nreason = "the newest"\n'
        )
        found = make_plan(text)

        assert [cell.label for cell in found.cells] == [
            "py3.11_gymnasium-0.29.1",
            "py3.11_gymnasium-1.2.3",
            "py3.8_gymnasium-0.26.3",
            "py3.10_gymnasium-1.2.3",
        ]
        assert [gone.id for gone in found.dropped] == ["demo/py3.10_gymnasium-0.29.1"]

    @pytest.mark.parametrize(
        ("include", "sentence"),
        [
            pytest.param(
                '{ python = "3.10", gymnasium = "1.2.3" }',
                'demo.toml: include[0].axes: "demo/py3.10_gymnasium-1.2.3" is planned already',
                id="in-the-product",
            ),
            pytest.param(
                '{ python = "3.7", gymnasium = "1.2.3" }',
                'demo.toml: include[0].axes: no case exists for "demo/py3.7_gymnasium-1.2.3"',
                id="without-a-case",
            ),
        ],
    )
    def test_an_include_that_adds_nothing_is_refused(self, include: str, sentence: str) -> None:
        """A combination cannot be added twice, nor without a case."""
        text = f'{self.AXES}{CASE}when = {{ python = ">=3.8" }}\n[[include]]\naxes = {include}\nreason = "x"\n'

        assert refused(text) == sentence


class TestExpectations:
    def test_the_first_that_fits_holds(self) -> None:
        """Globs are tried on label and id, conditions on the axes; what fits no cell is stale."""
        text = (
            'axes = { python = ["3.10", "3.11", "3.12", "3.13"] }\n'
            + CASE
            + '[[expect]]\ncells = "py3.10"\nverdict = "import_fails"\nphase = "import"\nmatch = "no module"\n'
            + 'reason = "a"\nlink = "l"\nuntil = 2026-12-31\n'
            + '[[expect]]\ncells = "demo/py3.1[01]"\nverdict = "partial"\nreason = "b"\n'
            + '[[expect]]\nwhen = { python = ">=3.12" }\ncells = "*3"\nverdict = "broken"\nreason = "c"\n'
            + '[[expect]]\ncells = "py3.10"\nverdict = "works"\nreason = "d"\n'
        )
        found = make_plan(text)

        assert [cell.expect for cell in found.cells] == [
            Expectation(
                verdict=Verdict.IMPORT_FAILS,
                reason="a",
                phase=Phase.IMPORT,
                match="no module",
                link="l",
                until="2026-12-31T23:59:59Z",
            ),
            Expectation(verdict=Verdict.PARTIAL, reason="b"),
            None,
            Expectation(verdict=Verdict.BROKEN, reason="c"),
        ]
        assert found.stale == ('demo.toml: expect[3] matches no cell (reason: "d")',)


class TestRanges:
    TEXT = 'axes = { python = ["3.11"], mujoco = { range = ">=3" } }\n' + CASE

    def test_an_expanded_range(self) -> None:
        """The versions of the expansion are values of the axis, and its instant is the cutoff."""
        made = version_ranges.expand(matrix(self.TEXT), {"mujoco": [("3.3.7", False), ("4.0.0", False)]}, "2026-11-20")
        cells = make_plan(self.TEXT, expansion=made).cells

        assert [cell.id for cell in cells] == ["demo/py3.11_mujoco-3.3.7", "demo/py3.11_mujoco-4.0.0"]
        assert cells[0].question == Question(requirements=("mujoco==3.3.7",), snapshot="2026-11-20T23:59:59Z")

    def test_without_an_expansion(self) -> None:
        """The user is told what to run."""
        assert refused(self.TEXT) == (
            'demo.toml: axes.mujoco: the range is not expanded yet; run "simmatrix lock demo.toml"'
        )

    def test_with_the_expansion_of_another_range(self) -> None:
        """An expansion that the file has moved on from is not used."""
        made = version_ranges.expand(matrix(self.TEXT), {"mujoco": [("3.3.7", False)]}, "2026-11-20")
        with pytest.raises(BadInput) as error:
            make_plan(self.TEXT.replace(">=3", ">=2"), expansion=made)

        assert str(error.value) == (
            "demo.toml: axes.mujoco: the range has changed since it was expanded; "
            'run "simmatrix lock demo.toml --upgrade"'
        )


def test_axes_and_shown_packages_in_order() -> None:
    """Tables learn the axes and the packages to show."""
    found = make_plan('shown = ["NumPy"]\naxes = { python = ["3.11"], gymnasium = ["1.0"] }\n' + CASE)

    assert (found.matrix, found.axes, found.shown) == ("demo", ("python", "gymnasium"), ("numpy",))
