"""Test which versions a workflow claims in its matrix, and which packages its steps install."""

from __future__ import annotations

from textwrap import dedent, indent
from typing import Any

import pytest

from harness.ci.workflows import Fate, Job, expressions, read, shell
from harness.ci.workflows.combinations import combinations
from harness.model.errors import BadInput

SETUP = """
- uses: actions/setup-python@v5
  with: { python-version: "${{ matrix.python }}" }
"""


def job(matrix: str, steps: str = SETUP, rest: str = "") -> Job:
    """Return the only job of a workflow."""
    text = f"on: push\njobs:\n  test:\n    runs-on: ubuntu-latest\n{indent(dedent(rest), '    ')}\n"
    text += f"    strategy:\n      matrix:\n{indent(dedent(matrix), '        ')}\n    steps:\n"
    (found,) = read(text + indent(dedent(steps), "      "), "ci.yml")
    return found


def fates(found: Job, name: str) -> list[tuple[str, Fate, str]]:
    """Return value, fate and reason of one axis, leg by leg."""
    return [(claim.value, claim.fate, claim.why) for leg in found.legs for claim in leg.claims if claim.name == name]


# --- GitHub's rules --------------------------------------------------------------------------------------------

AXES: dict[str, Any] = {"shape": ["ball", "cube"], "size": ["big", "small"]}


@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        pytest.param(AXES, ["ball big", "ball small", "cube big", "cube small"], id="the last axis turns fastest"),
        pytest.param(
            {**AXES, "exclude": [{"shape": "ball"}, {"shape": "cube", "size": "big"}]}, ["cube small"], id="in parts"
        ),
        pytest.param(
            {**AXES, "exclude": [{"shape": "ball"}], "include": [{"shape": "ball", "size": "big"}]},
            ["cube big", "cube small", "ball big"],
            id="what is excluded can be included again",
        ),
        pytest.param(
            {
                **AXES,
                "include": [
                    {"hue": "red"},
                    {"hue": "blue", "size": "big"},
                    {"shape": "ball", "form": "round"},
                    {"shape": "cone"},
                    {"shape": "cone", "size": "big"},
                    {"hue": "green", "form": "odd"},
                ],
            },
            [
                "ball big green odd",
                "ball small green odd",
                "cube big green odd",
                "cube small green odd",
                "cone",
                "cone big",
            ],
            id="added values are replaced, own ones never, and what was added is nothing to add to",
        ),
        pytest.param({"include": [{"a": 1}, {"b": 2}]}, ["1", "2"], id="include alone"),
        pytest.param({"a": [1, True, "1"], "exclude": [{"a": 1}]}, ["true", "1"], id="true and texts are no numbers"),
    ],
)
def test_combinations_are_those_of_github(matrix: dict[str, Any], expected: list[str]) -> None:
    """Exclusions first, in parts; then each entry of `include`, added where it replaces no value of an axis."""
    assert [" ".join(map(expressions.text_of, each.values.values())) for each in combinations(matrix)] == expected


@pytest.mark.parametrize(
    ("matrix", "note"),
    [
        ('python: ["3.10"]\nbackend: ${{ fromJSON(needs.plan.outputs.backends) }}', "matrix.backend: "),
        ("include: ${{ fromJSON(needs.plan.outputs.legs) }}", "matrix.include: "),
    ],
)
def test_a_matrix_made_by_another_job_is_reported(matrix: str, note: str) -> None:
    """A matrix that another job makes cannot be read."""
    found = job(matrix)

    assert (found.legs, len(found.notes)) == ((), 1)
    assert found.notes[0].startswith(note)
    assert found.notes[0].endswith(" is known only when the workflow runs")


def test_an_entry_meant_to_add_a_leg_is_reported() -> None:
    """It fits a leg whose own values it leaves alone, and takes away what an earlier entry had added."""
    found = job("python: ['3.10', '3.11']\ninclude: [{ gym: 1.2.3 }, { python: '3.10', gym: 0.29.1 }]")

    assert [str(leg.combination) for leg in found.legs] == ["python 3.10, gym 0.29.1", "python 3.11, gym 1.2.3"]
    assert found.notes == ("include[1] adds no combination: it replaces gym 1.2.3 by 0.29.1 on python 3.10",)


def test_a_version_that_yaml_shortens_is_reported() -> None:
    """3.10 without quotes is 3.1; `on` stays a text."""
    found = job("python: [3.9, 3.10]\nflag: [on, 2025-01-01]\nexclude: [{ python: 3.8 }]")

    assert [str(leg.combination) for leg in found.legs[::2]] == ["python 3.9, flag on", "python 3.1, flag on"]
    assert found.notes == (
        "python: 3.10 without quotes is the number 3.1, which is what GitHub uses",
        "exclude[0] leaves nothing out",
    )


# --- what is installed -----------------------------------------------------------------------------------------


def test_a_value_whose_step_is_left_out_is_never_installed() -> None:
    """The steps of each leg are those that its values do not turn off."""
    steps = """
    - name: older
      if: matrix.gym != '1.2.3'
      run: pip install gym==${{ matrix.gym }} "numpy<2"
    - run: pip install -e .[extra,tests]
    """
    found = job("python: ['3.11']\ngym: ['1.2.3', '0.29.1']", SETUP + dedent(steps))

    left_out = "the step \"older\", which would, is left out by `if: matrix.gym != '1.2.3'`"
    assert fates(found, "gym") == [("1.2.3", Fate.NEVER, left_out), ("0.29.1", Fate.INSTALLED, "")]
    assert [leg.requirements for leg in found.legs] == [(), ("gym==0.29.1", "numpy<2")]
    assert [(leg.python, leg.extras) for leg in found.legs] == [("3.11", ("extra", "tests"))] * 2


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        ("- run: pip install gymnasium==${{ matrix.gymnasium-version }}", (Fate.INSTALLED, "")),
        ("- run: uv pip install 'gymnasium[mujoco]==${{ matrix['gymnasium-version'] }}'", (Fate.INSTALLED, "")),
        ("- run: pip install gymnasium", (Fate.OTHERWISE, "installs any gymnasium")),
        ("- run: pip install gymnasium==0.29.1", (Fate.OTHERWISE, "installs gymnasium==0.29.1")),
        (
            "- run: |\n    pip install gymnasium==${{ matrix.gymnasium-version }}\n    pip install 'gymnasium<1'",
            (Fate.OTHERWISE, "installs gymnasium<1"),
        ),
        (
            "- run: pip install gymnasium==${{ matrix.gymnasium-version }}\n- run: pip install gymnasium .",
            (Fate.INSTALLED, ""),
        ),
        ("- run: echo ${{ runner.os }}\n  name: ${{ matrix.gymnasium-version }}",
         (Fate.NEVER, "no step uses matrix.gymnasium-version")),
        ("- run: make ${{ matrix.gymnasium-version }}", (Fate.HANDED_ON, "`make 1.2.3`")),
        ("- run: GYM=1 pip install gymnasium==$GYM\n  env: { GYM: '${{ matrix.gymnasium-version }}' }",
         (Fate.INSTALLED, "")),
        ("- run: pip install gymnasium==${{ env.GYM }}\n  env: { GYM: '${{ matrix.gymnasium-version }}' }",
         (Fate.INSTALLED, "")),
        ("- run: ./install.sh\n  env: { GYM: '${{ matrix.gymnasium-version }}' }",
         (Fate.HANDED_ON, "environment variables")),
        ("- uses: ./.github/setup\n  with: { gym: '${{ matrix.gymnasium-version }}' }",
         (Fate.HANDED_ON, "./.github/setup")),
        ("- run: |\n    pip install \\\n      gymnasium==${{ matrix.gymnasium-version }}  # so", (Fate.INSTALLED, "")),
        ("- run: conda install -y gymnasium=${{ matrix.gymnasium-version }}", (Fate.INSTALLED, "")),
        ("- run: pip install ${{ toJSON(matrix) }}", (Fate.INSTALLED, "")),
    ],
)  # fmt: skip
def test_the_use_of_a_value_in_a_workflow(steps: str, expected: tuple[Fate, str]) -> None:
    """Installed, installed otherwise, handed to what cannot be seen into, or never."""
    found = job("gymnasium-version: ['1.2.3']", steps)

    assert fates(found, "gymnasium-version") == [("1.2.3", *expected)]


def test_a_python_set_up_otherwise_is_reported() -> None:
    """A fixed Python makes legs that are all the same."""
    fixed = '- uses: actions/setup-python@v5\n  with: { python-version: "3.10" }\n'

    assert fates(job("python: ['3.10', '3.11']", fixed), "python") == [
        ("3.10", Fate.NEVER, "no step uses matrix.python"),
        ("3.11", Fate.OTHERWISE, "sets up Python 3.10"),
    ]
    assert fates(job("python: ['3.12']", "- run: uv venv --python ${{ matrix.python }}"), "python") == [
        ("3.12", Fate.INSTALLED, "")
    ]


def test_labels_and_switches_are_no_claims_of_versions() -> None:
    """A value that names a leg, or chooses its runner or its steps, counts as used."""
    found = job(
        "os: [ubuntu-22.04]\nname: [oldest]\nslow: [true]\nbackend: [egl]",
        "- run: pytest\n  if: matrix.slow",
        "runs-on: ${{ matrix.os }}\nname: ${{ matrix.name }}\n".replace("runs-on", "container"),
    )

    assert {name: fates(found, name)[0][1] for name in ("os", "name", "slow", "backend")} == {
        "os": Fate.HANDED_ON,
        "name": Fate.HANDED_ON,
        "slow": Fate.HANDED_ON,
        "backend": Fate.NEVER,
    }


def test_jobs_without_a_matrix_are_left_out() -> None:
    """Each job is told by itself; one that only runs things claims nothing."""
    text = "jobs:\n  a: { strategy: { matrix: { x: [1] } }, steps: [] }\n  b: { steps: [] }\n"

    assert [found.name for found in read(text, "ci.yml")] == ["a"]


@pytest.mark.parametrize("steps", ["3", "text", "[null, [1], text, { run: 3, env: x, with: [] }, { if: [] }]", "null"])
def test_steps_of_any_shape_are_read(steps: str) -> None:
    """Malformed steps are skipped, and a matrix may list values of any type."""
    text = f"jobs: {{ a: {{ env: 3, strategy: {{ matrix: {{ x: [null, [1], {{}}] }} }}, steps: {steps} }} }}"

    assert {claim.fate for leg in read(text, "ci.yml")[0].legs for claim in leg.claims} == {Fate.NEVER}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("jobs: [", "ci.yml:1: expected the node content, but found '<stream end>'"),
        ("a: 1", "ci.yml: there are no jobs; is it a workflow of GitHub?"),
        ("jobs: { a: {}, b: {} }", "ci.yml: none of its jobs (a, b) has a strategy.matrix"),
    ],
)
def test_a_file_that_is_no_workflow_is_refused(text: str, message: str) -> None:
    """One sentence with the file, instead of a traceback."""
    with pytest.raises(BadInput) as caught:
        read(text, "ci.yml")

    assert str(caught.value) == message


# --- expressions and commands ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("matrix.v == '1.0'", True),
        ("${{ matrix.v == '1.0' && matrix.n == 3 }}", True),
        ("matrix.V != '1.0' || !matrix.flag", False),
        ("matrix.missing == ''", True),
        ("matrix.n == '3'", True),
        ("matrix.word == 'TEXT'", True),
        ('contains(fromJSON(\'["1.0", "2"]\'), matrix.v)', True),
        ("startsWith(matrix.v, '2') || endsWith(matrix.v, '.0')", True),
        ("github.event_name == 'push'", None),
        ("github.event_name == 'push' && matrix.v == '2'", False),
        ("always() || github.ref", True),
        ("failure()", False),
        ("(matrix.n < 4) == true", True),
        ("matrix.inner.key == 'x' && matrix.inner['key'] == 'x'", True),
        ("matrix.list[1] == 'b'", True),
        ("format('{0}-{1}', matrix.v, 'x') == '1.0-x'", True),
        ("'it''s' == matrix.v", False),
        ("matrix.v ==", None),
        ("matrix.v === '1.0'", None),
        ("${{ matrix.v }} == '1.0'", None),
        (True, True),
    ],
)
def test_conditions_are_decided_as_far_as_the_matrix_tells(condition: object, expected: bool | None) -> None:
    """A condition that needs GitHub's own data is neither true nor false."""
    inner = {"inner": {"key": "x"}, "list": ["a", "b"]}
    matrix = {"v": "1.0", "n": 3, "flag": True, "word": "text", **inner}

    assert expressions.holds(condition, {"matrix": matrix}) is expected


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("python -m pip install -U pip wheel && pip3 install a==1 -r more.txt", [["pip", "wheel"], ["a==1"]]),
        ("uv pip install --system torch==2.9.1+cpu --index https://x/y", [["torch==2.9.1+cpu"]]),
        ("sudo X=1 pip install 'b>=1,<2' # not c", [["b>=1,<2"]]),
        ("if command; then pip install d; else pip install e; fi", [["d"], ["e"]]),
        (
            'if [ "1" = "2" ]; then\n  pip install d\nelif [ 1 != 2 ]; then pip install e\nelse pip install f; fi',
            [["e"]],
        ),
        ('if [ "$X" = "2" ] || [ 1 = 2 ]; then pip install d; fi; pip install e', [["d"], ["e"]]),
        ('if [ "1" = "2" ] || test -z ""; then pip install d; fi', [["d"]]),
        ('if [[ -n "" ]]; then\n  if true; then pip install d; fi\nfi', []),
        ("pip download e; pip list; echo pip install f", []),
        ("echo 'open\npip install g", [["g"]]),
    ],
)
def test_commands_that_install(script: str, expected: list[list[str]]) -> None:
    """The packages that pip, uv and conda install are read, without the options."""
    found = [shell.install(words) for words in shell.commands(script)]

    assert [list(each.words) for each in found if each] == expected
