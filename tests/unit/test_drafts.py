"""The first matrix of a project: what is drafted is a matrix that plans."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from harness import drafts, matrixfile, plan, present
from harness.drafts import Case, Draft, Project
from harness.errors import BadInput
from harness.matrix import Expansion
from harness.model import Plan
from harness.vocabulary import GYMNASIUM, Instant
from harness.workflows import read

TEMPLATE = (Path(present.__file__).parent / "templates" / "matrix.toml.j2").read_text(encoding="utf-8")


def planned(draft: Draft, **versions: tuple[str, ...]) -> Plan:
    """The plan of a draft as it is written."""
    matrix = matrixfile.read(drafts.text_of(draft, TEMPLATE), "drafted.toml")
    axes = {name.replace("_", "-"): each for name, each in versions.items()}
    expansion = Expansion(matrix="drafted", instant=Instant("2026-11-20T00:00:00Z"), ranges=matrix.ranges, axes=axes)
    return plan.expand(matrix, expansion if versions else None, host_python="3.11.7")


def labels(found: Plan) -> list[str]:
    """The cells without the name of the matrix."""
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
        pytest.param("[tool.x]", "setup(**more)", Project(name="the-folder"), id="nothing said"),
        pytest.param("", "setup(", Project(name="the-folder"), id="no Python"),
    ],
)
def test_a_project_is_read_without_running_it(pyproject: str, setup: str, expected: Project) -> None:
    """From pyproject.toml, else from the literals of setup.py, else from the folder's name."""
    assert drafts.read_project(pyproject, setup, "The_Folder") == expected


def test_a_wrong_specifier_is_told() -> None:
    """One sentence that names the key."""
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

    assert list(drafts.registered(dedent(text))) == ["A-v0", "ns/B-v12"]
    assert list(drafts.registered("register(")) == []


def test_a_project_is_measured_at_what_it_claims() -> None:
    """Each package that counts is an axis with the project's own bounds; one axis is varied at a time."""
    project = drafts.read_project(PYPROJECT, "", "x")
    draft = drafts.of_project(project, Case(env="A-v0", api=GYMNASIUM, more=2))

    found = planned(draft, gymnasium=("1.0.0", "1.2.3"), mujoco=("3.3.7",))

    assert [(each.package, each.range, each.rule) for each in draft.ranges] == [
        ("gymnasium", "<2,>=1.0", "latest-patch"),
        ("mujoco", ">=0", "latest-minor"),
    ]
    assert labels(found) == [
        "py3.11-gymnasium1.0.0-mujoco3.3.7",
        "py3.11-gymnasium1.2.3-mujoco3.3.7",
        "py3.12-gymnasium1.2.3-mujoco3.3.7",
    ]
    assert [case.env for case in found.cells[0].cases] == ["A-v0"]
    assert found.cells[0].subject is not None
    assert "# 2 more are registered" in drafts.text_of(draft, TEMPLATE)


def test_a_project_that_says_nothing_is_imported_here() -> None:
    """Without Pythons, dependencies and environments there is one cell still."""
    found = planned(drafts.of_project(Project(name="quiet"), None))

    assert (labels(found), [case.env for case in found.cells[0].cases]) == (["py3.11.7"], [None])


# --- workflows -------------------------------------------------------------------------------------------------


def drafted(matrix: str, run: str, python: str = "${{ matrix.python }}") -> Draft | None:
    """The draft of a workflow with one job of two steps."""
    (job,) = read(
        f"jobs: {{ test: {{ strategy: {{ matrix: {matrix} }}, steps: ["
        f'{{ uses: "actions/setup-python@v5", with: {{ python-version: "{python}" }} }}, {run} ] }} }}',
        "ci.yml",
    )
    return drafts.of_legs(job.legs, "ci.yml", None)


def test_pins_of_every_leg_are_axes() -> None:
    """Combinations that the workflow does not have are excluded, with a reason."""
    draft = drafted(
        '{ python: ["3.10", "3.12"], np: ["1.26.4", "2.2.6"], exclude: [{ python: "3.12", np: "1.26.4" }] }',
        '{ run: "pip install -U pip numpy==${{ matrix.np }} scipy && pip install .[tests] -r more.txt" }',
    )
    assert draft
    found = planned(draft)

    assert labels(found) == ["py3.10-numpy1.26.4", "py3.10-numpy2.2.6", "py3.12-numpy2.2.6"]
    assert [(gone.id, gone.reason) for gone in found.dropped] == [
        ("drafted/py3.12-numpy1.26.4", "no leg of the workflow is so")
    ]
    assert (found.stale, draft.requirements, draft.extras) == ((), ("scipy",), ("tests",))
    assert draft.notes == ("Not taken over: more.txt.",)


def test_what_some_legs_install_is_a_bundle_named_by_it() -> None:
    """A label that is never installed is not among the names."""
    draft = drafted(
        '{ python: ["3.10", "3.11"], include: [{ gym: "1.2.3" }, { python: "3.10", gym: "0.29.1" }] }',
        '{ run: "pip install ." }, { if: "matrix.gym != \'1.2.3\'", run: "pip install gymnasium==${{ matrix.gym }} '
        "'numpy<2,>=1.21'\" }",
    )
    assert draft
    found = planned(draft)

    assert labels(found) == ["py3.10-gymnasium0.29.1-numpy-from1.21-below2", "py3.11-newest"]
    assert [cell.question.requirements for cell in found.cells] == [("gymnasium==0.29.1", "numpy<2,>=1.21"), ()]


def test_what_is_handed_on_is_taken_at_its_word_and_told() -> None:
    """A container gets the Python and numpy; what it does with them is not seen."""
    draft = drafted(
        '{ python: ["3.10"], numpy-version: [">=2.1", "<2"], mode: [fast] }',
        '{ run: "docker build --build-arg P=${{ matrix.python }} --build-arg N=${{ matrix.numpy-version }} ." }',
        python="3.12",
    )
    assert draft
    found = planned(draft)

    assert labels(found) == ["py3.12-numpy-from2.1", "py3.12-numpy-below2"]
    assert "numpy-version is handed to `docker build --build-arg ...`; it is taken at its word here." in draft.notes


def test_whatever_a_matrix_lists_makes_a_file_that_plans() -> None:
    """Lines and control characters stay inside comments; a Python that is not set up counts only where none is."""
    odd = drafted(
        '{ python: ["3.11", "x\\ny = 1 \\u0007"], n: [1, 2] }', "{ run: pip install numpy==1.26.$N, env: { N: 4 } }"
    )
    unset = drafted('{ np: ["1.26.4", "2.2.6"] }', '{ run: "pip install numpy==${{ matrix.np }}" }', python="")

    assert odd
    assert labels(planned(odd)) == ["py3.11"]
    assert "# Left out: python x y = 1 , n 1, whose Python is not a version" in drafts.text_of(odd, TEMPLATE)
    assert unset is not None
    assert labels(planned(unset)) == ["py3.11.7-numpy1.26.4", "py3.11.7-numpy2.2.6"]


def test_legs_of_no_release_of_python_are_left_out() -> None:
    """PyPy and development versions are told; nothing is left of a workflow with no other."""
    some = drafted('{ python: ["3.11", "pypy-3.10"] }', "{ run: pip install . }")

    assert some
    assert (labels(planned(some)), some.notes) == (
        ["py3.11"],
        ("Left out: python pypy-3.10, whose Python is not a version such as 3.11.",),
    )
    assert drafted('{ python: ["3.15-dev"] }', "{ run: pip install . }") is None
