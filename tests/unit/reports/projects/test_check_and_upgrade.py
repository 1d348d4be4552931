"""Test what measured results say about a project, and about an upgrade of it, over small documents of known cells."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import msgspec
import pytest
from builders import measured_case, measured_cell

from harness.model.measured import Measured, MeasuredCell, ReleaseSeries, SeriesStep
from harness.reports.answers import digest
from harness.reports.projects import check_document, checked, upgrade_document, upgraded, upgraded_text
from harness.reports.projects.check_document import Checked, CheckFinding, Kind
from harness.reports.projects.project import Declared, Project
from harness.reports.projects.tried_task import TriedTask
from harness.reports.projects.upgrade_document import Move, Upgraded
from harness.standalone.versions import specifiers

ALL = {"import": "passed", "single": "passed", "vector": "passed", "render": "passed"}
BROKEN = {"import": "passed", "single": "failed", "vector": "not_reached", "render": "not_reached"}


class World:
    """Cells with their locks, and series of releases, as a document."""

    def __init__(self) -> None:
        self.cells: list[MeasuredCell] = []
        self.locks: dict[str, str] = {}
        self.series: list[ReleaseSeries] = []

    def add(self, python: str, pins: Mapping[str, str], *, fails: Mapping[str, str] | None = None, **more: Any) -> str:
        """Add a cell in which Ant-v5 and Hopper-v5 were tried; `fails` has the line of each that fails."""
        text = "".join(
            f"{name}=={version} \\\n    --hash=sha256:{hashlib.sha256(f'{name}{version}'.encode()).hexdigest()}\n"
            for name, version in sorted(pins.items())
        )
        sha = hashlib.sha256(text.encode()).hexdigest()
        self.locks[sha] = text
        broken = fails or {}
        cases = [
            measured_case(
                env,
                env,
                phases=BROKEN if env in broken else ALL,
                decisive=broken.get(env),
                exercised=sorted(pins),
            )
            for env in ("Ant-v5", "Hopper-v5")
        ]
        verdict = "works" if not broken else "partial" if len(broken) == 1 else "broken"
        axes = {"python": python, **{name: version for name, version in pins.items() if name != "numpy"}}
        label = "_".join(f"{name}-{version}" for name, version in pins.items())
        cell = measured_cell(
            f"py{python}_{label}", verdict, f"{python}.7", measured="2026-11-21T12:00:00Z", axes=axes, lock=sha,
            cases=cases, phases=BROKEN if broken else ALL, phase="single" if broken else None,
            decisive=next(iter(broken.values()), None), **more,
        )  # fmt: skip
        self.cells.append(cell)
        return cell.id

    def changes_at(self, release: str, env: str = "Ant-v5", *, pictures: bool = False) -> None:
        """Add a series of mujoco 3.1 to 3.4 in which an environment changes at a release."""
        releases = ("3.1.0", "3.2.0", "3.3.0", "3.4.0")
        before = releases[releases.index(release) - 1] if release in releases else releases[0]
        self.series.append(
            ReleaseSeries(
                matrix="drift", env=env, api="gymnasium", package="mujoco", where={"gymnasium": "1.2.0"},
                releases=releases, families=tuple("A" if each < release else "B" for each in releases),
                steps=(SeriesStep(before=before, after=release, kind="changed", text="moves otherwise in 40%"),)
                if release in releases
                else (),
                pictures=pictures,
            )
        )  # fmt: skip

    @property
    def measured(self) -> Measured:
        """Return the document."""
        document = digest.with_locks("", {}, sorted(self.cells, key=lambda cell: cell.id), self.locks)
        return msgspec.structs.replace(document, series=tuple(self.series))

    def check(self, here: Project, env: str | None = None) -> Checked:
        """Return what is known of a project."""
        return checked.check(self.measured, here, env)

    def upgrade(self, here: Project, *texts: str, env: str | None = None) -> Upgraded:
        """Return what is known of an upgrade."""
        moves = [upgraded.target(text, here, self.measured) for text in texts]
        return upgraded.upgrade(self.measured, here, moves, ("install it",), env)


def project(python: str | None = "3.11.7", **packages: str) -> Project:
    """Return a project of packages, by version or by specifiers; NumPy 2.2.6 is pinned unless another is given."""
    texts = {"gymnasium": "1.2.0", "numpy": "2.2.6", **packages}
    declared = {}
    for name, text in texts.items():
        pinned = text if text[:1].isdigit() else None
        declared[name] = Declared(name=name, versions=specifiers(f"=={pinned}" if pinned else text), pinned=pinned)
    return Project(source="requirements.txt", packages=declared, pythons=specifiers(""), python=python)


def kinds(document: Checked) -> list[str]:
    """Return the kinds of the findings."""
    return [finding.kind for finding in document.findings]


def only(document: Checked, kind: Kind) -> CheckFinding:
    """Return the only finding of a kind."""
    (finding,) = [finding for finding in document.findings if finding.kind is kind]
    return finding


@pytest.fixture
def world() -> World:
    """Return a world without measurements."""
    return World()


# --- check -----------------------------------------------------------------------------------------------------


def test_pinned_versions_that_were_measured_are_good(world: World) -> None:
    """The same versions on the same Python: good, with the cell; another Python was never measured."""
    cell = world.add("3.11", {"gymnasium": "1.2.0", "mujoco": "3.2.0", "numpy": "2.2.6"})

    document = world.check(project(mujoco="3.2.0"))
    assert (kinds(document), check_document.exit_code(document)) == ([Kind.GOOD], 0)
    assert only(document, Kind.GOOD).cells == (cell,)
    assert document.findings[0].text == "gymnasium 1.2.0, mujoco 3.2.0 run 2 tasks: Ant-v5, Hopper-v5"

    other = world.check(project("3.12.1", mujoco="3.2.0"))
    assert (kinds(other), check_document.exit_code(other)) == ([Kind.UNMEASURED], 3)
    assert "nearest that works: gymnasium 1.2.0, mujoco 3.2.0 on Python 3.11" in other.findings[0].text


def test_another_numpy_of_the_same_first_number_is_named(world: World) -> None:
    """NumPy 2.4 stands for 2.2, which is said; NumPy 1 does not, nor does 1.23 for 1.26."""
    world.add("3.11", {"gymnasium": "1.2.0", "mujoco": "3.2.0", "numpy": "2.4.6"})

    near = world.check(project(mujoco="3.2.0"))
    assert only(near, Kind.GOOD).text.endswith("measured with numpy 2.4.6 (here 2.2.6)")
    assert kinds(world.check(project(mujoco="3.2.0", numpy="1.26.4"))) == [Kind.UNMEASURED]

    world.add("3.11", {"gymnasium": "1.2.0", "mujoco": "3.1.0", "numpy": "1.23.5"})
    assert kinds(world.check(project(mujoco="3.1.0", numpy="1.26.4"))) == [Kind.UNMEASURED]


def test_pinned_versions_that_fail_are_bad(world: World) -> None:
    """One of two tasks fails: it is named with the line that says why, and the other one is still good."""
    world.add(
        "3.11", {"gymnasium": "1.2.0", "mujoco": "3.2.0", "numpy": "2.2.6"}, fails={"Hopper-v5": "ValueError: no"}
    )

    document = world.check(project(mujoco="3.2.0"))
    assert (kinds(document), check_document.exit_code(document)) == ([Kind.BAD, Kind.GOOD], 1)
    bad = only(document, Kind.BAD)
    assert bad.text.endswith("1 of 2 tasks fail: Hopper-v5")
    assert bad.line == "ValueError: no"
    assert kinds(world.check(project(mujoco="3.2.0"), env="Ant-v5")) == [Kind.GOOD]


@pytest.mark.parametrize(
    "line",
    [
        "gym.error.NamespaceNotFound: Namespace ALE not found.",
        "gymnasium.error.DependencyNotInstalled: Box2D is not installed",
        'gym.error.Error: We\'re Unable to find the game "Pong".',
    ],
)
def test_a_task_that_lacks_what_it_alone_needs(world: World, line: str) -> None:
    """It says nothing of the versions, and is left out unless it is the one in question."""
    world.add("3.11", {"gymnasium": "1.2.0", "mujoco": "3.2.0", "numpy": "2.2.6"}, fails={"Hopper-v5": line})

    assert kinds(world.check(project(mujoco="3.2.0"))) == [Kind.GOOD]
    assert kinds(world.check(project(mujoco="3.2.0"), env="Hopper-v5")) == [Kind.BAD]


def test_a_typed_line_that_fails_is_no_fault_of_versions_that_a_matrix_varies(world: World) -> None:
    """It may have a wrong id, or a package that the project lacks."""
    pins = {"gymnasium": "1.2.0", "mujoco": "3.2.0", "numpy": "2.2.6"}
    world.add("3.11", pins)
    fails = dict.fromkeys(("Ant-v5", "Hopper-v5"), "AttributeError: of PyOpenGL")
    requirements = ("gymnasium==1.2.0", "mujoco==3.2.0", "pyopengl==3.1.0")
    world.add("3.11", {**pins, "pyopengl": "3.1.0"}, fails=fails, requirements=requirements)
    own = kinds(world.check(project(mujoco=">=3.2")))
    world.cells[-1] = msgspec.structs.replace(world.cells[-1], axes={"python": "3.11", "packages": "typed"})

    assert own == [Kind.ADMITS, Kind.GOOD]
    assert kinds(world.check(project(mujoco=">=3.2"))) == [Kind.GOOD]


def test_a_range_that_admits_a_broken_release(world: World) -> None:
    """mujoco>=3.1 admits 3.3.0, which is broken; the bound that keeps it out is named."""
    world.add("3.11", {"gymnasium": "1.2.0", "mujoco": "3.2.0", "numpy": "2.2.6"})
    broken = dict.fromkeys(("Ant-v5", "Hopper-v5"), "ValueError: gone")
    world.add("3.11", {"gymnasium": "1.2.0", "mujoco": "3.3.0", "numpy": "2.2.6"}, fails=broken)

    document = world.check(project(mujoco=">=3.1"))
    admits = only(document, Kind.ADMITS)
    assert (admits.bound, admits.line, check_document.exit_code(document)) == ("mujoco<3.3.0", "ValueError: gone", 1)
    assert only(document, Kind.GOOD).versions["mujoco"] == "3.2.0"
    assert kinds(world.check(project(mujoco=">=3.1,<3.3"))) == [Kind.GOOD]


def test_a_bound_that_keeps_out_what_works(world: World) -> None:
    """mujoco<3.2 keeps out 3.3.0, which works with all the rest: a note, which is no fault."""
    for release in ("3.1.0", "3.3.0"):
        world.add("3.11", {"gymnasium": "1.2.0", "mujoco": release, "numpy": "2.2.6"})

    document = world.check(project(mujoco="<3.2"))
    assert only(document, Kind.EXCLUDES).versions["mujoco"] == "3.3.0"
    assert check_document.exit_code(document) == 0


def test_a_range_across_a_boundary_of_behaviour(world: World) -> None:
    """A range with releases on both sides of 3.3.0, where Ant-v5 changes; a pin crosses nothing."""
    for release in ("3.2.0", "3.3.0"):
        world.add("3.11", {"gymnasium": "1.2.0", "mujoco": release, "numpy": "2.2.6"})
    world.changes_at("3.3.0")
    world.changes_at("9", env="Hopper-v5")

    document = world.check(project(mujoco=">=3.1"))
    crossing = only(document, Kind.CHANGES)
    assert "1 of 2 tasks behave otherwise: Ant-v5 (at 3.3.0)" in crossing.text
    assert (crossing.bound, check_document.exit_code(document)) == ("mujoco>=3.3.0", 1)
    assert Kind.CHANGES not in kinds(world.check(project(mujoco=">=3.3")))
    assert Kind.CHANGES not in kinds(world.check(project(mujoco="3.3.0")))


def test_a_module_that_a_red_cell_lacked_is_no_fault_where_it_is_installed(world: World) -> None:
    """A cell that failed for want of imageio says nothing of a project that has it."""
    broken = dict.fromkeys(("Ant-v5", "Hopper-v5"), "ModuleNotFoundError: No module named 'imageio'")
    world.add("3.11", {"gymnasium": "1.2.0", "mujoco": "3.2.0", "numpy": "2.2.6"}, fails=broken)

    assert Kind.BAD in kinds(world.check(project(mujoco="3.2.0")))
    assert Kind.BAD not in kinds(world.check(project(mujoco="3.2.0", imageio="2.37.0")))


def test_a_larger_set_that_never_worked_hides_no_smaller_one(world: World) -> None:
    """Three packages that were measured together and never worked: the two that do are still found."""
    world.add("3.11", {"gymnasium": "1.2.0", "mujoco": "3.2.0", "numpy": "2.2.6"})
    world.add(
        "3.9", {"gymnasium": "0.29.0", "mujoco": "2.3.0", "robosuite": "1.4.0", "numpy": "1.26.4"},
        fails={"Ant-v5": "no", "Hopper-v5": "no"},
    )  # fmt: skip

    assert kinds(world.check(project(mujoco="3.2.0", robosuite="1.5.0"))) == [Kind.GOOD]


def test_nothing_known_of_a_project(world: World) -> None:
    """A project of packages that were never run: exit code 3, and they are named."""
    document = world.check(project(wandb="0.1"))

    assert (document.findings, check_document.exit_code(document)) == ((), 3)
    assert document.not_run == ("gymnasium", "numpy", "wandb")


# --- upgrade ---------------------------------------------------------------------------------------------------


def test_an_upgrade_that_changes_nothing(world: World) -> None:
    """Both releases measured, the same families: 0, and the newest such release is named."""
    for release in ("3.1.0", "3.2.0", "3.3.0"):
        world.add("3.11", {"gymnasium": "1.2.0", "mujoco": release, "numpy": "2.2.6"})
    for env in ("Ant-v5", "Hopper-v5"):
        world.changes_at("3.4.0", env=env)

    document = world.upgrade(project(mujoco="3.1.0"), "mujoco==3.2.0")
    assert {task.env for task in document.running if task.works} == {"Ant-v5", "Hopper-v5"} == {*document.tasks}
    assert document.behaviour.same == ("Ant-v5", "Hopper-v5")
    assert document.unchanging == {"mujoco": "3.3.0"}
    assert upgrade_document.exit_code(document) == 0


def test_an_upgrade_that_changes_the_physics(world: World) -> None:
    """Ant-v5 changes at 3.3.0 on the way to 3.4.0, Hopper-v5 does not."""
    for release in ("3.1.0", "3.4.0"):
        world.add("3.11", {"gymnasium": "1.2.0", "mujoco": release, "numpy": "2.2.6"})
    world.changes_at("3.3.0")
    world.changes_at("9", env="Hopper-v5")

    document = world.upgrade(project(mujoco="3.1.0"), "mujoco==3.4.0")
    assert [(change.env, change.after) for change in document.behaviour.changed] == [("Ant-v5", "3.3.0")]
    assert document.behaviour.same == ("Hopper-v5",)
    assert (document.unchanging, upgrade_document.exit_code(document)) == ({"mujoco": "3.2.0"}, 1)
    text = "\n".join(upgraded_text.lines(document))
    assert "behave    1 of 2 tasks behave otherwise: Ant-v5" in text
    assert "at 3.3.0: Ant-v5; Ant-v5: moves otherwise in 40%" in text


def test_an_upgrade_that_changes_the_pictures_alone(world: World) -> None:
    """The same physics and other pictures: 1."""
    for release in ("3.1.0", "3.2.0"):
        world.add("3.11", {"gymnasium": "1.2.0", "mujoco": release, "numpy": "2.2.6"})
    for env in ("Ant-v5", "Hopper-v5"):
        world.changes_at("9", env=env)
    world.changes_at("3.2.0", pictures=True)

    document = world.upgrade(project(mujoco="3.1.0"), "mujoco==3.2.0")
    assert (document.behaviour.changing, document.pictures.changing) == ([], ["Ant-v5"])
    assert upgrade_document.exit_code(document) == 1


def test_an_upgrade_that_fails(world: World) -> None:
    """A task that works now and fails with the new release is named with its line."""
    world.add("3.11", {"gymnasium": "1.2.0", "mujoco": "3.1.0", "numpy": "2.2.6"})
    world.add("3.11", {"gymnasium": "1.2.0", "mujoco": "3.2.0", "numpy": "2.2.6"}, fails={"Hopper-v5": "KeyError: x"})

    document = world.upgrade(project(mujoco="3.1.0"), "mujoco==3.2.0")
    assert [(task.env, task.line) for task in document.running if not task.works] == [("Hopper-v5", "KeyError: x")]
    assert upgrade_document.exit_code(document) == 1
    assert "not Hopper-v5: KeyError: x" in "\n".join(upgraded_text.lines(document))


def test_an_upgrade_that_was_never_measured(world: World) -> None:
    """3, until a trial in a copy has shown that all of it runs and behaves the same."""
    world.add("3.11", {"gymnasium": "1.2.0", "mujoco": "3.1.0", "numpy": "2.2.6"})

    document = world.upgrade(project(mujoco="3.1.0"), "mujoco==3.9.0", env="Ant-v5")
    assert (document.running, document.tasks, upgrade_document.exit_code(document)) == ((), ("Ant-v5",), 3)

    tried = TriedTask(env="Ant-v5", runs_now=True, runs_then=True, line=None, behaves_otherwise=False, text="same")
    same = msgspec.structs.replace(document, tried=(tried,))
    assert upgrade_document.exit_code(same) == 0
    other = msgspec.structs.replace(tried, behaves_otherwise=True)
    assert upgrade_document.exit_code(msgspec.structs.replace(document, tried=(other,))) == 1


def test_a_release_between_two_alike_counts_as_they_do(world: World) -> None:
    """3.2.5 lies between 3.2.0 and 3.3.0, which behave alike: the same, by their neighbours."""
    for release in ("3.1.0", "3.2.5"):
        world.add("3.11", {"gymnasium": "1.2.0", "mujoco": release, "numpy": "2.2.6"})
    world.changes_at("3.4.0")

    document = world.upgrade(project(mujoco="3.1.0"), "mujoco==3.2.5", env="Ant-v5")
    assert (document.behaviour.same, document.behaviour.between) == (("Ant-v5",), ("Ant-v5",))
    world.series.clear()
    world.changes_at("3.3.0")
    assert world.upgrade(project(mujoco="3.1.0"), "mujoco==3.2.5", env="Ant-v5").behaviour.unmeasured == ("Ant-v5",)


def test_a_package_that_keeps_the_release_out(world: World) -> None:
    """gymnasium 0.29.1 with its extra wants mujoco>=2.3.3, so that 2.1 cannot be installed beside it."""
    here = project(mujoco="2.3.0", gymnasium="0.29.1")
    extras = Declared(name="gymnasium", versions=specifiers("==0.29.1"), pinned="0.29.1", extras=frozenset({"mujoco"}))
    with_extra = Project(
        source="requirements.txt", packages={**here.packages, "gymnasium": extras}, pythons=specifiers(""),
        python="3.10.13",
    )  # fmt: skip

    document = upgraded.upgrade(world.measured, with_extra, [Move(name="mujoco", now="2.3.0", then="2.1.0")], (), None)
    assert document.install.possible is False
    assert document.install.blockers[0] == "gymnasium 0.29.1 asks for mujoco>=2.3.3"
    assert upgrade_document.exit_code(document) == 1
