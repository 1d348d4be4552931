"""Controls: a failure counts against the packages only if a known-good lock of its adapter works on this machine."""

from __future__ import annotations

import hashlib
import json
import shutil
from typing import Any

import pytest
from commandline import SMALL, CommandResult, Desk
from packaging.utils import parse_wheel_filename

FRAME = "ContractViolation: blank frame: every pixel is [0, 0, 0]"
REAL = ("cloudpickle", "farama-notifications", "gymnasium", "numpy", "typing-extensions")
SAYS = "a gymnasium task failed; to rule out this machine, the control known is run, too"


def control(desk: Desk, fake: str, env: str, *, python: str = "host") -> dict[str, str]:
    """Write a folder with one control, of a fake; returns the variables with which a command uses it."""
    folder = desk.folder / "controls"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    text = (
        f'snapshot = "2026-01-01"\n[[control]]\nid = "known"\napi = "gymnasium"\npython = "{python}"\n'
        f'requirements = ["{fake}"]\nenv = "{env}"\nreason = "a test says so"\n'
    )
    (folder / "controls.toml").write_text(text, encoding="utf-8")
    names = {*REAL, "fake-healthy", fake}
    lines = []
    for path in desk.wheels.glob("*.whl"):
        name, version, *_ = parse_wheel_filename(path.name)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        lines += [f"{name}=={version} \\\n    --hash=sha256:{digest}\n"] if name in names else []
    (folder / "known.txt").write_text("".join(lines), encoding="utf-8")
    return {"HARNESS_CONTROLS": str(folder), "PIP_FIND_LINKS": str(desk.wheels), "PIP_NO_INDEX": "1"}


def small(desk: Desk, variables: dict[str, str], *options: str) -> tuple[CommandResult, dict[str, dict[str, Any]]]:
    """Run the small matrix; returns its cells by name."""
    ran = desk.run("run", "small.toml", "--json", *options, **variables)
    return ran, ran.cells("which")


def test_a_failure_stands_where_the_control_works(desk_with_results: Desk) -> None:
    """The control runs once, after something failed; the next run reuses its result and has nothing to do."""
    good = control(desk_with_results, "fake-healthy", "fake_healthy:Healthy-v0")
    ran, cells = small(desk_with_results, good)
    assert (ran.code, cells["blank"]["verdict"], cells["blank"]["decisive"]) == (1, "partial", FRAME)
    assert cells["blank"]["controls"] == {"gymnasium": {"control": "control known"}}
    assert "controls" not in cells["good"]
    assert SAYS in ran.err
    again = desk_with_results.run("run", "small.toml", **good)
    assert "nothing to do: all 2 results are reused" in again.out
    assert SAYS not in again.err


def test_a_failure_that_the_control_shares_says_nothing_about_packages(desk_with_results: Desk) -> None:
    """A cell whose control fails in the same way is inconclusive, with the control's line.

    Cells that work keep their verdict. With a working control the cell is red again.
    """
    bad = control(desk_with_results, "fake-blank-frame", "fake_blank_frame:BlankFrame-v0")
    ran, cells = small(desk_with_results, bad)
    line = f"control known fails, too, in render.rgb_array: {FRAME} (here: {FRAME})"
    assert (ran.code, cells["good"]["verdict"], cells["blank"]["verdict"]) == (3, "works", "inconclusive")
    assert (cells["blank"]["phase"], cells["blank"]["decisive"], cells["blank"]["as_expected"]) == (
        "render",
        line,
        None,
    )
    assert cells["blank"]["phases"]["single"] == "passed"
    shown = desk_with_results.run("show", "*-blank")
    assert f"? inconclusive in render\n  {line}" in shown.out
    assert desk_with_results.run("report", "small").code == 3
    good = control(desk_with_results, "fake-healthy", "fake_healthy:Healthy-v0")
    mended, cells = small(desk_with_results, good)
    assert (mended.code, cells["blank"]["verdict"], cells["blank"]["decisive"]) == (1, "partial", FRAME)


def test_a_control_that_fails_elsewhere_leaves_a_failure_alone(desk_with_results: Desk) -> None:
    """Failing vector workers of a control do not explain a blank frame."""
    ran, cells = small(desk_with_results, control(desk_with_results, "fake-worker", "fake_worker:Raises-v0"))
    assert (ran.code, cells["blank"]["verdict"], cells["blank"]["decisive"]) == (1, "partial", FRAME)
    assert list(cells["blank"]["controls"]["gymnasium"]["failed"]) == ["vector.async.fork"]


@pytest.mark.parametrize(
    ("python", "options", "without", "why"),
    [
        ("3.6", (), (), "resolve unavailable: python 3.6 is older than 3.7, the oldest that can be tried"),
        ("host", ("--offline",), ("PIP_FIND_LINKS", "PIP_NO_INDEX"), "resolve "),
    ],
    ids=["no Python", "offline"],
)
def test_a_control_that_cannot_be_run_changes_nothing(
    python: str, options: tuple[str, ...], without: tuple[str, ...], why: str, desk_with_results: Desk
) -> None:
    """A control that cannot be run leaves the failure as it is; the report says that it was not compared, and why."""
    given = control(desk_with_results, "fake-healthy", "fake_healthy:Healthy-v0", python=python)
    ran, cells = small(
        desk_with_results, {name: value for name, value in given.items() if name not in without}, *options
    )
    text = (
        "whether the adapter gymnasium works on this machine is not known: the control known could not be run: " + why
    )
    found = [one for one in cells["blank"]["findings"] if one["check"] == "control.gymnasium"]
    assert (ran.code, cells["blank"]["verdict"], cells["blank"]["decisive"]) == (1, "partial", FRAME)
    assert [(one["level"], one["text"][: len(text)]) for one in found] == [("note", text)]


def test_another_file_than_the_known_good_one_is_no_control(desk_with_results: Desk) -> None:
    """A wheel with another hash, from whatever index, proves nothing."""
    given = control(desk_with_results, "fake-healthy", "fake_healthy:Healthy-v0")
    lock = desk_with_results.folder / "controls" / "known.txt"
    digest = hashlib.sha256(next(desk_with_results.wheels.glob("fake_healthy-*.whl")).read_bytes()).hexdigest()
    lock.write_text(lock.read_text().replace(digest, "0" * 64))
    ran, cells = small(desk_with_results, given)
    assert ran.code == 1
    assert cells["blank"]["controls"]["gymnasium"]["untold"] == (
        "the control known could not be run: "
        "fake-healthy 1.0 from the package index is not the one that is known to be good"
    )


def test_try_and_the_pytest_face_ask_the_control_too(desk_with_results: Desk) -> None:
    """`try` exits with 3 and quotes the control's line; the pytest item of the failed phase fails as inconclusive."""
    bad = control(desk_with_results, "fake-blank-frame", "fake_blank_frame:BlankFrame-v0")
    tried = desk_with_results.run("try", "fake-blank-frame==1.0", "--env", "fake_blank_frame:BlankFrame-v0", **bad)
    line = f"control known fails, too, in render.rgb_array: {FRAME} (here: {FRAME})"
    assert (tried.code, tried.out.splitlines()[1]) == (3, line)
    arguments = ("--pyargs", "harness.smoke", "--matrix", "small.toml", "-rf", "-k", "blank and (render or verdict)")
    face = desk_with_results.run(*arguments, module="pytest", **bad)
    assert f"inconclusive: {line}" in face.out
    assert (face.code, face.out.count("FAILED ")) == (1, 2)


def test_fetch_brings_controls(desk: Desk) -> None:
    """`fetch` includes controls, so that a run from the fetched folder can run them without a network."""
    bad = control(desk, "fake-blank-frame", "fake_blank_frame:BlankFrame-v0")
    desk.matrix("small", SMALL.read_text())
    fetched = desk.run("fetch", "small.toml", "--to", "brought", **bad)
    manifest = json.loads((desk.folder / "brought" / "manifest.json").read_text())
    assert (fetched.code, fetched.out.splitlines()[0].partition(";")[0]) == (0, "2 cells, 2 with a lock")
    assert [cell["id"] for cell in manifest["cells"]][:1] == ["controls/known"]
    shutil.rmtree(desk.state)
    ran = desk.run("run", "small.toml", "--fetched", "brought", "--json", HARNESS_CONTROLS=bad["HARNESS_CONTROLS"])
    assert (ran.code, ran.cells("which")["blank"]["verdict"]) == (3, "inconclusive")


def test_unreadable_controls_are_refused_before_anything_is_measured(desk_with_results: Desk) -> None:
    """Unreadable controls are bad input at the start of a run, not only when something first fails."""
    missing = desk_with_results.folder / "nowhere"
    ran = desk_with_results.run("run", "small.toml", "--fresh", "-k", "*good*", HARNESS_CONTROLS=str(missing))
    assert (ran.code, ran.err) == (
        2,
        f"simmatrix: {missing}/controls.toml: cannot be read: No such file or directory; "
        "HARNESS_CONTROLS names the folder of the controls\n",
    )
