"""Repaired releases from the command line, with and without the overlay."""

from __future__ import annotations

import json
import platform
from dataclasses import replace

import recipes
from commandline import Desk

HOST = f"py{platform.python_version()}"

MATRIX = """
index = { no_index = true, find_links = ["@WHEELS@"] }
cases = [{ imports = ["fake_plain"] }]

[axes]
python = ["host"]

[axes.defect]
invalid = { requirements = ["fake-metadata-invalid"] }
narrow = { requirements = ["fake-plain", "fake-too-narrow", "fake-new-python"] }

[axes.overlay.with]
overlay = ["fake-metadata-invalid", "fake-too-narrow", "fake-new-python"]

[axes.overlay.without]

[[expect]]
when = { defect = "invalid", overlay = "without" }
verdict = "uninstallable"
phase = "install"
match = "which is not part of a valid version / fake-plain \\\\(>=3"
reason = "its metadata cannot be read"

[[expect]]
when = { defect = "narrow", overlay = "without" }
verdict = "unresolvable"
phase = "resolve"
match = "fake-(too-narrow|new-python)"
reason = "it asks for a Python that nobody has"
"""


def test_the_same_cell_with_and_without(desk: Desk) -> None:
    """With the overlay the release installs and the changed lines are shown; without it, it fails as for everybody.

    Fetched, it runs where there is no index, no sdist and nothing in the cache.
    """
    desk.folder.joinpath("matrices").mkdir()
    recipes.write(desk.folder / "matrices", desk.wheels)
    matrix = desk.matrix("matrices/repaired", MATRIX)

    ran = desk.run("run", matrix, "--json", "--out", desk.folder / "report")
    cells = {cell["id"].partition("/")[2]: cell for cell in ran.document["cells"]}
    told = {name: (cell["phases"]["import"], cell["as_expected"]) for name, cell in cells.items()}

    assert {name: cell["phases"]["import"] for name, cell in cells.items()} == {
        f"{HOST}_invalid_with": "passed",
        f"{HOST}_invalid_without": "not_reached",
        f"{HOST}_narrow_with": "passed",
        f"{HOST}_narrow_without": "not_reached",
    }, ran.err
    assert told[f"{HOST}_invalid_without"] == told[f"{HOST}_narrow_without"] == ("not_reached", True)
    repair, wheel = cells[f"{HOST}_narrow_with"]["repairs"]
    assert (wheel["package"], "wheel_from_sha256" in wheel, "sdist_sha256" in wheel) == ("fake-new-python", True, False)
    assert (repair["package"], repair["version"]) == ("fake-too-narrow", "1.0")
    assert repair["edits"] == [{"field": "Requires-Python", "from": ">=3.99", "to": ">=3.9"}]
    assert repair["wheel_sha256"] == recipes.WHEELS["fake-too-narrow"]
    assert cells[f"{HOST}_narrow_without"]["repairs"] == []
    report = (desk.folder / "report" / "report.md").read_text(encoding="utf-8")
    assert "- fake-too-narrow 1.0, `Requires-Python: >=3.99` to `>=3.9`: it was made so" in report
    assert report.count(", patched |") == 2

    folder = desk.folder / "fetched"
    assert desk.run("fetch", matrix, "--to", folder).code == 0
    node = replace(desk, folder=desk.folder / "node", cache=desk.folder / "node" / "cache", wheels=desk.folder)
    node.folder.mkdir()
    again = node.run("run", "repaired", "--fetched", folder, "--json")
    assert {cell["id"].partition("/")[2]: cell["phases"]["import"] for cell in again.document["cells"]} == {
        name: cell["phases"]["import"] for name, cell in cells.items()
    }, again.err


def test_try_repairs_when_it_is_asked_to(desk: Desk) -> None:
    """`try --overlay` takes no name, a package, or the requirement itself; a name without a recipe is refused."""
    recipes.write(desk.folder / "matrices", desk.wheels)
    variables = {"PIP_FIND_LINKS": str(desk.wheels), "PIP_NO_INDEX": "1"}
    asked = ("--import", "fake_plain", "--json")

    def repaired(*arguments: str) -> list[str]:
        ran = desk.run("try", *arguments, *asked, **variables)
        (cell,) = ran.document["cells"]
        return [f"{cell['phases']['import']} {repair['package']}" for repair in cell["repairs"]]

    assert repaired("fake-metadata-invalid", "--overlay") == ["passed fake-metadata-invalid"]
    assert repaired("--overlay", "fake-metadata-invalid==1.0") == ["passed fake-metadata-invalid"]
    assert repaired("fake-metadata-invalid", "--overlay", "fake-too-narrow") == []

    refused = desk.run("try", "fake-plain", "--overlay", "fake-plane", **variables)

    assert refused.code == 2
    assert refused.err.startswith('simmatrix: --overlay: no recipe repairs "fake-plane"')
    assert "overlay" in json.loads(desk.run("schema", "--json").out)
