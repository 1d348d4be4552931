"""Find where a cell broke, on packages made for it: along releases, days and Pythons, with a certificate."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import market
import msgspec
import pytest
from commandline import CommandResult, Desk
from filelock import FileLock
from market import LONG_AGO, ROBOT, Release, line, robot

from harness.machine import interpreters
from harness.rootcause.bisection.certificates import BisectDocument

TOOL = """
import os

VERSION = (1, int("@VERSION@".split(".")[1]))
if VERSION < (1, 6):
    grip = True
if VERSION < (1, 3):
    early = True


def chained():
    if VERSION >= (1, 3):
        raise (RuntimeError("no such socket") if VERSION < (1, 6) else ValueError("no such robot"))


def sometimes():
    # At the first run ever of 1.6 all goes well, which is told by the home of that run.
    first = os.environ["LOOKS"]
    if not os.path.exists(first) and VERSION == (1, 6):
        with open(first, "w") as file:
            file.write(os.environ["HOME"])
    lucky = VERSION == (1, 6) and open(first).read() == os.environ["HOME"]
    assert lucky or VERSION < (1, 6), "out of luck"


def window():
    assert VERSION >= (1, 8), "too old for it"
    if VERSION > (1, 8):
        raise AttributeError(f"tool 1.{VERSION[1]} has no window")
"""
DAYS = {f"1.{number}": f"2026-03-{number + 1:02}" for number in range(14)}
NEW = "import sys\n\nif sys.version_info >= (3, @MINOR@):\n    raise ImportError('this is too new')\n"
RELEASES = [
    *(
        Release(
            name="tool", version=version, day=day, code=TOOL.replace("@VERSION@", version),
            requires=["nowhere-to-be-had"] if version in {"1.4", "1.7"} else [],
        )
        for version, day in DAYS.items()
    ),
    Release(name="tool", version="1.20", day=LONG_AGO, about={"tag": "cp36-cp36m-win32"}),
    *line("paint", {"2.0": ROBOT, "2.1": "2026-03-09", "2.2": "2026-03-12"}),
    robot("arm", "import tool; tool.grip", ["tool<1.13", "paint"]),
    robot("chain", "import tool; tool.chained()", ["tool"]),
    robot("fine", "import tool", ["tool"]),
    robot("hopeless", "import tool; tool.none", ["tool>=1.12"]),
    robot("sometimes", "import tool; tool.sometimes()", ["tool"]),
    robot("declares", "import tool; tool.early", ["tool>=1.2"]),
    robot("picky", "import tool", ["tool<1.8"]),
    *line("late", {"1.0": LONG_AGO, "2.0": "2026-03-20"}, "VERSION = '@VERSION@'\n"),
    robot("slow", "import late; assert late.VERSION < '2'", ["late"]),
    robot("window", "import tool; tool.window()", ["tool"]),
]  # fmt: skip
MATRIX = """
snapshot = "2026-10-01"
index = {{ default = "{index}" }}

[axes]
python = ["host"]

[axes.which]
{cells}
"""
CELL = """{name} = {{ requirements = [{requirements}], cases = [{{ {case} }}]{more} }}"""
ROBOTS = ("arm", "chain", "fine", "hopeless", "sometimes", "window", "declares", "slow")


@pytest.fixture(scope="session")
def host() -> interpreters.Interpreter:
    """Return the Python that runs this test."""
    found = interpreters.find("host")
    assert found
    return found


@pytest.fixture(scope="session")
def index(together: Path, wheels: Path, host: interpreters.Interpreter) -> str:
    """Return the address of the index, which is written once for all workers of the session."""
    folder = together / "bisect-index"
    new = Release(name="new", version="1.0", day=ROBOT, code=NEW.replace("@MINOR@", host.minor.partition(".")[2]))
    with FileLock(together / "bisect-index.lock"):
        if not folder.exists():
            making = together / "making-bisect-index"
            market.write_index(making, folder, wheels, [*RELEASES, new])
            making.rename(folder)
    return (folder / "simple").as_uri()


def written(desk: Desk, index: str) -> Path:
    """Write the matrix of all robots and return its path."""
    lines = [
        CELL.format(
            name=name,
            requirements=f'"{name}==1.0"',
            case=f'env = "{name}:{name}-v0", api = "gymnasium", checks = ["single"]',
            more=f', environment = {{ LOOKS = "{desk.folder}/looks" }}' if name == "sometimes" else "",
        )
        for name in ROBOTS
    ]
    lines.append(CELL.format(name="new", requirements='"new==1.0"', case='imports = ["new"]', more=""))
    picky = CELL.format(
        name="picky",
        requirements='"picky==1.0", "tool==1.13"',
        case='env = "picky:picky-v0", api = "gymnasium"',
        more="",
    )
    lines.append(picky)
    lines.append(CELL.format(name="loads", requirements='"tool<1.13"', case='imports = ["tool"]', more=""))
    return desk.matrix("market", MATRIX.format(index=index, cells="\n".join(lines)))


def bisected(desk: Desk, index: str, which: str, *options: str) -> tuple[CommandResult, BisectDocument]:
    """Run one bisection of the cell of a robot, and return it with its certificate."""
    ran = desk.run("bisect", f"{written(desk, index)}/*-{which}", *options, "--json", HARNESS_SIGNATURES="")
    assert ran.out, ran.err
    return ran, msgspec.json.decode(ran.out, type=BisectDocument)


def neighbours(made: BisectDocument) -> tuple[str, str] | None:
    """Return the last good and the first bad candidate, or None if the certificate lacks one of them."""
    return (made.good.candidate, made.bad.candidate) if made.good and made.bad else None


def test_release_that_nobody_pinned(desk: Desk, index: str) -> None:
    """The first bad release is found, though no requirement pins its package.

    The certificate has its neighbours, the omitted releases, every run, and a command that repeats the result.
    """
    ran, made = bisected(desk, index, "arm", "--axis", "tool")

    assert (ran.code, made.status, neighbours(made)) == (0, "found", ("1.5", "1.6")), ran.err
    assert made.claim == (
        "tool 1.5 is the last that works and tool 1.6 the first that fails with "
        "AttributeError: module 'tool' has no attribute 'grip'"
    )
    assert [one.name for one in made.moved] == ["tool"]
    assert made.asked - made.for_an_end <= 1.5 * made.bound
    assert made.built <= made.bound + made.for_an_end
    assert any("1.20" in one for one in made.left_out)
    assert "about" in ran.err
    assert made.good
    assert made.bad
    assert [made.runs[one.run - 1].verdict for one in (made.good, made.bad)] == ["works", "broken"]
    assert all(run.lock_sha256 for run in made.runs if run.answer != "untestable")
    folder = (desk.folder / made.files[0]).parent
    assert json.loads((folder / "bisect.json").read_text())["claim"] == made.claim
    assert made.claim in (folder / "bisect.md").read_text()
    assert "tool==1.5" in (folder / "good.lock.txt").read_text()
    assert "tool==1.6" in (folder / "bad.lock.txt").read_text()
    again = desk.run(*shlex.split(made.command)[1:], "--json", HARNESS_SIGNATURES="")
    assert neighbours(msgspec.json.decode(again.out, type=BisectDocument)) == ("1.5", "1.6")


def test_range_between_two_failures(desk: Desk, index: str) -> None:
    """The range of releases that works between two that fail is found; the claim has the failure at its newer end."""
    ran, made = bisected(desk, index, "window", "--axis", "tool")

    assert (ran.code, neighbours(made)) == (0, ("1.8", "1.9"))
    assert made.claim == (
        "tool 1.8 is the last that works and tool 1.9 the first that fails with AttributeError: tool 1.9 has no window"
    )
    assert any(one.startswith("only a range works: tool 1.") for one in made.told)


def test_first_guess_is_what_packages_declare(desk: Desk, index: str) -> None:
    """The minimum release that a package declares is tried before any other."""
    _, made = bisected(desk, index, "declares", "--axis", "tool")

    assert neighbours(made) == ("1.2", "1.3")
    assert [run.candidate for run in made.runs][:2] == ["1.13", "1.2"]


def test_end_without_a_lock(desk: Desk, index: str) -> None:
    """Two locks are not compared if one of them does not exist."""
    _, made = bisected(desk, index, "picky", "--axis", "tool")

    assert neighbours(made) == ("1.6", "1.8")
    assert made.moved == ()


def test_uninstallable_releases_hide_no_boundary(desk: Desk, index: str) -> None:
    """Releases that nobody can install, on either side of the boundary, do not hide it."""
    _, made = bisected(desk, index, "arm", "--axis", "tool", "--good", "1.3", "--bad", "1.8")

    assert (made.ends, neighbours(made)) == (("1.3", "1.8"), ("1.5", "1.6"))
    assert {run.candidate for run in made.runs if run.answer == "untestable"} <= {"1.4", "1.7"}


def test_day(desk: Desk, index: str) -> None:
    """The day of the upload that broke the cell is found among the days with uploads."""
    ran, made = bisected(desk, index, "arm", "--date")

    assert (ran.code, neighbours(made)) == (0, ("2026-03-06", "2026-03-07"))
    assert [(one.name, one.good, one.bad) for one in made.moved] == [("tool", "1.5", "1.6")]


def test_last_good_day(desk: Desk, index: str) -> None:
    """The last good day is the day before the breaking upload, however long the index was unchanged before."""
    _, made = bisected(desk, index, "slow", "--date")

    assert made.claim.startswith(
        "the index of 2026-03-19 is the last that works and the index of 2026-03-20 the first that fails with "
    )


def test_python(desk: Desk, index: str, host: interpreters.Interpreter) -> None:
    """The first Python that cannot import the module is that of the cell."""
    older = sorted(
        {int(one.minor.partition(".")[2]) for one in interpreters.available() if one.implementation == "cpython"}
    )
    older = [minor for minor in older if minor < int(host.minor.partition(".")[2])]
    if not older:
        pytest.skip("unavailable: an older interpreter")
    ran, made = bisected(desk, index, "new", "--python")

    assert (ran.code, neighbours(made)) == (0, (f"3.{older[-1]}", host.minor))
    assert "ImportError: this is too new" in made.claim


def test_two_causes_in_a_row(desk: Desk, index: str) -> None:
    """A different failure on the way becomes a link of the chain; with `--any` the first failure of any kind counts."""
    _, same = bisected(desk, index, "chain", "--axis", "tool")
    _, whichever = bisected(desk, index, "chain", "--axis", "tool", "--any")

    assert same.predicate
    assert whichever.predicate
    assert (same.predicate.same, whichever.predicate.same) == (True, False)
    assert neighbours(same) == ("1.2", "1.6")
    assert [(one.before, one.after) for one in same.chain] == [("1.2", "1.3"), ("1.5", "1.6")]
    assert "no such socket" in same.chain[0].becomes
    assert neighbours(whichever) == ("1.2", "1.3")


@pytest.mark.parametrize(
    ("which", "options", "status", "told"),
    [
        ("arm", ("--good", "1.8"), "refused", "the good end is bad: 1.8: single: AttributeError"),
        ("arm", ("--bad", "1.2"), "refused", "the bad end 1.2 is not bad: it works"),
        ("arm", ("--good", "1.4"), "refused", "the good end cannot be tested: 1.4"),
        ("fine", (), "refused", "is not bad: it works"),
        ("loads", (), "refused", "is not bad: it passes import, all that was requested"),
        ("hopeless", (), "no good end", "no candidate was found that works: 14 of 14 candidates were tried"),
    ],
)
def test_ends_that_do_not_hold(
    desk: Desk, index: str, which: str, options: tuple[str, ...], status: str, told: str
) -> None:
    """Ends that do not hold are refused with their results, and nothing is claimed."""
    ran, made = bisected(desk, index, which, "--axis", "tool", *options)

    assert (ran.code, made.status, made.good, made.bad) == (1, status, None, None)
    assert told in made.claim


def test_flaky_end(desk: Desk, index: str) -> None:
    """A bad release that looked good once is tried again, and found to be bad."""
    _, made = bisected(desk, index, "sometimes", "--axis", "tool", "--good", "1.5", "--bad", "1.8")

    assert neighbours(made) == ("1.5", "1.6")
    answers = [run.answer for run in made.runs if run.candidate == "1.6"]
    assert answers[0] == "good"
    assert answers.count("bad") >= 2


@pytest.mark.parametrize(
    ("options", "code", "told"),
    [
        (("--axis", "tool", "--good", "9"), 2, "--good 9: cannot be tried here"),
        (("--axis", "nobody"), 2, "'nobody'"),
        (("--axis", "paint", "--confidence", "2"), 2, "--confidence 2: name a probability between 0.5 and 1"),
        (("--date", "--good", "2019-01-01"), 2, "--good 2019-01-01: the packages did not exist yet"),
        (("--axis", "tool", "--runs", "2"), 3, "2 runs are used up"),
    ],
)
def test_bad_input_and_bounds(desk: Desk, index: str, options: tuple[str, ...], code: int, told: str) -> None:
    """Bad input and exhausted bounds are reported with what to do, without a traceback."""
    ran = desk.run("bisect", f"{written(desk, index)}/*-arm", *options, HARNESS_SIGNATURES="")

    assert ran.code == code
    assert told in ran.out + ran.err
    assert "Traceback" not in ran.err
