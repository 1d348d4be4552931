"""Remedies found by experiment on packages made for it, and proven: `repair`, and `run --repair`."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import market
import pytest
from commandline import CommandResult, Desk, DeskRun
from filelock import FileLock
from market import LAST, LATER, LONG_AGO, ROBOT, line, robot

from harness.machine import interpreters

TOOL = "VERSION = '@VERSION@'\nif int(VERSION[0]) < 2:\n    old_grip = 1\n"
MANY = {"1.1": LONG_AGO, "1.2": ROBOT, "2.0": LATER, "2.1": LATER, "3.0": LAST}
TWO = {"1.5": ROBOT, "2.0": LATER}
FICKLE = "mark = os.environ['FICKLE']; first = not os.path.exists(mark); open(mark, 'w').close(); assert not first"
REFUSAL = """import toolbox; assert toolbox.VERSION < '2', 'this is only supported on `toolbox<2`'; 1 / 0"""
PARTS = [f"part-{letter}" for letter in "abcdefgh"]
SIGNATURE = """
[[signature]]
id = "grip"
phases = ["single"]
pattern = "has no attribute 'old_grip'"
packages = ["toolbox>=2"]
cause = "The grip of toolbox 1 is gone."
remedy = {{ constraints = [{lines}] }}
examples = ["has no attribute 'old_grip'", "x has no attribute 'old_grip'", "y has no attribute 'old_grip'"]
"""
RELEASES = [
    *line("toolbox", MANY, TOOL),
    *line("paint", TWO),
    *line("glue", TWO),
    *line("bolts", {"1.4": ROBOT, "1.5": LATER}, TOOL.replace("int(VERSION[0]) < 2", "VERSION < '1.5'")),
    robot("single", "import toolbox; toolbox.old_grip", ["toolbox", "paint", "glue"]),
    robot("pair", "import toolbox, bolts; (toolbox.old_grip, bolts.old_grip)", ["toolbox", "paint", "bolts"]),
    robot("undeclared", "import packaging"),
    robot("colour", "assert 'PYOPENGL_PLATFORM' not in os.environ, 'no OpenGL platform of this name'"),
    robot("hopeless", "raise RuntimeError('it cannot be')", ["toolbox", "paint"]),
    robot("fine", "pass"),
    robot("fickle", FICKLE, ["toolbox", "paint"]),
    market.Release(name="frame", version="1.0", day=LONG_AGO, about={"tag": "cp39-none-any"}),
    market.Release(name="frame", version="2.0", day=LATER),
    *(market.Release(name=name, version="1.0", day=ROBOT, code="import toolbox\ntoolbox.old_grip\n", requires=needs)
      for name, needs in (("gripper", ["toolbox"]), ("aged", ["toolbox", "frame"]))),
    robot("pinned", "import toolbox; toolbox.old_grip", ["toolbox"]),
    robot("strict", "pass", ["toolbox<2,>=1.1"]),
    *(market.Release(name="refuser", version=version, day=LONG_AGO if version == "1.0" else ROBOT,
                     code=robot("refuser", code).code, requires=["fake-healthy", "toolbox"])
      for version, code in (("1.0", "pass"), ("2.0", REFUSAL))),
    robot("many", "import toolbox; toolbox.old_grip", ["toolbox", *PARTS]),
    *(release for name in PARTS for release in line(name, TWO)),
    market.Release(
        name="carved", version="1.0", day=ROBOT, code=robot("carved", "pass").code, requires=["fake-healthy"],
        hooks="import setuptools\n\n\ndef files(found):\n    if setuptools.VERSION >= '66':\n"
        "        raise RuntimeError('extras_require must be a dictionary')\n    return found\n",
        about={"build-requires": ["setuptools"]},
    ),
    *line("setuptools", {"60.0": LONG_AGO, "65.0": ROBOT, "66.0": LATER, "70.0": LAST}, "VERSION = '@VERSION@'\n"),
]  # fmt: skip
MATRIX = """
snapshot = "2026-10-01"
index = {{ default = "{index}" }}

[axes]
python = ["host"]

[axes.which]
{cells}
"""
CELL = """{name} = {{ requirements = [{requirements}], cases = [{{ env = "{module}:{module}-v0", api = "gymnasium", checks = ["single"] }}]{more} }}"""  # noqa: E501 - one line of TOML
CELLS = {
    "single": (["single==1.0"], ""),
    "again": (["single==1.0"], ', environment = { ROBOT = "again" }'),
    "pair": (["pair==1.0"], ""),
    "undeclared": (["undeclared==1.0"], ""),
    "colour": (["colour==1.0"], ', environment = { PYOPENGL_PLATFORM = "vga" }'),
    "hopeless": (["hopeless==1.0"], ""),
    "carved": (["carved==1.0"], ""),
    "pinned": (["pinned==1.0", "toolbox==2.1"], ""),
    "fine": (["fine==1.0"], ""),
    "strict": (["strict==1.0", "toolbox==2.1"], ""),
    "refuser": (["refuser==2.0"], ""),
    "many": (["many==1.0"], ""),
    "fickle": (["fickle==1.0"], ', environment = { FICKLE = "@FOLDER@/fickle" }'),
}


NEEDS_OLDER = pytest.mark.skipif(interpreters.find("3.9") is None, reason="unavailable: python3.9")
TOGETHER = ("single", "again", "hopeless", "fine")
"""Those that are repaired by one run; the others each by a command of their own."""


def written(desk: Desk, index: str, cells: tuple[str, ...]) -> Path:
    """Write a matrix with a cell for each of these robots, and return its path."""
    lines = "\n".join(
        CELL.format(
            name=name,
            requirements=", ".join(map(json.dumps, CELLS[name][0])),
            module=CELLS[name][0][0].partition("=")[0],
            more=CELLS[name][1],
        )
        for name in cells
    )
    return desk.matrix("market", MATRIX.format(index=index, cells=lines))


@pytest.fixture(scope="session")
def index(together: Path, wheels: Path) -> str:
    """Return the address of the index, which is written once for all workers of the session."""
    folder = together / "index"
    with FileLock(together / "index.lock"):
        if not folder.exists():
            making = together / "making-index"
            market.write_index(making, folder, wheels, RELEASES)
            making.rename(folder)
    return (folder / "simple").as_uri()


@pytest.fixture(scope="session")
def repaired(once: Callable[[str, Callable[[Desk], CommandResult]], DeskRun], index: str) -> DeskRun:
    """Return a run of some robots in which every red cell was repaired."""
    return once(
        "market",
        lambda desk: desk.run("run", written(desk, index, TOGETHER), "--repair", "--json", HARNESS_SIGNATURES=""),
    )


def proof(measured: DeskRun, which: str) -> dict[str, Any]:
    """Return the document of the repair of a cell."""
    (folder,) = (measured.desk.state / "repairs").glob(f"*/*_{which}")
    made: dict[str, Any] = json.loads((folder / "repair.json").read_text(encoding="utf-8"))
    return made


def is_shown_needed(made: dict[str, Any]) -> bool:
    """Return whether the runs show that each part of the remedy is needed and all of them are enough."""
    runs, remedy = made["runs"], made["remedy"]
    without = [runs[part["without"] - 1]["verdict"] for part in remedy["parts"]]
    enough = runs[remedy["proof"] - 1]
    return "works" not in without and enough["verdict"] == "works" and remedy["necessary"] and remedy["sufficient"]


@pytest.mark.parametrize(
    ("which", "change"),
    [
        pytest.param("pair", {"constraints": ["toolbox<2", "bolts<1.5"]}, id="two that are both needed"),
        pytest.param("undeclared", {"requirements": ["packaging"]}, id="what nothing requires"),
        pytest.param("carved", {"build_constraints": ["setuptools<66"]}, id="what an sdist is built with"),
        pytest.param("colour", {"environment": {"PYOPENGL_PLATFORM": ""}}, id="a variable"),
        pytest.param("pinned", {"requirements": ["toolbox==1.2"]}, id="what the user asks for"),
    ],
)
def test_smallest_change(desk: Desk, index: str, which: str, change: dict[str, Any]) -> None:
    """The smallest change is found: each bound begins at the first failure.

    Each part is shown to be needed, and the whole to be enough.
    """
    ran = desk.run("repair", f"{written(desk, index, (which,))}/*-{which}", "--json", HARNESS_SIGNATURES="")
    made = ran.document
    assert (ran.code, made["status"], made["remedy"]["change"]) == (0, "found", change)
    assert is_shown_needed(made)
    assert made["remedy"]["moved"] == (["toolbox"] if which == "pinned" else [])


def test_bound_that_the_error_names(desk: Desk, index: str) -> None:
    """A bound that the error or the resolver names is tried first, though the user asks for another release."""
    ran = desk.run("repair", f"{written(desk, index, ('strict',))}/*-strict", "--json", HARNESS_SIGNATURES="")
    made = ran.document
    assert (ran.code, made["remedy"]["change"]) == (0, {"requirements": ["toolbox>=1.1,<2"]})
    assert made["remedy"]["moved"] == ["toolbox"]
    assert len(made["runs"]) == 2
    assert is_shown_needed(made)


def test_older_release_that_does_not_refuse_yet(desk: Desk, index: str) -> None:
    """An older release that does not refuse yet is no remedy alone: the refused package needs its bound, too."""
    ran = desk.run("repair", f"{written(desk, index, ('refuser',))}/*-refuser", "--json", HARNESS_SIGNATURES="")
    made = ran.document
    assert made["runs"][1]["why"] == "the error names toolbox<2"
    assert ran.code == 0
    assert made["remedy"]["change"] == {"requirements": ["refuser==1.0"], "constraints": ["toolbox<2"]}


def test_parts_are_left_out_by_halves_and_bounds_are_widened(desk: Desk, index: str, tmp_path: Path) -> None:
    """Of the nine bounds of a known remedy only the necessary one stays, as wide as possible."""
    lines = ", ".join(f'"{name}<2"' for name in PARTS)
    known = tmp_path / "known"
    known.mkdir()
    (known / "known.toml").write_text(SIGNATURE.format(lines=f'{lines}, "toolbox<1.2"'), encoding="utf-8")
    ran = desk.run("repair", f"{written(desk, index, ('many',))}/*-many", "--json", HARNESS_SIGNATURES=str(known))
    made = ran.document
    assert (ran.code, made["remedy"]["change"]) == (0, {"constraints": ["toolbox<2"]})
    assert is_shown_needed(made)
    leaving_out = [run for run in made["runs"] if run["why"].endswith(" of the remedy")]
    assert len(leaving_out) <= 5


def test_package_that_nobody_named(repaired: DeskRun) -> None:
    """A package that nobody named is bounded from its first failing release, and no other package with it."""
    made = proof(repaired, "single")
    assert (made["status"], made["remedy"]["change"], is_shown_needed(made)) == (
        "found",
        {"constraints": ["toolbox<2"]},
        True,
    )


def test_once_per_cause(repaired: DeskRun) -> None:
    """The remedy of one cell is tried on the next with the same cause, and measured there, too."""
    made = proof(repaired, "again")
    assert (made["remedy"]["change"], is_shown_needed(made)) == ({"constraints": ["toolbox<2"]}, True)
    assert [run["why"] for run in made["runs"][1:2]] == ["it cured another cell of the same cause"]


def test_nothing_cures(repaired: DeskRun) -> None:
    """If no change cures the cell, no remedy is claimed."""
    made = proof(repaired, "hopeless")
    assert (made["status"], made["remedy"], made["stopped"]) == ("not found", None, None)
    assert len(made["runs"]) > 1


def test_report_shows_repaired_cells(repaired: DeskRun) -> None:
    """The report shows each repaired cell beside the red one; the exit code counts the red ones alone."""
    cells = {cell["id"].partition("_")[2]: cell for cell in repaired.ran.document["cells"]}
    assert repaired.ran.code == 1
    assert (cells["single_with-repair"]["verdict"], cells["single"]["verdict"]) == ("works", "broken")
    assert cells["single_with-repair"]["change"]["does"] == ["pin `toolbox<2`"]
    assert cells["single_with-repair"]["base"] == cells["single"]["id"]
    page = (repaired.desk.state / "reports" / "market" / "report.md").read_text(encoding="utf-8")
    assert re.search(
        r"\*\*Fix\*\* \(proven by `.*_with-repair`\): Pin `toolbox<2`\.\n\n```sh\npip install 'toolbox<2'\n", page
    )
    assert "hopeless_with-repair" not in cells
    assert "fine_with-repair" not in cells


def test_proof_repeats_with_one_command(repaired: DeskRun, desk: Desk) -> None:
    """`repair` runs the proof again with one command; its lock and a page are stored beside it."""
    shutil.copytree(repaired.desk.state, desk.state)
    (folder,) = (desk.state / "repairs").glob("*/*_single")
    assert "toolbox==1.2" in (folder / "lock.txt").read_text(encoding="utf-8")
    assert "pin `toolbox<2`" in (folder / "repair.md").read_text(encoding="utf-8")
    matrix = repaired.desk.folder / "market.toml"
    ran = desk.run("repair", f"{matrix}/*-single", HARNESS_SIGNATURES="")
    assert ran.code == 0
    assert "remedy: pin `toolbox<2`\n  constraints.txt: toolbox<2\n" in ran.out
    assert "necessary: it fails without the step: pin `toolbox<2` (run 1: broken in single)\n" in ran.out
    assert "sufficient: with it every check passes (run " in ran.out


@pytest.mark.parametrize(
    "name",
    ["gripper", pytest.param("aged", id="what was, where it could be installed", marks=NEEDS_OLDER)],
)
def test_cell_that_only_imports(desk: Desk, index: str, name: str) -> None:
    """A cell that only imports never `works`, but is cured if all requested imports pass."""
    cell = f'{name} = {{ requirements = ["{name}==1.0"], cases = [{{ id = "import", imports = ["{name}"] }}] }}'
    matrix = desk.matrix("market", MATRIX.format(index=index, cells=cell))
    ran = desk.run("repair", f"{matrix}/*-{name}", "--json", HARNESS_SIGNATURES="")
    made = ran.document
    assert (ran.code, made["status"], made["remedy"]["change"]) == (0, "found", {"constraints": ["toolbox<2"]})
    assert made["remedy"]["necessary"]
    assert made["remedy"]["sufficient"]
    assert made["runs"][made["remedy"]["proof"] - 1]["ended"] == "passes import, all that was requested"


def test_no_change_is_credited_with_curing_a_flaky_cell(desk: Desk, index: str) -> None:
    """No change is credited with curing a cell that fails once and then works."""
    ran = desk.run("repair", f"{written(desk, index, ('fickle',))}/*-fickle", "--json", HARNESS_SIGNATURES="")
    assert ran.code == 3
    assert (ran.document["status"], ran.document["remedy"]) == ("could not tell", None)
    assert "it is flaky" in ran.document["told"][-1]


def test_green_already(repaired: DeskRun, desk: Desk) -> None:
    """Nothing to repair is no failure."""
    shutil.copytree(repaired.desk.state, desk.state)
    ran = desk.run("repair", f"{repaired.desk.folder / 'market.toml'}/*-fine")
    assert (ran.code, ran.out.partition("\n")[0].partition(" ")[2]) == (0, "works: there is nothing to repair")


def test_bounds(repaired: DeskRun, desk: Desk) -> None:
    """A search that is cut short says so, and names the untried changes."""
    ran = desk.run("repair", f"{repaired.desk.folder / 'market.toml'}/*-hopeless", "--runs", "1", HARNESS_SIGNATURES="")
    assert ran.code == 1
    assert "stopped early: 1 runs are used up; not tried yet: the index as it stood, " in ran.out


def test_as_try_asks(desk: Desk, index: str) -> None:
    """`repair` takes requirements like `try`, and checks the same; without their interpreter it draws no conclusion."""
    given = {"UV_DEFAULT_INDEX": index, "HARNESS_SIGNATURES": ""}
    asked = ("undeclared==1.0", "--env", "undeclared:undeclared-v0", "--api", "gymnasium", "--as-of", "2026-10-01")
    ran = desk.run("repair", *asked, "--python", "host", "--json", **given)
    assert (ran.code, ran.document["remedy"]["change"]) == (0, {"requirements": ["packaging"]})
    assert ran.document["remedy"]["unverified"] == []
    nowhere = desk.run("repair", *asked, "--python", "3.6", **given)
    assert nowhere.code == 3
    assert "the packages were not tested" in nowhere.out


def test_without_anything_to_repair(desk: Desk) -> None:
    """Without a cell or requirements the message says what to type."""
    ran = desk.run("repair")
    assert (ran.code, ran.err) == (
        2,
        "simmatrix: repair: name a combination, such as 'quickstart/py3.11_*', or requirements, such as "
        "'gym==0.26.2'\n",
    )
