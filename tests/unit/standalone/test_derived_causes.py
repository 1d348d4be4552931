"""Causes that are derived: from the histories of packages, from tables of files, and from what a line says itself."""

from __future__ import annotations

import pytest

from harness.standalone.explain.api_history import History
from harness.standalone.explain.explain_text import Facts, explain_text

GYM = History(
    {
        "package": "gym",
        "releases": [
            {"version": "0.20.0", "uploaded": "2021-09-01", "read": True, "sdist": True},
            {"version": "0.21.0", "uploaded": "2021-10-01", "read": True, "sdist": True},
            {"version": "0.22.0", "uploaded": "2022-02-01", "read": True, "sdist": True},
            {"version": "0.26.0", "uploaded": "2022-09-01", "read": True, "sdist": True, "python": ">=3.7"},
        ],
        "ran": [[0, 3]],
        "modules": {"gym": [[0, 3]], "gym.envs.robotics": [[0, 1]], "gym.cli": [[2, 3]]},
        "names": {"gym": {"make": [[0, 3]], "GoalEnv": [[0, 1]]}, "gym.wrappers": {"StepAPICompatibility": [[3, 3]]}},
        "members": {
            "gym.core.Env": {"seed": [[0, 2]], "reset": [[0, 3]]},
            "gym.viewer.Viewer": {"finish": [[0, 1]], "close": [[0, 1]]},
            "gym.past.Gone": {"start": [[0, 0]], "finish": [[1, 1]]},
            "gym.core.GymWrapper": {"seed": [[0, 1]], "close": [[0, 3]]},
            "gym.old.Moved": {"stay": [[0, 1]]},
            "gym.new.Moved": {"stay": [[2, 3]]},
        },
        "signatures": {"gym.core.Env.reset": [[0, 1, "self"], [2, 3, "self, *, seed="]]},
        "environments": {"Hopper-v2": [[0, 3]], "Hopper-v4": [[3, 3]]},
    }
)


def explained(text: str, **installed: str) -> tuple[str, tuple[str, ...]] | None:
    """Return the cause of a text, and the requirements of its remedy; None where nothing is derived."""
    here = Facts(installed=installed or None, history=lambda package: GYM if package == "gym" else None)
    cause = explain_text(text, (), here).cause
    return cause and (cause.signature.plain["cause"], tuple(cause.signature.plain["remedy"].get("requirements", ())))


@pytest.mark.parametrize(
    ("line", "bound"),
    [
        ("AttributeError: module 'gym' has no attribute 'GoalEnv'", "gym<0.22.0"),
        (
            "ImportError: cannot import name 'StepAPICompatibility' from 'gym.wrappers'",
            "gym>=0.26.0",
        ),
        ("ModuleNotFoundError: No module named 'gym.envs.robotics'", "gym<0.22.0"),
        ("AttributeError: 'Env' object has no attribute 'seed'", "gym<0.26.0"),
        ("TypeError: Env.reset() got an unexpected keyword argument 'seed'", "gym>=0.22.0"),
        ("gym.error.UnregisteredEnv: No registered env with id: Hopper-v4", "gym>=0.26.0"),
        ("gym.error.NameNotFound: Environment `Hopper-v4` doesn't exist.", "gym>=0.26.0"),
    ],
)
def test_a_name_that_some_releases_have_leads_to_them(line: str, bound: str) -> None:
    """A name that is gone needs an older release, a new one a newer release."""
    answer = explained(line)
    assert answer is not None
    assert answer[1] == (bound,)


@pytest.mark.parametrize(
    "line",
    [
        "AttributeError: module 'gym' has no attribute 'maek'",
        "AttributeError: partially initialized module 'gym' has no attribute 'make'",
        "AttributeError: module 'gym' has no attribute 'cli'",
        "AttributeError: 'Viewer' object has no attribute 'finish'",
        "AttributeError: 'Moved' object has no attribute 'stay'",
        "AttributeError: 'Gone' object has no attribute 'finish'",
        "AttributeError: 'GymWrapper' object has no attribute 'seed'",
        "AttributeError: 'MyAgent' object has no attribute 'seed'",
        "TypeError: MyEnv.reset() got an unexpected keyword argument 'seed'",
        "ModuleNotFoundError: No module named 'utils'",
        "KeyError: 'GoalEnv'",
    ],
)
def test_a_name_of_no_release_or_of_every_release_accuses_no_package(line: str) -> None:
    """The fault is then in the user's own code, or elsewhere."""
    assert explained(line) is None


def test_a_name_of_every_release_is_missing_from_another_file_of_that_name() -> None:
    """No package is accused: what was imported is not the package."""
    cause = explained("AttributeError: module 'gym' has no attribute 'make'")
    assert cause is not None
    assert "every release of gym has `gym.make`" in cause[0]
    assert cause[1] == ()


WHEELS = History(
    {
        "package": "mujoco",
        "releases": [
            {
                "version": version,
                "sdist": True,
                "python": ">=3.8",
                "wheels": [tag.format(minor) for minor in minors for tag in tags],
            }
            for version, minors, tags in (
                (
                    "2.3.7",
                    (8, 9, 10, 11),
                    ("cp3{}-none-manylinux_x86_64", "cp3{}-none-macosx_arm64", "cp3{}-none-win_amd64"),
                ),
                ("2.3.6", (8, 9, 10, 11), ("cp3{}-none-manylinux_x86_64",)),
                ("2.3.5", (8,), ("py3-none-any",)),
            )
        ],
    }
)


@pytest.mark.parametrize(
    ("line", "python"),
    [
        ("ERROR: No matching distribution found for mujoco==2.3.7", ">=3.8,<3.12"),
        ("ERROR: No matching distribution found for mujoco==2.3.6", None),
        ("ERROR: No matching distribution found for mujoco==2.3.5", None),
        ("Could not find a version that satisfies the requirement mujoco==2.3.7 (from versions: none)", None),
    ],
)
def test_a_release_with_wheels_for_every_system_was_wanted_for_another_python(line: str, python: str | None) -> None:
    """A system without a wheel may be at fault itself, and no versions at all hint at the index."""
    facts = Facts(history=lambda package: WHEELS if package == "mujoco" else None)
    cause = explain_text(line, (), facts).cause
    assert (cause and cause.signature.plain["remedy"].get("python")) == python


def test_the_release_at_hand_decides_the_side() -> None:
    """One that has the name is not accused, and an older one is told to move on."""
    line = "AttributeError: module 'gym' has no attribute 'GoalEnv'"
    assert explained(line, gym="0.21.0") is None
    assert explained(line, gym="0.26.0") == (
        "gym lacks `gym.GoalEnv` since 0.22.0, and the installed release is newer",
        ("gym<0.22.0",),
    )


def test_neighbours_of_a_release_that_never_was_are_named() -> None:
    """Nothing is said of a release that may be newer than the history."""
    answer = explained("ERROR: No matching distribution found for gym==0.21.5")
    assert answer == ("gym has no release 0.21.5: 0.21.0 is followed by 0.22.0", ("gym==0.22.0",))
    assert explained("ERROR: No matching distribution found for gym==9.9") is None


def test_a_conflict_names_the_release_that_is_wanted() -> None:
    """The bound is what the other package asks for."""
    line = "stable-baselines3 1.6.2 requires gym==0.21, but you have gym 0.23.1 which is incompatible."
    assert explained(line) == (
        "stable-baselines3 1.6.2 requires gym==0.21, but gym 0.23.1 is installed",
        ("gym==0.21",),
    )


@pytest.mark.parametrize("read", [True, False])
def test_unread_older_releases_may_have_a_name(*, read: bool) -> None:
    """A name that only the newest release has says nothing of age where an older release was never read."""
    releases = [
        {"version": "1.0", "uploaded": "2024-01-01", "read": read},
        {"version": "2.0", "uploaded": "2024-06-01", "read": True},
        {"version": "3.0", "uploaded": "2025-01-01", "read": True},
    ]
    there = History({"package": "wings", "releases": releases}).where([[2, 2]], None)

    assert (there.bound if there else None) == ("wings>=3.0" if read else None)
