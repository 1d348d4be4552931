"""A user's own environment is tried without touching the harness: by a callable, or by an entry point."""

from __future__ import annotations

import platform

import pytest
from commandline import Desk

HERE = platform.python_version()


@pytest.mark.parametrize("env", ["fake_own:make", "fake_own:Robots.small", "own-robot"])
def test_an_unregistered_environment_is_made_by_a_callable(desk: Desk, env: str) -> None:
    """An environment made by a callable passes every phase, in workers, too, and whichever way it draws."""
    ran = _tried(desk, "--env", env)
    assert ran == (0, f"works: fake-own 1.0: import, single, vector, render of {env} on Python {HERE}\n", "")


def test_a_name_that_is_no_callable_is_the_librarys_to_refuse(desk: Desk) -> None:
    """A name that the module lacks is looked up as an environment id in gym's own syntax."""
    code, _, err = _tried(desk, "--env", "fake_own:nothing")
    assert code == 2
    assert "registers no such environment" in err


def test_an_api_that_nothing_tells_has_to_be_named(desk: Desk) -> None:
    """Without gym or gymnasium installed, an id does not tell its API, and the user has to name it."""
    ran = desk.run("try", "fake-plain", "--env", "fake_plain:make", "--python", "host", **_index(desk))
    told = (
        "simmatrix: --env fake_plain:make: no requirement brings gym or gymnasium; add one of them, "
        "or its API with --api ("
    )
    assert (ran.code, ran.out, ran.err[: len(told)]) == (2, "", told)
    assert "dm_control" in ran.err


def _tried(desk: Desk, *arguments: str) -> tuple[int, str, str]:
    ran = desk.run("try", "fake-own", *arguments, "--python", "host", **_index(desk))
    return ran.code, ran.out, ran.err if ran.code == 2 else ""


def _index(desk: Desk) -> dict[str, str]:
    return {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(desk.wheels)}
