"""Pictures of set states: what is drawn otherwise, in `compare` and in a report."""

from __future__ import annotations

from pathlib import Path

import pytest
from commandline import Desk

HEAD = """
axes = { python = ["host"], fake-lamp = ["1.0", "1.1", "2.0", "2.1", "2.2", "3.0"] }
requirements = ["gymnasium"]
index = { no_index = true, find_links = ["@WHEELS@"] }
strategy = "full"
"""
SEED = HEAD + '[[cases]]\nenv = "fake_lamp:Lamp-v0"\napi = "gymnasium"\nchecks = ["import", "single.loop"]\n'
MATRIX = SEED.replace('"single.loop"]', '"behave.pixels"]\nbank = "lamp.npz"')
ENV = "fake_lamp:Lamp-v0"


@pytest.fixture
def banked(desk: Desk) -> Desk:
    """Return a desk with a bank of states that release 1.0 made, and a matrix that draws them."""
    desk.matrix("lamp", SEED)
    frozen = desk.run("freeze", "lamp.toml/py*_fake-lamp-1.0", "--states-only", "--out", "lamp.npz")
    assert frozen.code == 0, frozen.err
    desk.matrix("lamp", MATRIX)
    return desk


def test_a_report_names_the_part_of_a_picture_that_moved_and_comes_back_from_its_evidence(banked: Desk) -> None:
    """One pixel is not seen; camera, light and colour are told apart; a picture that never repeats claims nothing."""
    ran = banked.run("run", "lamp.toml", "--out", "out", "--json")
    assert ran.code == 0, ran.err
    (pictures,) = ran.document["pictures"]
    assert (pictures["axis"], pictures["method"]) == ("fake-lamp", "states")
    assert pictures["letters"] == {ENV: ["a", "a'", "b", "c", "d", "?"]}
    boundaries = {one["after"]: one["differences"][0] for one in pictures["boundaries"]}
    assert {release: (one["kind"], one["moved"]) for release, one in boundaries.items()} == {
        "1.1": ("imperceptible", []),
        "2.0": ("changed", ["camera"]),
        "2.1": ("changed", ["camera", "lights"]),
        "2.2": ("changed", ["lights", "colours"]),
        "3.0": ("changed", ["colours"]),
    }
    page = (banked.folder / "out" / "report.md").read_text(encoding="utf-8")
    assert "| images / fake-lamp | 1.0 | 1.1 | 2.0 | 2.1 | 2.2 | 3.0 |\n" in page
    assert "- fake-lamp 1.1 to 2.0: 1 of 1 tasks look different in " in page
    before = {path.name: path.read_bytes() for path in Path(banked.folder / "out").glob("report.*")}
    for path in Path(banked.folder / "out").glob("report.*"):
        path.unlink()
    again = banked.run("report", "--judge-again", "--write", "out")
    assert again.code == 0, again.err
    assert {path.name: path.read_bytes() for path in Path(banked.folder / "out").glob("report.*")} == before


def test_compare_says_how_both_look_and_where_their_frames_lie(banked: Desk) -> None:
    """Exit status 0 where nobody sees a difference, 1 where the camera moved, 3 where the drawing does not repeat."""
    cells = {version: f"lamp.toml/py*_fake-lamp-{version}" for version in ("1.0", "1.1", "2.0", "3.0")}
    same = banked.run("compare", cells["1.0"], cells["1.1"])
    assert same.code == 0
    text = " ".join(same.out.split())
    assert f"{ENV}: is drawn with other pixels, and nobody sees the difference; with the same camera" in text
    other = banked.run("compare", cells["1.0"], cells["2.0"], "--json")
    (entry,) = other.document["environments"]
    assert (other.code, entry["kind"], entry["pixels"], entry["moved_parts"]) == (1, "identical", "changed", ["camera"])
    assert all((banked.folder / frame).is_file() for frames in entry["frames"] for frame in frames)
    assert all(entry["frames"])
    loose = banked.run("compare", cells["1.0"], cells["3.0"])
    assert (loose.code, "it does not draw the same state twice alike" in " ".join(loose.out.split())) == (3, True)


def test_compare_draws_where_no_case_asks_for_it_if_that_is_wanted(banked: Desk) -> None:
    """Without the option nothing is drawn."""
    banked.matrix("lamp", SEED)
    cells = [f"lamp.toml/py*_fake-lamp-{version}" for version in ("1.0", "2.0")]
    assert banked.run("compare", *cells).code == 0
    assert banked.run("compare", *cells, "--pixels").code == 1
