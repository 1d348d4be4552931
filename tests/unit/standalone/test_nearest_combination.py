"""The nearest measured combination that works, and what has to change."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from builders import measured_cell
from facts import distribution, facts, installed

from harness.standalone.doctor.nearest_combination import find, find_failure, spoken_api, to_dict
from harness.standalone.failures import matching
from harness.standalone.installing import PIP


def cell(label: str, verdict: str = "works", python: str = "3.11.7", env: str = "CartPole-v1", **lock: str) -> Any:
    """Return a cell with its lock, given as versions by name."""
    axes = {"gym": lock.get("gym", "")}
    made = msgspec.to_builtins(measured_cell(label, verdict, python, axes=axes, supplied={"MUJOCO_GL": "egl"}))
    (case,) = made["cases"]
    made["decisive"] = None if verdict == "works" else "AttributeError: no"
    made["cases"] = [{**case, "env": env, "api": "gym"}]
    made["lock"] = {name.replace("_", "-"): version for name, version in lock.items()}
    return made


def measured(*cells: Any) -> dict[str, Any]:
    """Return the document of measured results."""
    locks = {one["id"]: sorted(one["lock"].items()) for one in cells}
    return {"schema": 1, "cells": [{**one, "lock": one["id"]} for one in cells], "locks": locks}


def nearest_answer(
    made: dict[str, Any],
    *cells: Any,
    env: str | None = None,
    remedies: tuple[str, ...] = (),
    issues: tuple[matching.Signature, ...] = (),
) -> Any:
    """Return the plain answer, or None if there is none."""
    found = find(made, measured(*cells), env, remedies, issues)
    return to_dict(made, found, PIP) if found else None


def test_the_fewest_changes_of_weight() -> None:
    """numpy is changed rather than gym; what differs and seldom matters is listed apart."""
    made = installed(gym="0.26.2", numpy="2.2.6", cloudpickle="3.0")

    found = nearest_answer(
        made,
        cell("old-gym", gym="0.21.0", numpy="2.2.6", cloudpickle="3.0"),
        cell("numpy", gym="0.26.2", numpy="1.26.4", cloudpickle="3.1"),
    )

    assert (found["cell"], found["command"]) == ("m/numpy", "python -m pip install numpy==1.26.4")
    assert [one["name"] for one in found["also"]] == ["cloudpickle"]
    assert found["remarks"] == ["with MUJOCO_GL=egl"]


def test_this_python_goes_before_its_neighbours() -> None:
    """Another minor version counts as a change, and is said; one that is far away is not taken."""
    made = installed(gym="0.26.2", numpy="2.2.6")
    there = cell("next", python="3.10.1", gym="0.26.2", numpy="1.26.4")
    far = cell("far", python="3.7.1", gym="0.26.2", numpy="1.21.6")

    same = nearest_answer(made, there, cell("same", gym="0.26.2", numpy="1.26.4"))
    other = nearest_answer(made, there, far)

    assert same["cell"] == "m/same"
    assert nearest_answer(made, there, cell("more", gym="0.26.1", numpy="1.26.4"))["cell"] == "m/more"
    assert other["remarks"][0] == "it was measured on Python 3.10: nothing near was measured on 3.11"
    assert nearest_answer(made, far) is None


def test_versions_with_the_same_known_issue_are_no_answer() -> None:
    """They passed where they were measured, and run into what the environment is warned of all the same."""
    issue = {"id": "bites", "cause": "it bites", "silent": True, "packages": ["gym<0.26", "numpy>=2"]}
    made = installed(gym="0.25.2", numpy="2.2.6")
    same, other = cell("same", gym="0.25.2", numpy="2.2.6"), cell("other", gym="0.25.2", numpy="1.26.4")

    assert nearest_answer(made, same, other)["cell"] == "m/same"
    assert nearest_answer(made, same, other, issues=(matching.read(issue),))["cell"] == "m/other"
    assert nearest_answer(made, same, issues=(matching.read(issue),)) is None


def test_a_package_that_a_remedy_brings_is_a_change() -> None:
    """The nearest versions alone would fail again for want of it."""
    made = installed(gym="0.25.2", numpy="2.2.6")

    found = nearest_answer(made, cell("old", gym="0.25.2", numpy="1.26.4", packaging="24.0"), remedies=("packaging",))

    assert found["command"] == "python -m pip install numpy==1.26.4 packaging==24.0"


def test_an_issue_of_any_version_leaves_measured_cells_as_they_are() -> None:
    """A cause that names packages without bounds says nothing against versions that were measured to work."""
    issue = {"id": "wide", "cause": "it happens", "pattern": "it happens", "packages": ["gym"]}
    made = installed(gym="0.25.2", numpy="2.2.6")

    assert (
        nearest_answer(made, cell("same", gym="0.25.2", numpy="2.2.6"), issues=(matching.read(issue),))["cell"]
        == "m/same"
    )


def test_only_what_works_counts() -> None:
    """A red cell, one with repaired wheels and one without a lock are no known-good."""
    made = installed(gym="0.26.2", numpy="2.2.6")
    mended = {**cell("mended", gym="0.26.2", numpy="1.26.4"), "repairs": ["gym"]}

    assert nearest_answer(made, cell("red", "broken", gym="0.26.2", numpy="1.26.4"), mended) is None


def test_the_environment_asked_for() -> None:
    """Only cells that made and stepped it; what is not installed for it is among the changes."""
    made = installed(numpy="1.26.4")

    found = nearest_answer(
        made, cell("ant", env="Ant-v4", gym="0.26.2", numpy="1.26.4"), cell("pole", gym="0.26.2"), env="Ant-v4"
    )

    assert (found["cell"], found["changes"]) == ("m/ant", [{"name": "gym", "now": None, "then": "0.26.2"}])


def test_of_what_is_not_there_the_newest() -> None:
    """If nothing that has environments is installed, the answer is gymnasium, and the newest release."""
    cells = (
        cell("old", env="Ant-v4", gym="0.15.7"),
        cell("new", env="Ant-v4", gym="0.26.2"),
        {**cell("next", env="Ant-v4", gymnasium="1.0.0"), "axes": {"gymnasium": "1.0.0"}},
    )

    assert nearest_answer(installed(pip="23"), *cells, env="Ant-v4")["changes"][0]["name"] == "gymnasium"
    assert nearest_answer(installed(pip="23"), *cells[:2], env="Ant-v4")["cell"] == "m/new"


def test_remedies_are_heeded() -> None:
    """A cell that does what a remedy asks for is nearer than one with fewer changes."""
    made = installed(gym="0.26.2", numpy="2.2.6")
    cells = cell("gym", gym="0.26.1", numpy="2.2.6"), cell("numpy", gym="0.26.2", numpy="1.26.4")

    assert nearest_answer(made, *cells)["cell"] == "m/gym"
    assert nearest_answer(made, *cells, remedies=("numpy<2",))["cell"] == "m/numpy"


def test_a_combination_that_breaks_remaining_packages_goes_last() -> None:
    """A combination that breaks a package which stays goes after one that does not, and otherwise that is said."""
    made = facts(
        distribution("gym", "0.26.2"),
        distribution("numpy", "2.2.6"),
        distribution("wheels", "1.0", "numpy>=1.20"),
    )
    worse = cell("worse", gym="0.26.2", numpy="1.19.5")
    better = cell("better", gym="0.26.1", numpy="1.26.4")

    assert nearest_answer(made, worse, better)["cell"] == "m/better"
    assert nearest_answer(made, worse)["remarks"][-1] == "afterwards wheels 1.0 asks for numpy>=1.20"


def test_a_package_that_needs_another_version_changes_too() -> None:
    """A package that stays and cannot be beside the changes is changed to what was measured."""
    made = facts(
        distribution("gym", "0.26.2"),
        distribution("numpy", "2.2.6"),
        distribution("opencv-python", "4.12", "numpy>=2"),
    )

    found = nearest_answer(made, cell("one", gym="0.26.2", numpy="1.26.4", opencv_python="4.9"))

    assert [one["name"] for one in found["changes"]] == ["numpy", "opencv-python"]


def test_nothing_to_change() -> None:
    """The very versions were measured: there is nothing to type. Without a simulator nothing is said at all."""
    assert nearest_answer(installed(gym="0.26.2"), cell("same", gym="0.26.2"))["command"] is None
    assert nearest_answer(installed(requests="2.0"), cell("same", gym="0.26.2")) is None


def test_versions_that_were_measured_to_fail() -> None:
    """These versions fail where they were measured; not told where they also work, or beside what is not here."""
    made = installed(gym="0.26.2", numpy="2.2.6")
    red = cell("red", "broken", gym="0.26.2", numpy="2.2.6")

    (found,) = find_failure(made, measured(red))

    assert found.text == "measured with these versions (m/red), CartPole-v1 fails in single: AttributeError: no"
    assert find_failure(made, measured(red, cell("green", gym="0.26.2", numpy="2.2.6"))) == []
    assert find_failure(made, measured(cell("red", "broken", gym="0.26.2", numpy="2.2.6", brax="0.9"))) == []
    assert find_failure(installed(gym="0.26.2", numpy="1.26.4"), measured(red)) == []


def test_a_cell_that_is_not_plainly_good_is_never_the_nearest() -> None:
    """Neither one that misleads nor one of which a silent issue is left open; one that misleads is told."""
    made = installed(gym="0.26.2", numpy="2.2.6")
    lock = {"gym": "0.26.2", "numpy": "2.2.6"}
    doubtful = {**cell("doubtful", **lock), "unverified": ["silent:camera-elsewhere"]}
    wrong = {**cell("wrong", **lock), "verdict": "misleads", "decisive": "looks elsewhere"}
    wrong["cases"][0]["misleads"] = ["render.camera"]

    assert find(made, measured(doubtful)) is None
    assert find(made, measured(wrong)) is None
    assert find_failure(made, measured(doubtful)) == []
    (told,) = find_failure(made, measured(wrong))
    assert (told.level, told.text) == (
        "warning",
        "measured with these versions (m/wrong), CartPole-v1 misleads: looks elsewhere",
    )


@pytest.mark.parametrize(
    ("env", "api", "installed", "spoken"),
    [
        ("Ant-v5", None, ("gym", "gymnasium"), "gymnasium"),
        ("Ant-v5", None, ("gym",), "gym"),
        ("Ant-v5", "gym", ("gym", "gymnasium"), "gym"),
        ("gym:Ant-v4", None, ("gym", "gymnasium"), "gym"),
        ("Lift", None, ("robosuite",), None),
        (None, None, ("gym",), None),
    ],
)
def test_the_api_that_an_id_belongs_to(
    env: str | None, api: str | None, installed: tuple[str, ...], spoken: str | None
) -> None:
    """The named API, that of the prefix, else gymnasium before gym."""
    assert spoken_api(env, api, installed) == spoken
