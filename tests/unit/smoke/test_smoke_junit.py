"""The JUnit file with one suite per cell."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from harness.smoke import junit

WRITTEN = """<?xml version="1.0" encoding="utf-8"?><testsuites name="pytest tests"><testsuite name="pytest" errors="1"
failures="1" skipped="1" tests="5" time="9.000" timestamp="2026-11-21T00:00:00+00:00" hostname="h">
<testcase classname="m.b.Ant" name="single" time="1.500"><properties><property name="simmatrix.cell" value="m/b" />
</properties><failure message="boom">boom</failure></testcase>
<testcase classname="m.a" name="resolve" time="0.250"><properties><property name="simmatrix.cell" value="m/a" />
<property name="mine" value="1" /></properties></testcase>
<testcase classname="m.a" name="install" time="0.500"><properties><property name="simmatrix.cell" value="m/a" />
</properties><skipped type="pytest.skip" message="why">m/a:None: why</skipped></testcase>
<testcase classname="test_mine" name="test_it" time="2.000"><error message="e">e</error></testcase>
<testcase classname="test_mine" name="test_more" time="2.000" /></testsuite></testsuites>"""


def regroup(tmp_path: Path, text: str, *cells: str) -> ET.Element:
    """Return the root of the file after it was regrouped by cell."""
    path = tmp_path / "j.xml"
    path.write_text(text)
    junit.regroup(path, {cell: {"axis.python": "3.11"} for cell in cells})
    return ET.parse(path).getroot()


def test_each_cell_has_a_suite_with_its_own_counts(tmp_path: Path) -> None:
    """Suites follow the plan; a cell without items has none, and items of no cell stay in pytest's suite."""
    root = regroup(tmp_path, WRITTEN, "m/a", "m/b", "m/c")

    told = [
        tuple(suite.get(key) for key in ("name", "tests", "failures", "errors", "skipped", "time")) for suite in root
    ]
    assert told == [
        ("m/a", "2", "0", "0", "1", "0.750"),
        ("m/b", "1", "1", "0", "0", "1.500"),
        ("pytest", "2", "0", "1", "0", "4.000"),
    ]
    assert [suite.get("timestamp") for suite in root] == ["2026-11-21T00:00:00+00:00"] * 3


def test_properties_stand_in_suites(tmp_path: Path) -> None:
    """Those of a test case are a user's own; ours served to find its cell."""
    root = regroup(tmp_path, WRITTEN, "m/a", "m/b")

    assert [dict(one.attrib) for one in root.findall("testsuite/properties/property")] == [
        {"name": "axis.python", "value": "3.11"}
    ] * 2
    assert [one.get("name") for one in root.findall("testsuite/testcase/properties/property")] == ["mine"]


def test_a_suite_that_lost_all_its_cases_goes(tmp_path: Path) -> None:
    """If only cells were run, pytest's own suite is left out."""
    root = regroup(tmp_path, WRITTEN.replace('classname="test_mine"', 'classname="m.a"'), "m/a", "m/b")
    assert [suite.get("name") for suite in root][-1] == "pytest"

    start = WRITTEN.index('<testcase classname="test_mine"')
    root = regroup(tmp_path, WRITTEN[:start] + "</testsuite></testsuites>", "m/a", "m/b")
    assert [suite.get("name") for suite in root] == ["m/a", "m/b"]


def test_the_text_of_a_skip_is_its_reason(tmp_path: Path) -> None:
    """An item lies in no file, so that no line of one is named."""
    (skipped,) = regroup(tmp_path, WRITTEN, "m/a").iter("skipped")

    assert (skipped.get("message"), skipped.text) == ("why", None)
