"""Which versions work together: what was measured, what follows, what is red, over small documents of known cells."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import pytest

from harness import distilling, inferring, recommending
from harness.distilling import Layer
from harness.model import Phase
from harness.recommending import Query, Wanted

HERE = "linux-x86_64"
ALL = {"import": "passed", "single": "passed", "vector": "passed", "render": "passed"}


class World:
    """Cells and their locks, as a document."""

    def __init__(self) -> None:
        self.cells: list[dict[str, Any]] = []
        self.locks: dict[str, str] = {}

    def add(self, python: str, pins: Mapping[str, str], verdict: str = "works", **more: Any) -> str:
        """A cell with a lock of these pins, its axes all of them unless others are given; returns its id."""
        text = "".join(
            f"{name}=={version} \\\n    --hash=sha256:{hashlib.sha256(f'{name}{version}'.encode()).hexdigest()}\n"
            for name, version in sorted(pins.items())
        )
        sha = hashlib.sha256(text.encode()).hexdigest()
        self.locks[sha] = text
        label = "-".join(f"{name}{version}" for name, version in pins.items())
        cell = {
            "id": f"m/py{python}-{label}{more.pop('suffix', '')}", "matrix": "m", "python": f"{python}.7",
            "machine": HERE, "measured": "2026-11-21T12:00:00Z", "verdict": verdict, "unverified": [],
            "phase": None if verdict == "works" else "single", "phases": ALL, "axes": {"python": python, **pins},
            "environment": {}, "supplied": {}, "requirements": [], "decisive": None, "lock": sha, "causes": [],
            "repairs": [],
            "cases": [{"case": "a", "env": "Ant-v5", "api": "gymnasium", "phases": ALL, "decisive": None}],
        } | more  # fmt: skip
        self.cells.append(cell)
        return str(cell["id"])

    @property
    def document(self) -> dict[str, Any]:
        """All of it."""
        return distilling.combined([Layer(cells=self.cells, locks=self.locks)])

    def found(self, *wanted: str, **asked: Any) -> list[recommending.Combination]:
        """The combinations that work."""
        return recommending.combinations(self.document, recommending.known(self.document), query(*wanted, **asked))

    def inferred(self, *wanted: str, **asked: Any) -> list[inferring.Inferred]:
        """What follows."""
        return inferring.inferred(recommending.known(self.document), query(*wanted, **asked))

    def red(self, *wanted: str, **asked: Any) -> list[recommending.Red]:
        """What does not work."""
        return recommending.red(recommending.known(self.document), query(*wanted, **asked))


def query(*wanted: str, **asked: Any) -> Query:
    """A question."""
    return Query(wanted=tuple(map(Wanted.of, wanted)), **asked)


@pytest.fixture
def world() -> World:
    """Nothing measured yet."""
    return World()


# --- measured --------------------------------------------------------------------------------------------------


def test_the_newest_come_first_in_the_order_asked(world: World) -> None:
    """Versions are compared as versions, first those of what was named first."""
    for a, b in (("1.9", "2.0"), ("1.10", "1.0"), ("1.10", "1.2")):
        world.add("3.11", {"aa": a, "bb": b})

    assert [one.versions for one in world.found("aa", "bb")] == [
        {"aa": "1.10", "bb": "1.2"}, {"aa": "1.10", "bb": "1.0"}, {"aa": "1.9", "bb": "2.0"},
    ]  # fmt: skip
    assert world.found("bb", "aa")[0].versions == {"bb": "2.0", "aa": "1.9"}


def test_only_what_works_and_fits_is_found(world: World) -> None:
    """Neither red cells, nor other versions, nor locks without one of the packages."""
    world.add("3.11", {"aa": "1.0", "bb": "1.0"})
    world.add("3.11", {"aa": "3.0", "bb": "1.0"}, "partial")
    world.add("3.11", {"aa": "2.0"})

    assert [one.versions["aa"] for one in world.found("aa")] == ["2.0", "1.0"]
    assert [one.versions["aa"] for one in world.found("aa", "bb")] == ["1.0"]
    assert [one.versions["aa"] for one in world.found("AA<2")] == ["1.0"]


@pytest.mark.parametrize(
    ("python", "pythons"), [("3.1", []), ("3.11", ["3.11.7"]), ("3.11.7", ["3.11.7"]), ("3.11.8", []), ("3.12", [])]
)
def test_of_a_python(world: World, python: str, pythons: list[str]) -> None:
    """A minor version stands for all its patches, a prefix of its digits for nothing."""
    world.add("3.11", {"aa": "1.0"})

    assert [one.python for one in world.found("aa", python=python)] == pythons


@pytest.mark.parametrize(
    "more",
    [
        {"unverified": ["render"], "phases": {**ALL, "render": "unavailable"}},
        {"phases": {**ALL, "render": "skipped"}},
        {"phases": {"single": "passed"}},
    ],
    ids=["unverified", "skipped", "not there"],
)
def test_what_is_needed_has_to_have_passed(world: World, more: dict[str, Any]) -> None:
    """A cell that works, and could not show what is needed, is not enough."""
    world.add("3.11", {"aa": "2.0"}, **more)
    good = world.add("3.11", {"aa": "1.0"})

    assert [one.cell for one in world.found("aa", needs=(Phase.RENDER,))] == [good]
    assert len(world.found("aa")) == 2


def test_an_environment_has_to_have_been_tried(world: World) -> None:
    """Its id is that of a case, with or without what stands before it; what is needed has to have passed there."""
    other = {"case": "b", "env": "robosuite:Lift", "api": "robosuite", "phases": {**ALL, "render": "skipped"}}
    world.add("3.11", {"aa": "1.0"}, cases=[other])

    assert world.found("aa", env="robosuite:Lift")
    assert world.found("aa", env="Lift")
    assert not world.found("aa", env="Lift", needs=(Phase.RENDER,))
    assert not world.found("aa", env="Ant-v5")


def test_of_an_environment_its_own_phases_count(world: World) -> None:
    """What another case of the cell could not show is nothing to it."""
    other = {"case": "b", "env": "Window-v0", "api": "gymnasium", "phases": {**ALL, "render": "unavailable"}}
    mine = {"case": "a", "env": "Ant-v5", "api": "gymnasium", "phases": ALL}
    phases = {**ALL, "render": "unavailable"}
    world.add("3.11", {"aa": "1.0"}, cases=[mine, other], unverified=["render"], phases=phases)

    assert world.found("aa", env="Ant-v5", needs=(Phase.RENDER,))
    assert not world.found("aa", env="Window-v0", needs=(Phase.RENDER,))
    assert not world.found("aa", needs=(Phase.RENDER,))


def test_equal_versions_are_one(world: World) -> None:
    """Pythons and machines on which one combination was measured stand together, its newest Python's lock for all."""
    world.add("3.10", {"aa": "1.0"})
    best = world.add("3.12", {"aa": "1.0"})
    world.add("3.9", {"aa": "1.0"}, machine="another")

    (one,) = world.found("aa")

    assert (one.pythons, one.machines, one.cell) == (("3.12.7", "3.10.7", "3.9.7"), ("another", HERE), best)
    assert len(one.cells) == 3


@pytest.mark.parametrize(
    "more",
    [
        {"environment": {"CUDA_VISIBLE_DEVICES": "7"}},
        {"repairs": [{"package": "aa", "version": "1.0", "reason": "", "link": ""}]},
        {"brought": ["checkout"]},
        {"phases": {"single": "passed"}},
    ],
    ids=["variables", "repaired", "brought", "less verified"],
)
def test_the_plain_one_is_shown(world: World, more: dict[str, Any]) -> None:
    """Of equal combinations that is shown for which nothing has to be done, and that verified most."""
    plain = world.add("3.10", {"aa": "1.0"}, environment={"MUJOCO_GL": "egl"})
    world.add("3.12", {"aa": "1.0"}, **more)

    (one,) = world.found("aa")

    assert (one.cell, one.settings, one.repaired, one.brought) == (plain, {"MUJOCO_GL": "egl"}, (), ())


def test_the_lock_is_the_cells_own(world: World) -> None:
    """What is handed out is the text whose hash the cell has."""
    world.add("3.11", {"aa": "1.0", "bb": "2.0"})

    (one,) = world.found("bb")

    assert hashlib.sha256(one.lock.encode()).hexdigest() == one.lock_sha256
    assert one.lock.startswith("aa==1.0 \\\n    --hash=sha256:")
    assert one.beside == {"aa": ("1.0",)}


@pytest.mark.parametrize("text", ["aa @ file:///a.whl", "aa; python_version < '3'", "a a", ""])
def test_what_is_no_requirement_of_a_package(text: str) -> None:
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
    assert not world.found("aa==3.3.1", "bb")


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
    """Where one between the two does not work, the two say nothing of its neighbours."""
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


def test_packages_that_work_apart(world: World) -> None:
    """Two that were never measured together: said as that, and only where their locks agree."""
    world.add("3.11", {"aa": "1.0", "numpy": "2.0"})
    world.add("3.11", {"bb": "1.0", "numpy": "1.0"})
    assert not world.inferred("aa", "bb")

    world.add("3.11", {"bb": "0.9", "numpy": "2.0"})
    (one,) = world.inferred("aa", "bb")

    assert (one.kind, one.versions) == ("apart", {"aa": "1.0", "bb": "0.9"})
    assert one.why.endswith("never measured together; their locks agree in all that both hold (1 package)")


# --- red -------------------------------------------------------------------------------------------------------


def test_red_ones_of_one_cause_are_one(world: World) -> None:
    """Versions that fail for one known cause stand together, before those of which some work after all."""
    for version in ("1.1", "1.2"):
        world.add("3.11", {"aa": version}, "broken", causes=["gone"], decisive=f"no attribute {version}")
    world.add("3.11", {"aa": "1.3"})
    world.add("3.11", {"aa": "1.3", "bb": "1.0"}, "partial", decisive="another")

    first, second = world.red("aa")

    assert [held["aa"] for held in first.versions] == ["1.2", "1.1"]
    assert (first.causes, first.verdicts, len(first.cells)) == (("gone",), ("broken",), 2)
    assert (second.line, second.beside) == ("another", {"bb": ("1.0",)})


def test_unknown_red_ones_by_what_a_matrix_says_of_their_line() -> None:
    """Measured here without a word, the same line is what the matrix says of it elsewhere; of two reasons neither."""
    world = World()
    world.add("3.11", {"aa": "1.1"}, "broken", decisive="no attribute 1.1", reason="it went", link="https://e.org")
    world.add("3.11", {"aa": "1.2"}, "broken", decisive="no attribute 1.2", matrix="try")
    (one,) = world.red("aa")
    assert (one.reason, len(one.cells)) == ("it went", 2)

    world.add("3.11", {"aa": "1.3"}, "broken", decisive="no attribute 1.3", reason="another")

    assert sorted(one.reason or "" for one in world.red("aa")) == ["", "another", "it went"]


@pytest.mark.parametrize("more", [{"own": True}, {"suffix": "-again", "environment": {"A": "b"}}])
def test_what_is_no_matter_of_versions_is_no_neighbour(world: World, more: dict[str, Any]) -> None:
    """A cell that a matrix broke on purpose, and one whose very lock works elsewhere, say nothing of versions."""
    world.add("3.11", {"aa": "1.0"} if "suffix" in more else {"aa": "0.9"})

    world.add("3.11", {"aa": "1.0"}, "broken", **more)

    assert world.red("aa") == []


def test_what_could_not_be_locked_is_told_by_what_was_asked(world: World) -> None:
    """An unresolvable combination has no lock; its axes say which versions it was."""
    world.add("3.11", {"aa": "1.0", "bb": "2.0"}, "unresolvable", lock=None)

    (one,) = world.red("aa", "bb<3")

    assert one.versions == ({"aa": "1.0", "bb": "2.0"},)
