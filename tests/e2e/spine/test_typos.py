"""A misspelt package, or a release that no index has, is bad input for every verb and never a result."""

from __future__ import annotations

import shutil

import pytest
from commandline import Desk

TEXT = """
requirements = ["{asked}"]
index = {{ no_index = true, find_links = ["@WHEELS@"] }}
cases = [{{ env = "fake_healthy:Healthy-v0", api = "gymnasium" }}]
axes = {{ python = ["host"] }}
"""
RELEASE = "simmatrix: fake-healthy 9.9.9: no such release; newest is 1.0\n"
NAME = "simmatrix: gymnasum: no such package; did you mean gymnasium?\n"


@pytest.mark.parametrize(("asked", "said"), [("fake-healthy==9.9.9", RELEASE), ("gymnasum", NAME)])
@pytest.mark.parametrize("verb", ["plan", "lock", "run", "bisect", "repair"])
def test_a_matrix_with_a_typo_is_refused(desk: Desk, verb: str, asked: str, said: str) -> None:
    """A matrix with a typo is refused with code 2 and the newest release or the nearest name; nothing is measured."""
    path = desk.matrix("m", TEXT.format(asked=asked))
    more = {"bisect": ("--axis", "python"), "repair": ()}

    ran = desk.run(verb, f"{path}/*" if verb in more else path, *more.get(verb, ()))

    assert (ran.code, ran.err) == (2, said)
    assert not (desk.state / "cells").exists()


@pytest.mark.parametrize("verb", ["try", "repair"])
@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["fake-healthy==9.9.9"], RELEASE),
        (["gymnasum"], NAME),
        (["fake-healthy>=2"], "simmatrix: fake-healthy>=2: no release fits; newest is 1.0\n"),
        (
            ["fake-healthy", "--constraint", "fake-plain==7"],
            "simmatrix: fake-plain 7: no such release; newest is 3.0\n",
        ),
    ],
)
def test_a_typo_on_the_command_line_is_refused(desk: Desk, verb: str, asked: list[str], said: str) -> None:
    """A typo on the command line is refused with code 2, and is not stored for `recommend`."""
    here = {"PIP_FIND_LINKS": str(desk.wheels), "PIP_NO_INDEX": "1"}

    ran = desk.run(verb, *asked, **here)

    assert (ran.code, ran.err) == (2, said)
    assert not (desk.state / "cells").exists()


def test_a_project_with_a_typo_is_refused(desk: Desk) -> None:
    """`init` writes nothing for a dependency that no index has."""
    (desk.folder / "pyproject.toml").write_text('[project]\nname = "mine"\ndependencies = ["gymnasum>=1"]\n')
    here = {"PIP_FIND_LINKS": str(desk.wheels), "PIP_NO_INDEX": "1"}

    ran = desk.run("init", **here)

    assert (ran.code, ran.err) == (2, NAME)
    assert not (desk.folder / "matrices").exists()


def test_a_missing_release_required_by_another_package_is_no_typo(desk: Desk) -> None:
    """A missing release that only another package requires stays `unresolvable`."""
    here = {"PIP_FIND_LINKS": str(desk.wheels), "PIP_NO_INDEX": "1"}

    ran = desk.run("try", "--python", "host", "fake-plain", "fake-unresolvable", **here)

    assert (ran.code, ran.out.partition(":")[0]) == (1, "unresolvable")


@pytest.mark.parametrize("options", [("--offline",), ()])
def test_an_index_that_does_not_answer_is_no_typo(desk: Desk, options: tuple[str, ...]) -> None:
    """`plan` works without network, and says what it could not check."""
    text = TEXT.format(asked="fake-healthy==9.9.9").replace('no_index = true, find_links = ["@WHEELS@"]', "")
    path = desk.matrix("m", text.replace("{  }", '{ default = "http://127.0.0.1:9/simple" }'))

    ran = desk.run("plan", path, *options)

    assert (ran.code, ran.err) == (0, "note: the package index could not be asked whether this exists: fake-healthy\n")


def test_good_input_is_not_asked_for_twice(desk: Desk) -> None:
    """A release that an index once listed is not looked up again; another release of the same package is."""
    cache = {"HARNESS_CACHE": str(desk.folder / "cache")}
    shelf = desk.folder / "shelf"
    shutil.copytree(desk.wheels, shelf)
    path = desk.matrix("m", TEXT.format(asked="fake-healthy==1.0").replace("@WHEELS@", str(shelf)))
    first = desk.run("plan", path, **cache)
    shutil.rmtree(shelf)

    again = desk.run("plan", path, **cache)
    path.write_text(path.read_text().replace("==1.0", "==9.9.9"))
    other = desk.run("plan", path, **cache)

    assert (first.err, again.err) == ("", "")
    assert other.err.startswith("note: the package index could not be asked")
