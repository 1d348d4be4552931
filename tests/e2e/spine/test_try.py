"""`try` answers in one line which phases were tried, or why it fails and what to type next."""

from __future__ import annotations

import json
import platform
import re

import pytest
from commandline import Desk

from harness.machine import this_machine

HERE = platform.python_version()


def test_a_working_answer_is_one_line(desk: Desk) -> None:
    """The answer names the phases that passed, the environment and the Python."""
    ran = _try(desk, "fake-healthy==1.0", "--env", "fake_healthy:Healthy-v0")
    works = f"works: fake-healthy 1.0: import, single, vector, render of fake_healthy:Healthy-v0 on Python {HERE}\n"
    assert ran == (0, works)


def test_a_red_answer_ends_with_the_reason_and_the_next_command(desk: Desk) -> None:
    """A red answer ends with the decisive line and the next command, and that command works."""
    code, out = _try(desk, "fake-blank-frame==1.0", "--env", "fake_blank_frame:BlankFrame-v0")
    cell = out.rpartition(" ")[2].strip()
    assert code == 1
    assert re.fullmatch(
        rf"try/py{HERE}_fake-blank-frame-1.0_\+env-fake-blank-frame-BlankFrame-v0_\+[0-9a-f]{{8}}", cell
    )
    assert out.splitlines() == [
        "partial: fake-blank-frame 1.0: import, single, vector of fake_blank_frame:BlankFrame-v0; "
        f"render failed of fake_blank_frame:BlankFrame-v0 on Python {HERE}",
        "ContractViolation: blank frame: every pixel is [0, 0, 0]",
        f"next: simmatrix show {cell}",
    ]
    assert desk.run("show", cell).code == 0
    assert desk.run("show", f"try/py{HERE}-fake-blank-frame1.0").out == desk.run("show", cell).out


def test_a_phase_that_could_not_be_shown_is_named(desk: Desk) -> None:
    """If the requested drawing is impossible here, the other phases work and the render is not verified."""
    hidden = {"__EGL_VENDOR_LIBRARY_DIRS": str(desk.folder), "LIBGL_DRIVERS_PATH": str(desk.folder)}
    asked = ("fake-needs-gl==1.0", "--env", "fake_needs_gl:NeedsGl-v0", "--set", "MUJOCO_GL=egl")
    code, out = _try(desk, *asked, **hidden)
    works = (
        "works: fake-needs-gl 1.0: import, single, vector of fake_needs_gl:NeedsGl-v0 on Python "
        f"{HERE}; render not verified: no EGL here"
    )
    assert (code, out[: len(works)]) == (0, works)
    assert "install Debian's libegl1 and libgl1-mesa-dri" in " ".join(out.split())
    assert out.endswith("(RuntimeError: glfw: no display to draw on)\n")


def test_a_failed_drawing_is_red_where_egl_is(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    """With EGL on this machine, an environment that cannot draw is itself at fault."""
    monkeypatch.setenv("HARNESS_CACHE", str(desk.cache))
    if not this_machine.facts().capabilities & {"egl", "osmesa"}:
        pytest.skip("missing library: EGL")
    code, out = _try(desk, "fake-needs-gl==1.0", "--env", "fake_needs_gl:NeedsGl-v0")
    assert code == 1
    assert out.splitlines()[1] == "RuntimeError: glfw: no display to draw on"


def test_a_python_that_nobody_has_is_3(desk: Desk) -> None:
    """A missing Python says nothing about packages; the answer says how to install it."""
    ran = desk.run("try", "fake-plain", "--python", "3.99", "--import", "fake_plain", **_index(desk))
    assert ran.code == 3
    assert ran.out == (
        "unavailable: python 3.99 is not on this machine and uv could not download it; "
        "install it with `uv python install 3.99` or pyenv, then run again\n"
    )


def test_a_file_that_wants_another_python_is_3(desk: Desk) -> None:
    """If a file allows no Python of this machine, no forbidden one is tried in its place."""
    project = desk.folder / "pyproject.toml"
    project.write_text('[project]\nname = "mine"\nrequires-python = ">=3.99"\ndependencies = ["fake-plain"]\n')
    ran = desk.run("try", "-r", project, "--import", "fake_plain", **_index(desk))
    assert (ran.code, ran.out.partition(";")[0]) == (
        3,
        "unavailable: python 3.99 is not on this machine and uv could not download it",
    )
    project.write_text('[project]\nname = "mine"\nrequires-python = "<3,>3"\ndependencies = ["fake-plain"]\n')
    ran = desk.run("try", "-r", project, **_index(desk))
    assert (ran.code, ran.err) == (
        2,
        "simmatrix: try: no Python version satisfies all requirements: <3,>3; name one with --python\n",
    )


def test_an_impossible_python_is_bad_input(desk: Desk) -> None:
    """A `--python` that can be no version is a mistake, not something this machine lacks; nothing is kept."""
    ran = desk.run("try", "fake-plain", "--python", "py311", **_index(desk))
    assert (ran.code, ran.out) == (2, "")
    assert ran.err == 'simmatrix: --python: "py311" is not a version; ids name resolved versions only\n'
    ran = desk.run("try", "fake-plain", "--python", "./no/python", **_index(desk))
    assert (ran.code, ran.err) == (
        2,
        "simmatrix: --python ./no/python: no such Python on this machine; name a version such as 3.11, or a path\n",
    )


def test_a_contradiction_is_1(desk: Desk) -> None:
    """Requirements without a solution are answered with uv's explanation."""
    code, out = _try(desk, "fake-plain", "fake-unresolvable", "--import", "fake_plain")
    assert code == 1
    assert out.startswith(f"unresolvable: resolve failed on Python {HERE}\nBecause only fake-plain>=1.0 is available")


def test_no_requirement_is_2(desk: Desk) -> None:
    """Nothing to try is bad input, in one sentence."""
    ran = desk.run("try", **_index(desk))
    assert (ran.code, ran.out, ran.err) == (
        2,
        "",
        "simmatrix: try: name at least one requirement, such as 'gymnasium[mujoco]==1.2.3'\n",
    )


def test_the_document_is_that_of_a_run(desk: Desk) -> None:
    """`--json` prints the same document; the second time everything is reused."""
    arguments = ("fake-healthy==1.0", "--env", "fake_healthy:Healthy-v0", "--json", "--python", "host")
    first, second = (desk.run("try", *arguments, **_index(desk)) for _ in range(2))
    (one,), (two,) = first.document["cells"], second.document["cells"]
    assert (first.code, one["verdict"], one["id"], one["reused"]) == (
        0,
        "works",
        one["id"],
        False,
    )
    assert one["id"].startswith(f"try/py{HERE}_fake-healthy-1.0_+env-fake-healthy-Healthy-v0_+")
    assert (second.code, two["verdict"], two["reused"]) == (0, "works", True)
    assert (desk.folder / one["lock"]).is_file()


def test_a_submodule_that_registers_is_found(desk: Desk) -> None:
    """An id that importing the package does not register is looked for in its submodules, and only in those."""
    code, out = _try(desk, "fake-submodule", "--env", "Below-v2")
    assert (code, out) == (
        0,
        f"works: fake-submodule 1.0: import, single, vector, render of Below-v2 on Python {HERE}; "
        "registered by `import fake_submodule.envs`\n",
    )


def test_an_id_that_nothing_registers_is_2(desk: Desk) -> None:
    """A mistyped id is bad input with the nearest names, never a fact about packages: nothing is kept of it."""
    asked = ("try", "fake-submodule", "--python", "host", "--env")
    ran = desk.run(*asked, "Below-v1", **_index(desk))
    assert (ran.code, ran.out) == (2, "")
    assert "nor does what was imported to look for it (fake_submodule, fake_submodule.envs)" in ran.err
    assert ran.err.endswith("; did you mean Below-v2?\n")
    ran = desk.run(*asked, "Belov-v2", **_index(desk))
    assert (ran.code, ran.err.rpartition("; ")[2]) == (2, "did you mean Below-v2?\n")
    assert not list(desk.state.glob("cells/*/try/*.json"))


def test_a_package_that_was_not_run_is_no_part_of_works(desk: Desk) -> None:
    """A package that was only installed beside the environment makes the answer 3, and is named first."""
    code, out = _try(desk, "fake-plain", "fake-healthy", "--env", "fake_healthy:Healthy-v0")
    first, last = out.splitlines()
    assert code == 3
    assert first.startswith(
        "not run: nothing of fake-plain was run: fake_healthy:Healthy-v0 is an environment of fake-healthy; "
        "fake-healthy 1.0: import, single, vector, render of"
    )
    assert last == "next: simmatrix try fake-plain --python host"


def test_without_an_environment_it_says_what_there_is(desk: Desk) -> None:
    """Without an environment a package is imported, and the answer lists its submodules' ids and how to run one."""
    code, out = _try(desk, "fake-submodule")
    assert code == 3
    assert out.splitlines() == [
        f"not run: fake-submodule 1.0 was only imported on Python {HERE}; no environment was run",
        "it registers with gymnasium: Below-v2",
        "next: simmatrix try fake-submodule --python host --env Below-v2",
    ]


def test_rewards_are_as_the_environment_declares_them(desk: Desk) -> None:
    """Vector rewards declared by `reward_space` pass, and undeclared ones fail."""
    code, out = _try(desk, "fake-vector-reward", "--env", "fake_vector_reward:VectorReward-v0")
    assert (code, " ".join(out.partition("; ")[2].split())) == (
        0,
        "vector does not apply: its rewards are 2 numbers, and environments in batches hold one of each",
    )
    code, out = _try(desk, "fake-vector-reward", "--env", "fake_vector_reward:Undeclared-v0")
    assert (code, out.splitlines()[1]) == (
        1,
        "ContractViolation: step() returned a reward of shape (2,), not ()",
    )


def test_a_failure_under_our_own_setting_is_none(desk: Desk) -> None:
    """A picture that is black under our own SDL driver is drawn in another way; a user's driver is kept."""
    asked = ("fake-dummy-black", "--env", "fake_dummy_black:DummyBlack-v0")
    ran = desk.run("try", *asked, "--python", "host", "--json", **_index(desk))
    (cell,) = ran.document["cells"]
    assert (ran.code, cell["verdict"]) == (0, "works")
    assert cell["supplied"].get("SDL_VIDEODRIVER") != "dummy"
    code, _ = _try(desk, *asked, "--set", "SDL_VIDEODRIVER=dummy")
    assert code == 1


def test_everything_that_a_file_asks_for_is_asked(desk: Desk) -> None:
    """Constraints, overrides and build constraints of a file are those of the trial."""
    (desk.folder / "pyproject.toml").write_text(
        """[project]
name = "mine"
version = "1.0"
dependencies = ["fake-plain"]
[tool.uv]
constraint-dependencies = ["fake-plain<3"]
override-dependencies = ["fake-tool==1.0"]
build-constraint-dependencies = ["fake-build-tool<2"]
"""
    )
    _try(desk, "-r", "pyproject.toml", "--build-constraint", "fake-healthy<9")
    (file,) = desk.state.glob("cells/*/try/*.json")
    question = json.loads(file.read_text())["cell"]["question"]
    assert [question[kind] for kind in ("requirements", "constraints", "overrides", "build_constraints")] == [
        ["fake-plain"],
        ["fake-plain<3"],
        ["fake-tool==1.0"],
        ["fake-healthy<9", "fake-build-tool<2"],
    ]


def _try(desk: Desk, *arguments: str, **variables: str) -> tuple[int, str]:
    """Run `try` with the Python of the tests and the shelf of wheels as index; return exit code and output."""
    ran = desk.run("try", *arguments, "--python", "host", **_index(desk), **variables)
    return ran.code, ran.out


def _index(desk: Desk) -> dict[str, str]:
    return {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(desk.wheels)}
