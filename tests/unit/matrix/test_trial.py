"""The one cell of `try`: its name, its cases, and what is refused."""

from pathlib import Path
from typing import Any

import pytest

from harness.commands.ad_hoc_cell import models
from harness.matrix import plan
from harness.matrix.plan.adapter_choice import declared_ids
from harness.model import Case, Question
from harness.model.errors import BadInput
from harness.model.vocabulary import APIS, api_of, checks_of


def request(*requirements: str, python: str = "3.11", **more: Any) -> plan.TrialOptions:
    """Return the request that a command line makes."""
    return plan.TrialOptions(requirements=requirements, python=python, **more)


def cases(*requirements: str, **more: Any) -> list[tuple[str, str | None]]:
    """Return API and environment of each case."""
    return [(case.api, case.env) for case in plan.cases_for(request(*requirements, **more))]


def test_one_cell_named_by_what_is_pinned() -> None:
    """Python and pinned packages are the axes and the name; the rest is the question."""
    found = plan.single(
        request(
            "gymnasium[mujoco]==1.2.3",
            "mujoco==3.3.7",
            "scipy>=1",
            envs=("Ant-v5",),
            environment={"MUJOCO_GL": "egl"},
            constraints=("numpy<2",),
            only_binary=("MuJoCo",),
            as_of="2026-11-20",
        )
    )
    (cell,) = found.cells

    assert (found.matrix, found.axes) == ("try", ("python", "gymnasium", "mujoco"))
    assert cell.id.startswith(
        "try/py3.11_gymnasium.mujoco-1.2.3_mujoco-3.3.7_scipy-ge1_+as-of-2026-11-20_+constraint-numpy-lt2_+env-Ant-v5_"
    )
    assert cell.axes == {"python": "3.11", "gymnasium": "1.2.3", "mujoco": "3.3.7"}
    assert cell.environment == {"MUJOCO_GL": "egl"}
    assert cell.cases == (
        Case(id="Ant-v5", env="Ant-v5", api="gymnasium", packages=("mujoco", "scipy"), checks=checks_of(())),
    )
    assert cell.question == Question(
        requirements=("gymnasium[mujoco]==1.2.3", "mujoco==3.3.7", "scipy>=1"),
        constraints=("numpy<2",),
        only_binary=("mujoco",),
        snapshot="2026-11-20T23:59:59Z",
    )


def test_a_model_of_ones_own_goes_into_the_cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`mujoco:FILE.xml` is read from the user's folder and put under the same name into the cell's HOME."""
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm/scene.xml").write_text("<mujoco/>", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    found = models(trial_cases("mujoco", "mujoco:./arm/scene.xml", "mujoco:markers"))
    assert found == models(trial_cases("mujoco", "./arm/scene.xml")) == {"arm/scene.xml": "<mujoco/>"}
    (cell,) = plan.single(request("mujoco==3.3.7", envs=("mujoco:arm/scene.xml",), files=found)).cells
    assert cell.files == found


@pytest.mark.parametrize(
    ("env", "message"),
    [
        ("mujoco:a.xml", "--env mujoco:a.xml: a.xml: cannot be read: No such file or directory"),
        ("a.xml", "--env a.xml: a.xml: cannot be read: No such file or directory"),
        ("mujoco:/a.xml", '--env mujoco:/a.xml: "/a.xml" is not a relative path inside the folder'),
        ("mujoco:latin.xml", "--env mujoco:latin.xml: latin.xml: is not UTF-8 text"),
    ],
)
def test_a_model_that_cannot_be_carried_is_refused(
    env: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that is not there, or outside the folder, is a mistake of the command line, not of a package."""
    (tmp_path / "latin.xml").write_bytes(b"<mujoco model='\xe4'/>")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput) as raised:
        models(trial_cases("mujoco", env))
    assert str(raised.value) == message


def test_a_model_that_the_simulator_brings_is_not_looked_for_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`pybullet:mjcf/ant.xml` is one of pybullet_data, a file of that name in this folder the user's own."""
    monkeypatch.chdir(tmp_path)
    named = trial_cases("pybullet", "pybullet:mjcf/ant.xml", "pybullet:arm.urdf", "pybullet:direct")
    assert models(named) == {}
    (tmp_path / "arm.urdf").write_text("<robot/>", encoding="utf-8")
    assert models(named) == {"arm.urdf": "<robot/>"}


def trial_cases(requirement: str, *envs: str) -> tuple[Case, ...]:
    """Return the cases of a trial."""
    return plan.single(request(requirement, envs=envs)).cells[0].cases


def test_long_names_are_cut_and_stay_distinct() -> None:
    """A label has at most 150 characters, and two long ones that differ at the end differ."""
    many = [f"package-number-{number}==1.{number}" for number in range(20)]
    first, second = (plan.single(request(*many, last)).cells[0].label for last in ("x==1", "x==2"))

    assert (len(first), len(second), first[:141] == second[:141], first == second) == (150, 150, True, False)


@pytest.mark.parametrize(
    ("requirements", "more", "expected"),
    [
        pytest.param(["gymnasium"], {}, [("gymnasium", "CartPole-v1")], id="gymnasium"),
        pytest.param(
            ["gymnasium[mujoco]==1.2.3", "mujoco==3.3.7"],
            {},
            [("gymnasium", "CartPole-v1"), ("gymnasium", "Ant-v5")],
            id="gymnasium-mujoco",
        ),
        pytest.param(
            ["gymnasium", "mujoco"], {}, [("gymnasium", "CartPole-v1"), ("gymnasium", "Ant-v5")], id="mujoco-beside"
        ),
        pytest.param(
            ["gymnasium[mujoco]<1.0"],
            {},
            [("gymnasium", "CartPole-v1"), ("gymnasium", "Ant-v4")],
            id="gymnasium-before-1",
        ),
        pytest.param(
            ["gymnasium[mujoco]>1.1,<1.3"],
            {},
            [("gymnasium", "CartPole-v1"), ("gymnasium", "Ant-v5")],
            id="gymnasium-between",
        ),
        pytest.param(
            ["gymnasium[mujoco]"],
            {"constraints": ("gymnasium==0.29.1",)},
            [("gymnasium", "CartPole-v1"), ("gymnasium", "Ant-v4")],
            id="gymnasium-constrained",
        ),
        pytest.param(
            ["gymnasium[mujoco]"],
            {"python": "3.7"},
            [("gymnasium", "CartPole-v1"), ("gymnasium", "Ant-v4")],
            id="old-python",
        ),
        pytest.param(
            ["gymnasium[mujoco]"],
            {"as_of": "2024-01-01"},
            [("gymnasium", "CartPole-v1"), ("gymnasium", "Ant-v4")],
            id="as-of-before-1",
        ),
        pytest.param(["gym[mujoco]==0.26.2"], {}, [("gym", "CartPole-v1"), ("gym", "Ant-v4")], id="gym-mujoco"),
        pytest.param(["gym[mujoco]==0.21.0"], {}, [("gym", "CartPole-v1")], id="gym-of-mujoco-py"),
        pytest.param(["gym", "gymnasium"], {}, [("gym", "CartPole-v1")], id="first-of-both"),
        pytest.param(["gym", "gymnasium"], {"api": "gymnasium"}, [("gymnasium", "CartPole-v1")], id="api-asked-for"),
        pytest.param(
            ["gymnasium"],
            {"envs": ("gym:Ant-v4", "Pong", "gymnasium:Ant-v4", "Pong")},
            [("gym", "gym:Ant-v4"), ("gymnasium", "Pong"), ("gymnasium", "gymnasium:Ant-v4")],
            id="prefixes",
        ),
        pytest.param(["highway-env"], {"envs": ("highway-v0",)}, [("gymnasium", "highway-v0")], id="unknown-package"),
        pytest.param(["scipy", "numpy"], {}, [("", None), ("", None)], id="no-api"),
        pytest.param(["mujoco", "numpy"], {}, [("mujoco", "mujoco:markers")], id="an-adapter"),
        pytest.param(
            ["dm-control", "mujoco==3.3.7"],
            {},
            [("dm_control", "dm_control:cheetah/run")],
            id="mujoco-beneath",
        ),
        pytest.param(
            ["gym==0.21.0", "pybullet"],
            {},
            [("gym", "CartPole-v1"), ("pybullet", "pybullet:direct")],
            id="gym-and-an-adapter",
        ),
        pytest.param(["pettingzoo"], {}, [("", None)], id="nothing-that-pettingzoo-alone-can-run"),
        pytest.param(
            ["pettingzoo[classic]"], {}, [("pettingzoo", "pettingzoo:classic/rps_v2")], id="pettingzoo-and-pygame"
        ),
        pytest.param(["robosuite"], {"envs": ("Lift",)}, [("robosuite", "Lift")], id="meant"),
        pytest.param(
            ["dm-control", "mujoco"],
            {"envs": ("cheetah/run", "scene.xml")},
            [("dm_control", "cheetah/run"), ("mujoco", "scene.xml")],
            id="meant-by-its-form",
        ),
        pytest.param(
            ["robosuite", "gymnasium"], {"envs": ("Lift",)}, [("gymnasium", "Lift")], id="may-be-gymnasium's-too"
        ),
        pytest.param(
            ["mujoco", "mujoco-mjx"],
            {"envs": ("scene.xml",), "api": "mjx"},
            [("mjx", "scene.xml")],
            id="may-be-of-two-adapters",
        ),
        pytest.param(
            ["highway-env", "robosuite"],
            {"envs": ("Lift", "highway-v0", "pybullet:direct"), "brought": "gym"},
            [("robosuite", "Lift"), ("gym", "highway-v0"), ("pybullet", "pybullet:direct")],
            id="brought-by-another",
        ),
        pytest.param(["my-robots"], {"envs": ("robots:make",)}, [("gymnasium", "robots:make")], id="a-callable"),
    ],
)
def test_cases_follow_from_what_is_asked_for(
    requirements: list[str], more: dict[str, Any], expected: list[tuple[str, str | None]]
) -> None:
    """Environments asked for are tried; else those that API and versions suggest; else modules are imported."""
    assert cases(*requirements, **more) == expected


@pytest.mark.parametrize(
    ("requirements", "drawn"),
    [
        pytest.param(["gymnasium"], False, id="no-extra"),
        pytest.param(["gymnasium[mujoco]"], False, id="another-extra"),
        pytest.param(["gymnasium[classic-control]"], True, id="its-extra"),
        pytest.param(["gym[classic_control]"], True, id="its-extra-of-gym"),
        pytest.param(["gymnasium", "pygame"], True, id="the-library-itself"),
    ],
)
def test_cartpole_is_drawn_where_its_drawing_library_is_asked_for(requirements: list[str], drawn: bool) -> None:
    """Nobody who asks for gymnasium alone is told that pygame is missing."""
    suggested = plan.cases_for(request(*requirements))[0]

    assert ("render.rgb_array" in suggested.checks) is drawn


def test_modules_of_packages_without_an_api() -> None:
    """Of each package the modules that it installs are imported, in a case of its own."""
    assert [(case.id, case.packages, case.checks) for case in plan.cases_for(request("scipy==1.0", "PyYAML"))] == [
        ("import-scipy", ("scipy",), ("import.modules",)),
        ("import-pyyaml", ("pyyaml",), ("import.modules",)),
    ]


def test_modules_asked_for() -> None:
    """`--import` replaces the guess, and comes before environments."""
    alone = plan.cases_for(request("dm-control", imports=("dm_control.suite",)))
    before = plan.cases_for(request("gymnasium-robotics", imports=("gymnasium_robotics",), envs=("FetchReach-v4",)))

    assert [(case.env, case.imports) for case in (*alone, *before)] == [
        (None, ("dm_control.suite",)),
        ("FetchReach-v4", ("gymnasium_robotics",)),
    ]


def test_ids_of_cases_stay_distinct() -> None:
    """Two environments whose ids look alike in a folder name get a number."""
    found = plan.cases_for(request("gymnasium", envs=("a/b", "a:b", "A-b")))

    assert [case.id for case in found] == ["a-b", "a-b-2", "A-b-3"]


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (request(), "try: name at least one requirement, such as 'gymnasium[mujoco]==1.2.3'"),
        (
            request("numpy=1"),
            'try: "numpy=1" is not a requirement: Expected semicolon (after name with no version specifier) or end',
        ),
        (
            request("numpy", constraints=("x y",)),
            '--constraint: "x y" is not a requirement: '
            "Expected semicolon (after name with no version specifier) or end",
        ),
        (request("numpy", only_binary=("a b",)), '--only-binary: "a b" is not the name of a package'),
        (request("numpy", environment={"1A": ""}), '--set: "1A" is not the name of an environment variable'),
        (request("numpy", imports=("a-b",)), '--import: "a-b" is not the name of a Python module'),
        (request("numpy", api="gymnasim"), '--api: unknown API "gymnasim"; did you mean "gymnasium"?'),
        (request("gymnasium", envs=("//",)), '--env: "//" is not the id of an environment'),
        (
            request("gym", envs=("gym:x",), api="gymnasium"),
            '--env: "gym:x" names the API "gym", but "gymnasium" is asked for',
        ),
        (
            request("numpy", as_of="soon"),
            '--as-of: "soon" is not a date such as 2026-11-20 nor a moment such as 2026-11-20T12:00:00Z',
        ),
    ],
)
def test_mistakes_name_the_option(wrong: plan.TrialOptions, sentence: str) -> None:
    """A mistake on the command line is told with the option that holds it."""
    with pytest.raises(BadInput) as error:
        plan.single(wrong)

    assert str(error.value) == sentence


@pytest.mark.parametrize(
    ("requirements", "envs", "untold"),
    [
        pytest.param(["highway-env"], ("highway-v0",), "highway-v0", id="nothing-tells"),
        pytest.param(["dm-control"], ("cheetah/run", "walker"), "walker", id="not-a-domain-and-a-task"),
        pytest.param(["mujoco", "mujoco-mjx"], ("scene.xml",), "scene.xml", id="two-adapters-read-it"),
        pytest.param(["pybullet"], ("pybullet:direct", "direct", "a1/a1.urdf"), None, id="all-tell"),
        pytest.param(["gym", "pybullet"], ("AntBulletEnv-v0",), None, id="a-family-is-asked-for"),
    ],
)
def test_environments_of_which_nothing_tells_the_api(
    requirements: list[str], envs: tuple[str, ...], untold: str | None
) -> None:
    """An API is inferred where it cannot be mistaken; the first environment where it can is named."""
    assert plan.unspoken(request(*requirements, envs=envs)) == untold


def test_rows_of_adapters() -> None:
    """Each row names an adapter, and its example is an id that tells it, in the form that it says."""
    assert {row.api for row in declared_ids()} <= set(APIS)
    for row in declared_ids():
        assert api_of(row.example, None) == row.api
