"""Test which versions work together: measured, inferred and red ones, over small documents of known cells."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import pytest
from builders import HERE, measured_case, measured_cell

from harness.model import Phase
from harness.model.measured import MeasuredCell
from harness.reports.answers import digest, inferring, measured_cells, recommended, recommending, traps
from harness.reports.answers.measured_cells import CellResult, Query, Wanted

REPAIR = {"package": "aa", "version": "1.0", "reason": "", "link": "", "edits": [], "wheel_sha256": "", "build": []}
ALL = {"import": "passed", "single": "passed", "vector": "passed", "render": "passed"}


def case(name: str, env: str = "Ant-v5", **more: Any) -> dict[str, Any]:
    """Return a case of a cell in which all phases passed."""
    return measured_case(name, env, **{"phases": ALL, **more})


class World:
    """Cells and their locks, as a document."""

    def __init__(self) -> None:
        self.cells: list[MeasuredCell] = []
        self.locks: dict[str, str] = {}

    def add(self, python: str, pins: Mapping[str, str], verdict: str = "works", **more: Any) -> str:
        """Add a cell with a lock of these pins, which are also its axes unless others are given; return its id."""
        text = "".join(
            f"{name}=={version} \\\n    --hash=sha256:{hashlib.sha256(f'{name}{version}'.encode()).hexdigest()}\n"
            for name, version in sorted(pins.items())
        )
        sha = hashlib.sha256(text.encode()).hexdigest()
        self.locks[sha] = text
        label = "-".join(f"{name}{version}" for name, version in pins.items())
        cell = measured_cell(
            f"py{python}_{label}{more.pop('suffix', '')}", verdict, f"{python}.7",
            **{
                "measured": "2026-11-21T12:00:00Z", "phases": ALL, "axes": {"python": python, **pins}, "lock": sha,
                "cases": [case("a")], **more,
            },
        )  # fmt: skip
        self.cells.append(cell)
        return cell.id

    @property
    def results(self) -> list[CellResult]:
        """Return all cells with their locks."""
        return measured_cells.read(digest.with_locks("", {}, sorted(self.cells, key=lambda cell: cell.id), self.locks))

    def combinations(self, *wanted: str, **asked: Any) -> list[recommending.Combination]:
        """Return the combinations that work."""
        return recommending.combinations(self.results, query(*wanted, **asked))

    def inferred(self, *wanted: str, **asked: Any) -> list[inferring.Inferred]:
        """Return the inferred combinations."""
        return inferring.infer(self.results, query(*wanted, **asked))

    def answer(self, *wanted: str, **asked: Any) -> recommended.Recommended:
        """Return the whole answer to a query."""
        return recommended.build_answer(self.results, query(*wanted, **asked), 9, "next")

    def red(self, *wanted: str, **asked: Any) -> list[traps.Red]:
        """Return the measured combinations that do not work."""
        return traps.find_traps(self.results, query(*wanted, **asked))


def query(*wanted: str, **asked: Any) -> Query:
    """Return a question."""
    return Query(wanted=tuple(map(Wanted.of, wanted)), **asked)


@pytest.fixture
def world() -> World:
    """Return a world without measurements."""
    return World()


# --- measured --------------------------------------------------------------------------------------------------


def test_the_newest_come_first_in_the_order_asked(world: World) -> None:
    """Versions are compared as versions, first those of what was named first."""
    for a, b in (("1.9", "2.0"), ("1.10", "1.0"), ("1.10", "1.2")):
        world.add("3.11", {"aa": a, "bb": b})

    assert [one.versions for one in world.combinations("aa", "bb")] == [
        {"aa": "1.10", "bb": "1.2"}, {"aa": "1.10", "bb": "1.0"}, {"aa": "1.9", "bb": "2.0"},
    ]  # fmt: skip
    assert world.combinations("bb", "aa")[0].versions == {"bb": "2.0", "aa": "1.9"}


def test_only_what_works_and_fits_is_found(world: World) -> None:
    """Neither red cells, nor other versions, nor locks without one of the packages."""
    world.add("3.11", {"aa": "1.0", "bb": "1.0"})
    world.add("3.11", {"aa": "3.0", "bb": "1.0"}, "partial")
    world.add("3.11", {"aa": "2.0"})

    assert [one.versions["aa"] for one in world.combinations("aa")] == ["2.0", "1.0"]
    assert [one.versions["aa"] for one in world.combinations("aa", "bb")] == ["1.0"]
    assert [one.versions["aa"] for one in world.combinations("AA<2")] == ["1.0"]


@pytest.mark.parametrize(
    ("python", "pythons"), [("3.1", []), ("3.11", ["3.11.7"]), ("3.11.7", ["3.11.7"]), ("3.11.8", []), ("3.12", [])]
)
def test_of_a_python(world: World, python: str, pythons: list[str]) -> None:
    """A minor version stands for all its patches, a prefix of its digits for nothing."""
    world.add("3.11", {"aa": "1.0"})

    assert [one.python for one in world.combinations("aa", python=python)] == pythons


@pytest.mark.parametrize(
    "more",
    [
        {"unverified": ["render"], "phases": {**ALL, "render": "unavailable"}},
        {"phases": {**ALL, "render": "skipped"}},
        {"phases": {"single": "passed"}},
    ],
    ids=["unverified", "skipped", "not there"],
)
def test_needed_phases_have_to_have_passed(world: World, more: dict[str, Any]) -> None:
    """A cell that works, and could not show what is needed, is not enough."""
    world.add("3.11", {"aa": "2.0"}, **more)
    good = world.add("3.11", {"aa": "1.0"})

    assert [one.cell for one in world.combinations("aa", needs=(Phase.RENDER,))] == [good]
    assert len(world.combinations("aa")) == 2


def test_an_environment_has_to_have_been_tried(world: World) -> None:
    """Its id is that of a case, with or without what stands before it; what is needed has to have passed there."""
    other = case("b", "robosuite:Lift", api="robosuite", phases={**ALL, "render": "skipped"})
    world.add("3.11", {"aa": "1.0"}, cases=[other])

    assert world.combinations("aa", env="robosuite:Lift")
    assert world.combinations("aa", env="Lift")
    assert not world.combinations("aa", env="Lift", needs=(Phase.RENDER,))
    assert not world.combinations("aa", env="Ant-v5")


def test_of_an_environment_its_own_phases_count(world: World) -> None:
    """A phase that only another case of the cell could not show does not count against an environment."""
    mine, other = case("a"), case("b", "Window-v0", phases={**ALL, "render": "unavailable"})
    phases = {**ALL, "render": "unavailable"}
    world.add("3.11", {"aa": "1.0"}, cases=[mine, other], unverified=["render"], phases=phases)

    assert world.combinations("aa", env="Ant-v5", needs=(Phase.RENDER,))
    assert not world.combinations("aa", env="Window-v0", needs=(Phase.RENDER,))
    assert not world.combinations("aa", needs=(Phase.RENDER,))


def test_equal_versions_are_one(world: World) -> None:
    """Pythons and machines on which one combination was measured stand together, its newest Python's lock for all."""
    world.add("3.10", {"aa": "1.0"})
    best = world.add("3.12", {"aa": "1.0"})
    world.add("3.9", {"aa": "1.0"}, machine="another")

    (one,) = world.combinations("aa")

    assert (one.pythons, one.machines, one.cell) == (("3.12.7", "3.10.7", "3.9.7"), ("another", HERE), best)
    assert len(one.cells) == 3


@pytest.mark.parametrize(
    "more",
    [
        {"environment": {"CUDA_VISIBLE_DEVICES": "7"}},
        {"repairs": [REPAIR]},
        {"brought": [{"name": "checkout", "mark": "", "commit": None, "changed": False}]},
        {"phases": {"single": "passed"}},
    ],
    ids=["variables", "repaired", "brought", "less verified"],
)
def test_the_plain_one_is_shown(world: World, more: dict[str, Any]) -> None:
    """Of equal combinations that is shown for which nothing has to be done, and that verified most."""
    plain = world.add("3.10", {"aa": "1.0"}, environment={"MUJOCO_GL": "egl"})
    world.add("3.12", {"aa": "1.0"}, **more)

    (one,) = world.combinations("aa")

    assert (one.cell, one.settings, one.repaired, one.brought) == (plain, {"MUJOCO_GL": "egl"}, (), ())


def test_the_lock_is_the_cells_own(world: World) -> None:
    """The lock of an answer is the text whose hash the cell has."""
    world.add("3.11", {"aa": "1.0", "bb": "2.0"})

    (one,) = world.combinations("bb")

    assert hashlib.sha256(one.lock.encode()).hexdigest() == one.lock_sha256
    assert one.lock.startswith("aa==1.0 \\\n    --hash=sha256:")
    assert one.beside == {"aa": ("1.0",)}


@pytest.mark.parametrize("text", ["aa @ file:///a.whl", "aa; python_version < '3'", "a a", ""])
def test_addresses_and_markers_are_refused(text: str) -> None:
    """Addresses and markers are refused: nothing measured could be compared with them."""
    with pytest.raises(ValueError, match=r"name a package|is not a requirement"):
        Wanted.of(text)


# --- inferred --------------------------------------------------------------------------------------------------


def test_a_version_between_two_that_work(world: World) -> None:
    """It says between which it lies, and that all else was the same."""
    low, high = (world.add("3.11", {"aa": version, "bb": "1.0"}) for version in ("3.3.0", "3.3.2"))

    (one,) = world.inferred("aa==3.3.1", "bb")

    assert (one.kind, one.versions, one.from_cells) == ("between", {"aa": "3.3.1", "bb": "1.0"}, (low, high))
    assert one.why == "aa 3.3.1 lies between 3.3.0 and 3.3.2, both measured good with the same Python 3.11, bb 1.0"
    assert not world.combinations("aa==3.3.1", "bb")


def test_nothing_follows_outside(world: World) -> None:
    """Beyond the newest and before the oldest nothing is known."""
    for version in ("3.3.0", "3.3.2"):
        world.add("3.11", {"aa": version})

    assert not world.inferred("aa==3.3.3")
    assert not world.inferred("aa==3.2.9")
    assert not world.inferred("aa>=3.3.1,<3.3.2")


@pytest.mark.parametrize(
    ("other", "more"),
    [
        ({"aa": "3.3.2", "bb": "2.0"}, {}),
        ({"aa": "3.3.2", "bb": "1.0"}, {"machine": "another"}),
        ({"aa": "3.3.2", "bb": "1.0"}, {"environment": {"A": "b"}}),
        ({"aa": "3.3.2", "bb": "1.0"}, {"verdict": "partial"}),
        ({"aa": "4.0.0", "bb": "1.0"}, {}),
    ],
    ids=["other rest", "other machine", "other variables", "red", "other major version"],
)
def test_nothing_follows_from_cells_that_differ(world: World, other: dict[str, str], more: dict[str, Any]) -> None:
    """The two around it have to be alike in all else, to work both, and to be near one another."""
    world.add("3.11", {"aa": "3.3.0", "bb": "1.0"})
    world.add("3.11", other, **more)

    assert not world.inferred("aa==3.3.1", "bb")


def test_nothing_follows_across_a_red_one(world: World) -> None:
    """If a release between two good ones does not work, nothing is inferred about its neighbours."""
    for version in ("3.3.0", "3.3.4"):
        world.add("3.11", {"aa": version})
    assert world.inferred("aa==3.3.1")

    world.add("3.11", {"aa": "3.3.2"}, "broken")

    assert not world.inferred("aa==3.3.1")


def test_nothing_follows_where_it_was_measured(world: World) -> None:
    """A red measurement of the very version is an answer, on whichever Python."""
    for version in ("3.3.0", "3.3.2"):
        world.add("3.11", {"aa": version})
    world.add("3.9", {"aa": "3.3.1"}, "broken")

    assert not world.inferred("aa==3.3.1", python="3.11")


def test_a_python_between_two_that_work(world: World) -> None:
    """The same versions work on an older and on a newer Python."""
    for python in ("3.9", "3.11"):
        world.add(python, {"aa": "1.0"})

    (one,) = world.inferred("aa", python="3.10")

    assert one.why == (
        "Python 3.10 lies between 3.9 and 3.11, on both of which the same versions were measured good: aa 1.0"
    )
    assert not world.inferred("aa", python="3.12")


# --- what a case ran -------------------------------------------------------------------------------------------


def test_a_package_that_was_only_installed_is_never_good(world: World) -> None:
    """A package of the lock that nobody asked for and no case imported was never run, whatever works beside it."""
    pins = {"aa": "1.0", "numpy": "2.0", "pettingzoo": "1.0", "flax": "0.8"}
    world.add("3.11", pins, axes={"python": "3.11", "aa": "1.0"}, imported=["numpy", "pettingzoo"])
    answer = world.answer("pettingzoo")

    assert [one.versions for one in world.combinations("aa", "numpy")] == [{"aa": "1.0", "numpy": "2.0"}]
    assert not world.combinations("pettingzoo"), (
        "it was imported by another package, and none of its environments was run"
    )
    assert not world.combinations("flax")
    assert (answer.installed, answer.measured, answer.red) == ({"pettingzoo": ("1.0",)}, (), ())


def test_packages_noted_by_the_cell_count(world: World) -> None:
    """A package that is only named is not among those that a cell noted as run."""
    world.add("3.11", {"aa": "1.0", "bb": "1.0"}, cases=[case("a", exercised=["aa"])])

    assert world.combinations("aa")
    assert not world.combinations("bb")


@pytest.mark.parametrize(
    "more", [{"verdict": "misleads"}, {"unverified": ["silent:lurking"]}], ids=["misleads", "silent issue"]
)
def test_only_plainly_good_cells_are_recommended(world: World, more: dict[str, Any]) -> None:
    """A cell that misleads is a trap; one with an open silent issue works, and says so."""
    world.add("3.11", {"aa": "2.0"}, **more)
    world.add("3.11", {"aa": "1.0"})

    assert [one.versions["aa"] for one in world.combinations("aa")] == ["1.0"]
    assert [one.verdicts for one in world.red("aa==2.0")] == ([("misleads",)] if "verdict" in more else [])
    for asked in ("aa==2.0", "aa"):
        doubtful = world.answer(asked).doubtful
        assert [one.unverified for one in doubtful] == ([] if "verdict" in more else [("silent:lurking",)])


def test_the_working_tasks_of_a_partial_cell_are_listed(world: World) -> None:
    """Nothing works as a whole: what works, by task; and the task alone is good where it is asked for."""
    bad = case("b", "Swimmer-v4", phases={"single": "failed"}, decisive="no")
    world.add("3.11", {"aa": "1.0"}, "partial", cases=[case("a"), bad])

    (part,) = world.answer("aa").partly

    assert (part.works, part.fails) == (("a",), {"b": "no"})
    assert world.combinations("aa", env="Ant-v5")
    assert not world.combinations("aa", env="Swimmer-v4")
    assert not world.red("aa", env="Ant-v5")


def test_an_open_issue_of_the_recommended_release_is_named(world: World) -> None:
    """Equal versions, other environments: what is in doubt about them is said beside what is good; older ones not."""
    world.add("3.11", {"aa": "2.0"})
    doubtful = world.add("3.11", {"aa": "2.0", "bb": "1.0"}, unverified=["silent:lurking"])
    world.add("3.11", {"aa": "1.0"}, unverified=["silent:lurking"])

    assert [one.cell for one in world.answer("aa").doubtful] == [doubtful]


# --- together --------------------------------------------------------------------------------------------------


def test_packages_that_were_never_measured_together(world: World) -> None:
    """The answer gives the results of each package, and existing versions of both to try."""
    world.add("3.11", {"aa": "1.0"})
    world.add("3.12", {"aa": "1.1"})
    world.add("3.11", {"bb": "0.9"})

    found = world.answer("aa", "bb").apart

    assert found is not None
    assert (found.requirements, found.python) == (("aa==1.0", "bb==0.9"), "3.11")
    assert [one.combination and one.combination.versions for one in found.halves] == [{"aa": "1.0"}, {"bb": "0.9"}]

    world.add("3.9", {"aa": "0.1", "bb": "0.1"}, "broken")
    assert world.answer("aa", "bb").apart is None, "a red measurement is one"


def test_the_most_that_was_measured_together(world: World) -> None:
    """Of three packages two were: they stand together."""
    for pins in ({"aa": "1.0", "bb": "1.0"}, {"cc": "1.0"}):
        world.add("3.11", pins)

    found = world.answer("aa", "bb", "cc").apart

    assert found is not None
    assert [one.packages for one in found.halves] == [("aa", "bb"), ("cc",)]


def test_a_newer_one_on_another_python_is_named(world: World) -> None:
    """The newest measured on a Python is not the newest that works: a newer one was never measured there."""
    world.add("3.11", {"aa": "2.0"})
    world.add("3.13", {"aa": "1.0"})
    assert [one.versions for one in world.answer("aa", python="3.13").newer] == [{"aa": "2.0"}]

    world.add("3.13", {"aa": "2.0"}, "broken")
    assert not world.answer("aa", python="3.13").newer


def test_the_install_command_keeps_extras_and_numpy(world: World) -> None:
    """Requirements of the cell at their measured versions: extras of all its lines, numpy, no local version."""
    asked = ["gymnasium[mujoco]", "gymnasium==1.4.0", "torch"]
    pins = {"gymnasium": "1.4.0", "torch": "2.13.0+cpu", "numpy": "2.4.6", "rest": "1.0"}
    world.add("3.11", pins, requirements=asked, axes={"python": "3.11"}, imported=["numpy"])

    (one,) = world.combinations("torch")

    assert one.requirements == ("torch==2.13.0", "gymnasium[mujoco]==1.4.0", "numpy==2.4.6")


# --- one environment, several matrices -------------------------------------------------------------------------


def test_cells_of_one_lock_are_one_measurement(world: World) -> None:
    """Cells of different matrices that ran in one environment ran together: the union is an answer."""
    pins = {"aa": "1.0", "bb": "2.0", "cc": "3.0"}
    one = world.add("3.11", pins, axes={"python": "3.11"}, cases=[case("a", exercised=["aa", "bb"])])
    other = world.add(
        "3.11", pins, suffix="-x", matrix="n", axes={"python": "3.11"}, cases=[case("b", "Hop-v1", exercised=["cc"])]
    )

    (joined,) = world.combinations("aa", "bb", "cc")

    assert joined.versions == pins
    assert {*joined.cells} == {one, other}
    assert {*joined.environments} == {"Ant-v5", "Hop-v1"}


@pytest.mark.parametrize(
    "more",
    [{"environment": {"A": "b"}}, {"machine": "another"}, {"verdict": "partial"}, {"python": "3.12"}],
    ids=["variables", "machine", "red", "Python"],
)
def test_cells_of_other_environments_are_not_joined(world: World, more: dict[str, Any]) -> None:
    """The same lock with other variables, on another machine or Python, or where it does not work, is another thing."""
    pins = {"aa": "1.0", "bb": "2.0"}
    world.add("3.11", pins, axes={"python": "3.11"}, cases=[case("a", exercised=["aa"])])
    python = more.get("python", "3.11")
    changed = {name: value for name, value in more.items() if name != "python"}
    world.add(python, pins, suffix="-x", axes={"python": python}, cases=[case("b", exercised=["bb"])], **changed)

    assert not world.combinations("aa", "bb")
    assert world.answer("aa", "bb").apart is not None


# --- weighed ---------------------------------------------------------------------------------------------------


def behaving(family: str, reference: str | None = None, name: str = "a") -> dict[str, Any]:
    """Return a case with its behaviour."""
    return case(name, f"{name}-v1", behaviour={"bank": "", "family": family, "reference": reference})


def test_neighbours_that_behave_alike_are_counted(world: World) -> None:
    """Families of each task against the release before: letters are compared, a doubt is no agreement."""
    before = world.add("3.11", {"aa": "1.0"}, cases=[behaving(letter, name=letter) for letter in "ABCD"])
    cases = [behaving(*pair, name=name) for name, pair in
             zip("ABCD", [("A'", before), ("BC", before), ("D", before), ("D?", before)], strict=True)]  # fmt: skip
    world.add("3.11", {"aa": "1.1"}, cases=cases)

    weighed = world.answer("aa").weighed

    assert weighed is not None
    assert (weighed.works, weighed.tasks, weighed.newer, weighed.pythons) == (2, 4, {}, ("3.11",))
    (found,) = weighed.behaves
    assert (found.package, found.version, found.before, found.same, found.tasks) == ("aa", "1.1", "1.0", 2, 4)


def test_a_neighbour_differs_in_one_package(world: World) -> None:
    """If the cell before differs in another package, too, nothing is said of either."""
    before = world.add("3.11", {"aa": "1.0", "bb": "1.0"}, cases=[behaving("A")])
    world.add("3.11", {"aa": "1.1", "bb": "1.1"}, cases=[behaving("A", before)])

    weighed = world.answer("aa").weighed

    assert weighed is not None
    assert weighed.behaves == ()


def test_a_combination_with_many_more_tasks_is_named(world: World) -> None:
    """The newest goes first; an older one that was measured with twice the tasks is named beside it."""
    world.add("3.11", {"aa": "1.0"}, cases=[case(name, f"{name}-v1") for name in "abc"])
    world.add("3.11", {"aa": "1.1"}, cases=[case("a")])

    weighed = world.answer("aa").weighed

    assert weighed is not None
    assert weighed.thorough is not None
    assert (weighed.thorough.versions, weighed.thorough.tasks) == ({"aa": "1.0"}, 3)


def test_a_typo_is_no_trap(world: World) -> None:
    """A release that never was says nothing of packages."""
    line = "Because there is no version of aa==9 and you require aa==9"
    world.cells.append(
        measured_cell("typo", "unresolvable", "3.11", lock=None, requirements=["aa==9"], installed=None, decisive=line)
    )

    assert world.red("aa") == []


def test_packages_that_were_held_back_are_pinned(world: World) -> None:
    """Other cells of the same Python have a newer release of a deciding package: something held it back."""
    world.add("3.11", {"bb": "1.0", "scipy": "1.17.0", "zz": "2"}, imported=["scipy"])
    pins = {"aa": "1.0", "scipy": "1.11.0", "zz": "1"}
    world.add("3.11", pins, axes={"python": "3.11", "aa": "1.0"}, imported=["scipy"])

    (one,) = world.combinations("aa")

    assert one.requirements == ("aa==1.0", "scipy==1.11.0")


def test_a_package_that_only_a_check_ran_counts(world: World) -> None:
    """A check of training runs its library, whose environments there are none of."""
    pins = {"aa": "1.0", "stable-baselines3": "2.0"}
    checks = {"interop.sb3.learn": "passed"}
    world.add("3.11", pins, cases=[case("a", exercised=["aa"], checks=checks)])

    assert world.combinations("stable-baselines3")


# --- red -------------------------------------------------------------------------------------------------------


def test_red_ones_of_one_cause_are_one(world: World) -> None:
    """Versions that fail for one known cause stand together; traps beside what else was asked for go last."""
    for version in ("1.1", "1.2"):
        world.add("3.11", {"aa": version}, "broken", causes=["gone"], decisive=f"no attribute {version}")
    world.add("3.11", {"aa": "1.3"})
    world.add("3.11", {"aa": "1.3", "bb": "1.0"}, "partial", decisive="another")

    first, second = world.red("aa")

    assert [held["aa"] for held in first.versions] == ["1.2", "1.1"]
    assert (first.causes, first.verdicts, len(first.cells)) == (("gone",), ("broken",), 2)
    assert (second.line, second.deciding) == ("another", {"bb": ("1.0",)})


def test_the_package_that_decides_is_named(world: World) -> None:
    """The same versions work elsewhere: what differs there is the trap, never the versions by themselves."""
    world.add("3.11", {"aa": "1.4", "bb": "3.1"})
    world.add("3.11", {"aa": "1.4", "bb": "3.1", "cc": "1.3"}, "import_fails", decisive="No module named 'packaging'")
    world.add("3.11", {"aa": "1.4", "bb": "3.3", "dd": "3.0"}, "import_fails", decisive="No module named 'packaging'")

    first, second = world.red("aa", "bb")

    assert {tuple(one.versions[0].values()): (one.deciding, one.beside) for one in (first, second)} == {
        ("1.4", "3.1"): ({"cc": ("1.3",)}, {"cc": ("1.3",)}),
        ("1.4", "3.3"): ({}, {"dd": ("3.0",)}),
    }


def test_the_python_that_decides_is_named(world: World) -> None:
    """If equal versions work on another Python, Python is named as the difference."""
    world.add("3.11", {"aa": "1.0"})
    world.add("3.13", {"aa": "1.0", "zz": "1"}, "broken", axes={"python": "3.13", "aa": "1.0"})

    (trap,) = world.red("aa")
    assert (trap.deciding, trap.instead) == ({"Python": ("3.13",)}, {"Python": "3.11"})


def test_the_variable_that_decides_is_named(world: World) -> None:
    """A way of drawing that fails while another one works with the same versions is what decides."""
    world.add("3.11", {"aa": "1.0"}, environment={"MUJOCO_GL": "egl"})
    world.add("3.11", {"aa": "1.0", "zz": "1"}, "broken", suffix="-x", axes={"python": "3.11", "aa": "1.0"},
              environment={"MUJOCO_GL": "elg"})  # fmt: skip

    (trap,) = world.red("aa")

    assert (trap.deciding, trap.instead) == ({"MUJOCO_GL": ("elg",)}, {"MUJOCO_GL": "egl"})


def test_unknown_red_ones_by_what_a_matrix_says_of_their_line() -> None:
    """Measured here without a word, the same line is what the matrix says of it elsewhere; of two reasons neither."""
    world = World()
    went = {"verdict": "broken", "reason": "it went", "link": "https://e.org"}
    world.add("3.11", {"aa": "1.1"}, "broken", decisive="no attribute 1.1", expectation=went)
    world.add("3.11", {"aa": "1.2"}, "broken", decisive="no attribute 1.2", matrix="try")
    (one,) = world.red("aa")
    assert (one.reason, len(one.cells)) == ("it went", 2)

    world.add("3.11", {"aa": "1.3"}, "broken", decisive="no attribute 1.3", expectation=went | {"reason": "another"})

    assert sorted(one.reason or "" for one in world.red("aa")) == ["", "another", "it went"]


@pytest.mark.parametrize(
    "more", [{"cases": [case("a", "gym:module:make")]}, {"suffix": "-again", "environment": {"A": "b"}}]
)
def test_a_failure_independent_of_versions_is_no_neighbour(world: World, more: dict[str, Any]) -> None:
    """A cell that a matrix broke on purpose, and one whose very lock works elsewhere, say nothing of versions."""
    world.add("3.11", {"aa": "1.0"} if "suffix" in more else {"aa": "0.9"})

    world.add("3.11", {"aa": "1.0"}, "broken", **more)

    assert world.red("aa") == []


def test_an_unresolvable_combination_shows_the_versions_asked_for(world: World) -> None:
    """An unresolvable combination has no lock; its axes say which versions it was."""
    world.add("3.11", {"aa": "1.0", "bb": "2.0"}, "unresolvable", lock=None)

    (one,) = world.red("aa", "bb<3")

    assert one.versions == ({"aa": "1.0", "bb": "2.0"},)
