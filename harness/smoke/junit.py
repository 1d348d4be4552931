"""Split the file of `--junitxml` into one suite per cell: pytest itself writes a single one."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from harness.machine.store import write_atomic

CELL = "simmatrix.cell"
"""The property by which a test case names its cell until it stands in that cell's suite."""

COUNTED = {"failures": "failure", "errors": "error", "skipped": "skipped"}


def regroup(path: Path, properties: Mapping[str, Mapping[str, str]]) -> None:
    """Move the test cases of each cell into a suite of its own, in the order of `properties`; the rest stays."""
    root = ET.fromstring(path.read_bytes())
    for suite in list(root.iter("testsuite")):
        mine: dict[str, list[ET.Element]] = {}
        for case in suite.findall("testcase"):
            cell = _claim(case)
            if cell in properties:
                suite.remove(case)
                mine.setdefault(cell, []).append(case)
        suites = [_suite(suite, cell, properties[cell], mine[cell]) for cell in properties if cell in mine]
        place = list(root).index(suite)
        if suites and suite.find("testcase") is None:
            root.remove(suite)
        else:
            _count(suite)
        for number, cell_suite in enumerate(suites):
            root.insert(place + number, cell_suite)
    write_atomic(path, ET.tostring(root, encoding="utf-8", xml_declaration=True))


def _claim(case: ET.Element) -> str:
    """Remove and return the cell that a test case names by a property: the schema has properties for suites only."""
    for holder in case.findall("properties"):
        for element in holder.findall("property"):
            if element.get("name") == CELL:
                holder.remove(element)
                if len(holder) == 0:
                    case.remove(holder)
                return element.get("value", "")
    return ""


def _suite(source: ET.Element, name: str, properties: Mapping[str, str], cases: list[ET.Element]) -> ET.Element:
    suite = ET.Element("testsuite", {**source.attrib, "name": name})
    holder = ET.SubElement(suite, "properties")
    for key, value in properties.items():
        ET.SubElement(holder, "property", name=key, value=value)
    suite.extend(cases)
    for skipped in suite.iter("skipped"):
        skipped.text = None  # its place, which is no file, and the message once more
    _count(suite)
    return suite


def _count(suite: ET.Element) -> None:
    cases = suite.findall("testcase")
    suite.set("tests", str(len(cases)))
    for count, tag in COUNTED.items():
        suite.set(count, str(sum(case.find(tag) is not None for case in cases)))
    suite.set("time", f"{sum(float(case.get('time', 0)) for case in cases):.3f}")
