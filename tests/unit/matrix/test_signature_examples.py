"""The signatures that come with the harness: each knows its own texts, no other's, and nothing of green cells."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness.matrix import signatures
from harness.matrix.signatures import Signature
from harness.model import Verdict
from harness.model.report_types import CellEntry
from harness.model.vocabulary import parsed_requirement
from harness.reports import document
from harness.running.signatures import shipped_signatures, signature_files
from harness.standalone.failures import matching, ties
from harness.standalone.failures.matching import Around, Evidence, diagnose

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "matrices" / signature_files.FOLDER
KNOWN = signatures.read({path.name: path.read_text(encoding="utf-8") for path in sorted(FOLDER.glob("*.toml"))})
ENOUGH = 30
"""Green cells whose texts no signature may know."""


def around(one: Signature) -> Around:
    """Return surroundings in which only the packages that a signature needs are installed."""
    wanted = [parsed_requirement(part[0]) for part in one.packages]
    return Around(installed={each.name: version(each.specifier) for each in wanted})


def version(fitting: SpecifierSet) -> str:
    """Return a version that fits: a bound itself, or one just before or after a bound."""
    bounds = [Version(each.version.removesuffix(".*")) for each in fitting]
    near = [*map(str, bounds), *(f"{bound}.1" for bound in bounds), *(f"{bound}.dev0" for bound in bounds), "1"]
    return next(each for each in near if fitting.contains(each, prereleases=True))


def test_versions_are_found() -> None:
    """A fitting version is found for every kind of bound."""
    for text in ("", "<2", ">1.5", ">=1,<1.1", "==0.21.0", "==1.4.*", ">=0.24,!=0.24,<0.27"):
        assert SpecifierSet(text).contains(version(SpecifierSet(text)), prereleases=True)


def named(one: Signature, text: str) -> list[tuple[str, bool]]:
    """Return the id of each signature that fits a text, and whether it is a mask; `one` has its packages installed."""
    seen = Evidence(phase=None, reasons=(text,), signal=one.signal)
    return [(each.signature.id, each.signature.masks) for each in diagnose(KNOWN, [seen], around(one))]


@pytest.mark.parametrize("one", KNOWN, ids=lambda one: one.id)
class TestSignature:
    """One signature that comes with the harness."""

    def test_knows_its_own_texts(self, one: Signature) -> None:
        """Each of its examples, and goes before all others that see something there; of a mask those are masks."""
        for text in one.examples:
            assert one.wording is None or matching.compile_once(one.wording).search(text), text
            found = named(one, text)
            if one.masks:
                assert (one.id, True) in found
                assert [name for name, masks in found if not masks] == [], text
            else:
                assert found[0] == (one.id, False), (text, found)
                assert [name for name, masks in found[1:] if not masks and not _broad(name)] == [], text

    def test_each_common_line_has_a_decision(self, one: Signature) -> None:
        """Each line that its pattern finds names its packages, or `ties` says what is enough to name the cause."""
        if one.pattern is None or one.silent or one.ties:
            return
        matches = [matching.compile_once(one.pattern).search(text) for text in one.examples]
        lines = [match.group(0) for match in matches if match]
        assert one.packages
        assert [line for line in lines if not ties.mentions_packages(one, line)] == []

    def test_examples_differ(self, one: Signature) -> None:
        """Two of one text would prove no more than one."""
        assert len(set(one.examples)) == len(one.examples)

    def test_every_signature_has_a_source(self, one: Signature) -> None:
        """Somebody met it: there is a reference, or it was reproduced here."""
        assert one.references or one.verified_on


def _broad(name: str) -> bool:
    return next(one.generic or not one.phases for one in KNOWN if one.id == name)


def green() -> Iterator[tuple[Path, CellEntry]]:
    """Yield cells of committed reports that work, with the folder of their report."""
    for path in sorted((ROOT / "reports").glob("*/report.json")):
        read = document.read(path.read_bytes(), str(path))
        yield from ((path.parent, cell) for cell in read.cells if cell.verdict is Verdict.WORKS)


def texts(folder: Path, cell: CellEntry) -> tuple[str, ...]:
    """Return all texts kept of a green cell: its findings, reasons and log."""
    said = [found.text for found in cell.findings]
    said += [line for case in cell.cases for line in (*case.reasons.values(), *case.masked.values())]
    kept = shipped_signatures.texts(folder / cell.evidence) if cell.evidence else {}
    return (*said, *(text for name, text in kept.items() if not name.endswith(".jsonl")))


UNASKED = {"metaworld3-reset-does-not-reseed", "myosuite2-reset-ignores-seed"}
"""Known issues that working cells show: nothing fails by them unless a case requires otherwise."""


def test_green_cells_have_no_known_failure() -> None:
    """No signature fits a working cell with its installed packages, in any phase."""
    cells = list(green())
    assert len(cells) >= ENOUGH
    for folder, cell in cells:
        seen = Evidence(phase=None, reasons=texts(folder, cell))
        found = diagnose(KNOWN, [seen], Around(installed=cell.installed, python=cell.python))
        assert [(each.signature.id, each.seen) for each in found if each.signature.id not in UNASKED] == [], cell.id
