"""The first matrix of a project: what is drafted is a matrix that plans."""

from __future__ import annotations

from textwrap import dedent

import pytest

from harness.ci import drafts
from harness.ci.drafts import Case, Draft, Project, Range, SuiteDraft
from harness.ci.drafts import candidates as trying
from harness.ci.drafts.candidates import Candidate
from harness.ci.drafts.values import narrow
from harness.ci.workflows import read
from harness.matrix import matrix_file, plan
from harness.matrix.matrix_types import Expansion
from harness.model import Plan, Suite, replace
from harness.model.errors import BadInput
from harness.model.vocabulary import GYMNASIUM, Instant, Rule
from harness.packages.index import Release
from harness.reports.template_files import read_template

TEMPLATE = read_template("matrix.toml.j2")


def planned(draft: Draft, **versions: tuple[str, ...]) -> Plan:
    """Return the plan of a written draft."""
    matrix = matrix_file.read(drafts.text_of(draft, TEMPLATE), "drafted.toml")
    axes = {name.replace("_", "-"): each for name, each in versions.items()}
    expansion = Expansion(matrix="drafted", instant=Instant("2026-11-20T00:00:00Z"), ranges=matrix.ranges, axes=axes)
    return plan.make_plan(plan.Sources(matrix=matrix, expansion=expansion if versions else None, host_python="3.11.7"))


def labels(found: Plan) -> list[str]:
    """Return the ids of the cells without the name of the matrix."""
    return [cell.label for cell in found.cells]


# --- projects --------------------------------------------------------------------------------------------------

PYPROJECT = """
[project]
name = "My_Sim"
requires-python = ">=3.9,<3.13"
classifiers = ["Programming Language :: Python :: 3", "Programming Language :: Python :: 3.8",
               "Programming Language :: Python :: 3.11", "Programming Language :: Python :: 3.12"]
dependencies = ["Gymnasium[mujoco]>=1.0,<2", "numpy", "mujoco; python_version>'3'", "x @ file:///x", "not a name"]
[project.entry-points."gymnasium.envs"]
__root__ = "my_sim:register"
"""
SETUP = """
import setuptools
VERSION = read()
setuptools.setup(name="old-sim", version=VERSION, python_requires=">=3.7,<3.9", install_requires=["gym>=0.21"])
"""

POETRY = """
[tool.poetry]
name = "Gym_Pusht"
classifiers = ["Programming Language :: Python :: 3.10"]
[tool.poetry.dependencies]
python = "^3.10"
gymnasium = ">=0.29.1"
numpy = "^1.26"
pymunk = { version = "~6.6.0", extras = ["dev"] }
tool = "^0.3"
pytest = { version = "*", optional = true }
own = { path = "../own" }
[tool.poetry.extras]
test = ["pytest"]
"""
POETRY_PROJECT = Project(
    name="gym-pusht",
    pythons=("3.10",),
    dependencies=("gymnasium>=0.29.1", "numpy>=1.26,<2", "pymunk[dev]>=6.6.0,<6.7", "tool>=0.3,<0.4"),
    extras={"test": ("pytest",)},
)


@pytest.mark.parametrize(
    ("pyproject", "setup", "expected"),
    [
        pytest.param(
            PYPROJECT,
            SETUP,
            Project(
                name="my-sim",
                pythons=("3.11", "3.12"),
                dependencies=(
                    *("Gymnasium[mujoco]>=1.0,<2", "numpy", "mujoco; python_version>'3'", "x @ file:///x"),
                    "not a name",
                ),
                plugin=True,
            ),
            id="classifiers within requires-python",
        ),
        pytest.param(
            '[project]\nname = "a"\nrequires-python = ">=3.12.1"',
            "",
            Project(name="a", pythons=("3.12", "3.13", "3.14")),
            id="a first patch that is too old",
        ),
        pytest.param("", SETUP, Project(name="old-sim", pythons=("3.7", "3.8"), dependencies=("gym>=0.21",)), id="old"),
        pytest.param(POETRY, "", POETRY_PROJECT, id="poetry"),
        pytest.param(
            "",
            'setup(name="s", extras_require={"tests": ["pytest"], "draw:os_name": ["pygame"], **more})\n'
            'setup(extras_require={"a": ["b"]})',
            Project(name="s", extras={"a": ("b",)}),
            id="extras of a setup.py",
        ),
        pytest.param(
            '[project]\nname = "g"\n[project.optional-dependencies]\nMore_Tests = ["pytest"]\n'
            '[dependency-groups]\ntest = ["pytest", { include-group = "x" }]\n'
            '[tool.pytest.ini_options]\ntestpaths = ["checks"]',
            "",
            Project(
                name="g",
                extras={"more-tests": ("pytest",)},
                groups={"test": ("pytest", {"include-group": "x"})},
                test_paths=True,
            ),
            id="extras and groups",
        ),
        pytest.param("[tool.x]", "setup(**more)", Project(name="the-folder"), id="nothing said"),
        pytest.param("", "setup(", Project(name="the-folder"), id="no Python"),
    ],
)
def test_a_project_is_read_without_running_it(pyproject: str, setup: str, expected: Project) -> None:
    """Data come from pyproject.toml, else from the literals of setup.py, else from the folder's name."""
    assert drafts.read_project(pyproject, setup, "The_Folder") == expected


SETUPTOOLS = '[build-system]\nrequires = ["setuptools"]\nbuild-backend = "setuptools.build_meta"\n'


@pytest.mark.parametrize(
    ("texts", "src", "expected"),
    [
        ((SETUPTOOLS, 'setup(name="a")', ""), False, ".simmatrix"),
        (("[project]\nname = 'a'", "", ""), False, ".simmatrix"),
        ((SETUPTOOLS + "[tool.setuptools.packages.find]\n", "", ""), False, ".simmatrix"),
        ((SETUPTOOLS + '[tool.setuptools.packages.find]\ninclude = ["a"]', "", ""), False, "matrices"),
        ((SETUPTOOLS + '[tool.setuptools]\npackages = ["a"]', "", ""), False, "matrices"),
        ((SETUPTOOLS + '[tool.setuptools]\npy-modules = ["a"]', "", ""), False, "matrices"),
        ((SETUPTOOLS, "setup(packages=find_packages())", ""), False, "matrices"),
        ((SETUPTOOLS, "", "[options]\npackages = find:\n"), False, "matrices"),
        ((SETUPTOOLS, "", ""), True, "matrices"),
        (('[build-system]\nbuild-backend = "hatchling.build"', "", ""), False, "matrices"),
    ],
)
def test_a_matrix_does_not_become_a_package(texts: tuple[str, str, str], src: bool, expected: str) -> None:
    """The folder of a first matrix has a name that setuptools passes by."""
    assert drafts.matrix_folder(*texts, src=src) == expected


def test_a_wrong_specifier_is_refused() -> None:
    """A wrong specifier is refused in one sentence that names the key."""
    with pytest.raises(BadInput) as caught:
        drafts.read_project('[project]\nname = "a"\nrequires-python = "3.10"', "", "a")

    assert str(caught.value) == 'pyproject.toml: project.requires-python: "3.10" is not a specifier such as ">=3.10"'


def test_environments_are_found_by_the_literals_that_register_them() -> None:
    """Whatever `register` is called through; ids that are made at run time, and other registers, are not."""
    text = """
    register(id="A-v0", entry_point="x:A")
    gym.envs.registration.register("ns/B-v12")
    register(id=f"C-v{n}")
    atexit.register(close)
    parser.register("action", "x")
    """

    assert list(drafts.environment_ids(dedent(text))) == ["A-v0", "ns/B-v12"]
    assert list(drafts.environment_ids("register(")) == []


def test_a_project_is_measured_at_what_it_claims() -> None:
    """Each package that counts is an axis with the project's own bounds; one axis is varied at a time."""
    project = drafts.read_project(PYPROJECT, "", "x")
    case = Case(env="A-v0", api=GYMNASIUM, imports=("a.envs",), note="Tried, and\n[it] does not run.")
    draft = replace(drafts.of_project(project), cases=(case,), suite=SuiteDraft(groups=("test",), arguments=("tests",)))

    found = planned(draft, gymnasium=("1.0.0", "1.2.3"), mujoco=("3.3.7",))

    assert [(each.package, each.range, each.rule) for each in draft.ranges] == [
        ("gymnasium", "<2,>=1.0", "latest-patch"),
        ("mujoco", ">=0", "latest-minor"),
    ]
    assert labels(found) == [
        "py3.11_gymnasium-1.0.0_mujoco-3.3.7",
        "py3.11_gymnasium-1.2.3_mujoco-3.3.7",
        "py3.12_gymnasium-1.2.3_mujoco-3.3.7",
    ]
    assert [(case.env, case.imports) for case in found.cells[0].cases] == [("A-v0", ("a.envs",))]
    assert found.cells[0].subject is not None
    assert found.cells[0].subject.suite == Suite(groups=("test",), arguments=("tests",))
    assert "# Tried, and [it] does not run." in drafts.text_of(draft, TEMPLATE).splitlines()


def test_a_project_that_says_nothing_is_imported_here() -> None:
    """Without Pythons, dependencies and environments there is one cell still."""
    found = planned(drafts.of_project(Project(name="quiet")))

    assert (labels(found), [case.env for case in found.cells[0].cases]) == (["py3.11.7"], [None])


# --- the tests of a project ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("extras", "groups", "folders", "in_workflow", "expected"),
    [
        ({"testing": (), "wfc": ()}, {}, ("tests",), (), SuiteDraft(extras=("testing",), arguments=("tests",))),
        (
            {"all": (), "docs": ()},
            {},
            ("test",),
            ("docs", "all", "gone"),
            SuiteDraft(extras=("all",), arguments=("test",)),
        ),
        ({}, {"test": (), "docs": ()}, ("tests",), (), SuiteDraft(groups=("test",), arguments=("tests",))),
        ({"dev": ("black", "pytest-cov")}, {}, ("tests",), (), SuiteDraft(extras=("dev",), arguments=("tests",))),
        ({"dev": ("black", "not a line")}, {}, ("tests",), (), SuiteDraft(arguments=("tests",))),
        ({"test": ("pytest",)}, {}, ("docs",), (), None),
    ],
)
def test_the_tests_of_a_project(
    extras: dict[str, tuple[str, ...]],
    groups: dict[str, tuple[object, ...]],
    folders: tuple[str, ...],
    in_workflow: tuple[str, ...],
    expected: SuiteDraft | None,
) -> None:
    """Tests are found by names of extras and groups, by pytest in them, or by CI; without a folder there are none."""
    assert drafts.draft_suite(extras, groups, folders, in_workflow=in_workflow) == expected


def test_a_project_that_configures_its_tests_gets_no_folder() -> None:
    """pytest finds them itself, wherever they lie."""
    assert drafts.draft_suite({}, {}, ("checks",), configured=True) == SuiteDraft()


def test_extras_that_users_install() -> None:
    """Neither tests nor documentation nor tools are tried for the sake of an environment."""
    assert drafts.runtime({"testing": (), "mujoco": (), "Dev": (), "docs": (), "all": ()}) == ("mujoco", "all")


# --- values of an axis -----------------------------------------------------------------------------------------


def offer(version: str, *wheels: str, python: str | None = None) -> Release:
    """Return a release with wheels for these tags."""
    names = tuple(f"sim-{version}-{tags}.whl" for tags in wheels)
    return Release(version=version, uploaded=None, yanked=False, requires_python=python, wheels=names, sdist=True)


OLD, NEW, ANY = "cp36-cp36m-manylinux1_x86_64", "cp311-cp311-manylinux1_x86_64", "py3-none-any"


@pytest.mark.parametrize(
    ("range_", "rule", "offers", "expected", "note"),
    [
        pytest.param(
            ">=0",
            Rule.LATEST_MINOR,
            (offer("0.1.7"), offer("1.2.9"), offer("2.8.6", OLD), offer("3.2.7", NEW)),
            ">=3.2.7",
            "Left out, not installable without a build on Python 3.11: 0.1.7, 1.2.9, 2.8.6.",
            id="old releases",
        ),
        pytest.param(
            ">=1,<4",
            Rule.LATEST_PATCH,
            (offer("1.0", NEW), offer("1.1", OLD), offer("2.0", ANY, python=">=3.12"), offer("3.0", ANY)),
            ">=1,<4,!=1.1,!=2.0",
            "Left out, not installable without a build on Python 3.11: 1.1, 2.0.",
            id="gaps",
        ),
        pytest.param(
            ">=1",
            Rule.LATEST_PATCH,
            (offer("1.0", ANY), offer("1.2.2", ANY, python=">=3.12"), offer("1.2.3", ANY, python=">=3.12")),
            ">=1,<=1.0",
            "Left out, not installable without a build on Python 3.11: 1.2.3.",
            id="new releases",
        ),
        pytest.param(">=1", Rule.LATEST_PATCH, (offer("1.0"), offer("2.0")), ">=1", None, id="only sdists"),
        pytest.param(
            ">=1",
            Rule.LATEST_PATCH,
            (offer("1.0", OLD),),
            ">=1",
            "No release that the project allows installs without a build on Python 3.11.",
            id="none",
        ),
        pytest.param(
            ">=1", Rule.LATEST_PATCH, (offer("0.9"), offer("1.0", ANY)), ">=1", None, id="nothing to leave out"
        ),
    ],
)
def test_values_that_cannot_work_are_left_out(
    range_: str, rule: Rule, offers: tuple[Release, ...], expected: str, note: str | None
) -> None:
    """A release without a wheel for the Python of the cells is no value, and the note names it."""
    found = narrow(Range(package="sim", range=range_, rule=rule), offers, "3.11")

    assert (found.range, found.note) == (expected, note)


# --- environments that a package told of -----------------------------------------------------------------------


def candidate(env: str, entry: str = "", api: str = "gymnasium", place: str = "") -> Candidate:
    """Return an environment as a cell reports it."""
    return Candidate(env=env, api=api, entry=entry, place=place or entry.partition(":")[0])


def test_candidates_are_of_different_kinds_first() -> None:
    """The newest version of each, one of each class, of different modules first; the variants come last."""
    found = [
        candidate("A-v1", "m.a:A"),
        candidate("A-v2", "m.a:A"),
        candidate("ADense-v2", "m.a:A"),
        candidate("B-v0", "m.a:B"),
        candidate("C-v0", "m.c:C"),
        candidate("pettingzoo:classic/rps_v2", api="pettingzoo", place="pettingzoo.classic.rps_v2"),
        candidate("pettingzoo:classic/rps/rps", api="pettingzoo", place="pettingzoo.classic.rps.rps"),
    ]

    assert [each.env for each in trying.chosen_order(found)] == [
        "A-v2",
        "C-v0",
        "pettingzoo:classic/rps_v2",
        "B-v0",
        "ADense-v2",
    ]


def test_answers_of_a_cell_may_have_any_shape() -> None:
    """Entries of another shape, or of an API that is not known, are left out."""
    facts = {
        "environments": [
            {"env": "A-v0", "api": "gymnasium", "entry": "m.a:A", "module": "m.envs", "lacking": "ImportError: x"},
            {"env": "pettingzoo:m:env", "api": "pettingzoo", "entry": "", "module": "m.loop"},
            {"env": "B", "api": "nonsense"},
            {"api": "gymnasium"},
            "C",
        ],
        "failed": {"m.b": "ImportError: y"},
    }

    found, failed = trying.read(facts)

    assert [(each.env, each.place, each.imports, each.lacking) for each in found] == [
        ("A-v0", "m.a", ("m.envs",), "ImportError: x"),
        ("pettingzoo:m:env", "m.loop", (), ""),
    ]
    assert failed == (("m.b", "ImportError: y"),)
    assert trying.read({"environments": "no", "failed": []}) == ((), ())


def test_extras_called_like_a_part_of_the_package_come_first() -> None:
    """`butterfly` brings what pettingzoo.butterfly needs; `all` is the last resort."""
    places = ["pettingzoo.butterfly.pistonball_v6", "pettingzoo.classic.rps_v2"]

    assert trying.ordered_extras(["all", "other", "classic", "butterfly"], places) == [
        "classic",
        "butterfly",
        "other",
        "all",
    ]


@pytest.mark.parametrize(
    ("why", "expected"),
    [
        ("TypeError: make() missing 1 required positional argument: 'env_name'", True),
        ("TypeError: <lambda>() missing 2 required keyword-only arguments: 'a' and 'b'", True),
        ("AttributeError: 'Space' object has no attribute 'add_collision_handler'", False),
    ],
)
def test_an_argument_that_nobody_gave_is_no_failure(why: str, expected: bool) -> None:
    """It tells what a case has to give, and nothing against the package."""
    assert trying.needs_arguments(why) is expected


# --- workflows -------------------------------------------------------------------------------------------------


def drafted(matrix: str, run: str, python: str = "${{ matrix.python }}") -> Draft | None:
    """Return the draft of a workflow with one job of two steps."""
    (job,) = read(
        f"jobs: {{ test: {{ strategy: {{ matrix: {matrix} }}, steps: ["
        f'{{ uses: "actions/setup-python@v5", with: {{ python-version: "{python}" }} }}, {run} ] }} }}',
        "ci.yml",
    )
    return drafts.of_legs(job.legs, "ci.yml")


def test_pins_of_every_leg_are_axes() -> None:
    """Combinations that the workflow does not have are excluded, with a reason."""
    draft = drafted(
        '{ python: ["3.10", "3.12"], np: ["1.26.4", "2.2.6"], exclude: [{ python: "3.12", np: "1.26.4" }] }',
        '{ run: "pip install -U pip numpy==${{ matrix.np }} scipy && pip install .[tests] -r more.txt" }',
    )
    assert draft
    found = planned(draft)

    assert labels(found) == ["py3.10_numpy-1.26.4", "py3.10_numpy-2.2.6", "py3.12_numpy-2.2.6"]
    assert [(gone.id, gone.reason) for gone in found.dropped] == [
        ("drafted/py3.12_numpy-1.26.4", "no leg of the workflow is so")
    ]
    assert (found.stale, draft.requirements, draft.extras) == ((), ("scipy",), ("tests",))
    assert draft.notes == ("Not taken over: more.txt.",)


def test_packages_of_some_legs_are_a_bundle() -> None:
    """A label that is never installed is not among the names."""
    draft = drafted(
        '{ python: ["3.10", "3.11"], include: [{ gym: "1.2.3" }, { python: "3.10", gym: "0.29.1" }] }',
        '{ run: "pip install ." }, { if: "matrix.gym != \'1.2.3\'", run: "pip install gymnasium==${{ matrix.gym }} '
        "'numpy<2,>=1.21'\" }",
    )
    assert draft
    found = planned(draft)

    assert labels(found) == ["py3.10_gymnasium-0.29.1-numpy-from1.21-below2", "py3.11_newest"]
    assert [cell.question.requirements for cell in found.cells] == [("gymnasium==0.29.1", "numpy<2,>=1.21"), ()]


def test_versions_handed_to_a_container_are_believed_and_reported() -> None:
    """A container gets the Python and numpy; what it does with them is not seen."""
    draft = drafted(
        '{ python: ["3.10"], numpy-version: [">=2.1", "<2"], mode: [fast] }',
        '{ run: "docker build --build-arg P=${{ matrix.python }} --build-arg N=${{ matrix.numpy-version }} ." }',
        python="3.12",
    )
    assert draft
    found = planned(draft)

    assert labels(found) == ["py3.12_numpy-from2.1", "py3.12_numpy-below2"]
    assert "numpy-version is handed to `docker build --build-arg ...`; it is taken at its word here." in draft.notes


def test_every_line_of_a_workflow_makes_a_file_that_plans() -> None:
    """Lines and control characters stay inside comments; a Python that is not set up counts only where none is."""
    odd = drafted(
        '{ python: ["3.11", "x\\ny = 1 \\u0007"], n: [1, 2] }', "{ run: pip install numpy==1.26.$N, env: { N: 4 } }"
    )
    unset = drafted('{ np: ["1.26.4", "2.2.6"] }', '{ run: "pip install numpy==${{ matrix.np }}" }', python="")

    assert odd
    assert labels(planned(odd)) == ["py3.11"]
    assert "# Left out: python x y = 1 , n 1, whose Python is not a version" in drafts.text_of(odd, TEMPLATE)
    assert unset is not None
    assert labels(planned(unset)) == ["py3.11.7_numpy-1.26.4", "py3.11.7_numpy-2.2.6"]


def test_legs_of_no_release_of_python_are_left_out() -> None:
    """PyPy and development versions are told; nothing is left of a workflow with no other."""
    some = drafted('{ python: ["3.11", "pypy-3.10"] }', "{ run: pip install . }")

    assert some
    assert (labels(planned(some)), some.notes) == (
        ["py3.11"],
        ("Left out: python pypy-3.10, whose Python is not a version such as 3.11.",),
    )
    assert drafted('{ python: ["3.15-dev"] }', "{ run: pip install . }") is None
