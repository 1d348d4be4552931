"""Remedies, bounds, expectations and figures agree with all that was measured."""

from __future__ import annotations

import importlib.util
import json
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import msgspec
import pytest
from measurements import ROOT, Measurement, everything
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness.matrix.signatures import RemedyTable, Signature
from harness.model import Phase
from harness.model.vocabulary import parsed_requirement, required_name
from harness.rootcause.repair import failure_hints
from harness.running.signatures import shipped_signatures

KNOWN = shipped_signatures.load_all()
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


ADVICE = re.compile(r"\b(?:[Ii]nstall|[Bb]uild it with) (.*)")
"""The part of an expectation's reason that tells the reader what to install."""
ENOUGH = 30
"""Expectations that advise bounds."""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A claimed cure of a failure. `bounds` are those that may not be too tight or too loose, by package.

    `whole` is whether they are all that has to hold. `reds` fail of it, and `holds` says whether the conditions, apart
    from one package, are met.
    """

    bounds: Mapping[str, tuple[SpecifierSet, ...]]
    text: str
    whole: bool
    reds: tuple[Measurement, ...]
    same_python: bool
    holds: Callable[[str, Measurement], bool]

    def within(self, name: str, seen: Measurement) -> bool:
        """Return whether the version of a package is within all bounds on it."""
        version = seen.versions.get(name)
        return version is not None and all(each.contains(version, prereleases=True) for each in self.bounds[name])

    def stated(self, name: str, version: str, *, good: bool) -> bool:
        """Return whether a bound in the text calls this version of a package good, or not good."""
        return any(bound.contains(version, prereleases=True) is good for bound in self.named(name))

    def named(self, name: str) -> list[SpecifierSet]:
        """Return the bounds on a package that the text names."""
        return [bound for each, bound in failure_hints.named_bounds(self.text) if each == name]


def of_signature(one: Signature) -> Claim:
    """Return the claim of a known failure; a line that names one release bounds nothing."""
    lines = [*one.remedy.requirements, *one.remedy.constraints, *one.remedy.overrides]
    found = {required_name(line): parsed_requirement(line).specifier for line in lines}
    open_ = {name: (it,) for name, it in found.items() if it and not all(each.operator == "==" for each in it)}

    def holds(name: str, seen: Measurement) -> bool:
        if one.python and seen.python and seen.python not in SpecifierSet(one.python):
            return False
        parts = [[parsed_requirement(text) for text in part] for part in one.packages]
        others = [part for part in parts if all(required_name(each.name) != name for each in part)]
        return all(any(_fits(each, seen) for each in part) for part in others)

    return Claim(
        bounds=open_,
        text=one.remedy.text,
        whole=len(open_) == len(lines),
        reds=tuple(red for red in everything() if red.causes[:1] == (one.id,)),
        same_python=set(one.phases) <= {Phase.RESOLVE, Phase.INSTALL},
        holds=holds,
    )


def _fits(wanted: Requirement, seen: Measurement) -> bool:
    version = seen.versions.get(required_name(wanted.name))
    return version is not None and wanted.specifier.contains(version, prereleases=True)


def of_expectations() -> Iterator[tuple[str, Claim]]:
    """Yield the advice in the reasons of expectations that a matrix still has, with its claim."""
    current = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "matrices").glob("*.toml"))
    reds: dict[str, list[Measurement]] = {}
    for seen in everything():
        advice = ADVICE.search(seen.reason)
        if advice and not seen.works and f'"{seen.reason}"' in current:
            reds.setdefault(advice[1], []).append(seen)
    for text, found in reds.items():
        named: dict[str, list[SpecifierSet]] = {}
        for name, bound in failure_hints.named_bounds(text):
            named.setdefault(name, []).append(bound)
        yield (
            text,
            Claim(
                bounds={name: tuple(each) for name, each in named.items()},
                text=text,
                whole=True,
                reds=tuple(found),
                same_python=any("Python" in red.reason for red in found),
                holds=lambda _name, _seen: True,
            ),
        )


def contradictions(claim: Claim) -> Iterator[str]:
    """Yield the measurements that speak against a claim."""
    for red in claim.reds:
        for name in claim.bounds:
            peers = [each for each in everything() if each.beside(name) == red.beside(name) and name in each.versions]
            peers = [each for each in peers if not claim.same_python or _minor(each) == _minor(red)]
            yield from _too_tight(claim, name, peers)
            if claim.whole:
                yield from _too_loose(claim, name, peers)


def failing_within(claim: Claim, *, any_of: bool) -> Iterator[str]:
    """Yield failures within the bounds, all of them or any; a text that mentions the bound explains them."""
    for red in claim.reds:
        held = [name for name in claim.bounds if claim.within(name, red)]
        enough = bool(held) if any_of else claim.whole and bool(held) and len(held) == len(claim.bounds)
        if enough and (any_of or not any(claim.named(name) for name in held)):
            yield f"{red.source} fails of it with {', '.join(f'{name} {red.versions[name]}' for name in held)}"


def _minor(seen: Measurement) -> str:
    return ".".join((seen.python or "").split(".")[:2])


def _too_tight(claim: Claim, name: str, peers: list[Measurement]) -> Iterator[str]:
    later = {each.versions[name] for each in peers if each.causes and not each.works}  # what fails behind it
    for peer in peers:
        version = peer.versions[name]
        good = peer.works or (peer.passed and version not in later)
        excluded = not any(bound.contains(version, prereleases=True) for bound in claim.bounds[name])
        if good and excluded and claim.holds(name, peer) and not claim.stated(name, version, good=True):
            yield f"{peer.source} works with {name} {version}, which is excluded"


def _too_loose(claim: Claim, name: str, peers: list[Measurement]) -> Iterator[str]:
    inside = sorted((each for each in peers if claim.within(name, each)), key=lambda each: Version(each.versions[name]))
    if not inside or not any(each.works for each in inside):
        return
    version = inside[-1].versions[name]
    newest = [each for each in inside if each.versions[name] == version]
    fails = not any(each.works for each in newest) and any(not each.passed or each.causes for each in newest)
    if fails and not claim.stated(name, version, good=False):
        yield f"{newest[-1].source} fails with {name} {version}, the newest that is allowed and was measured"


@pytest.mark.parametrize("one", [each for each in KNOWN if of_signature(each).bounds], ids=lambda one: one.id)
def test_bounds_of_known_failures(one: Signature) -> None:
    """A remedy excludes no release that was measured to work, and allows none that was measured to fail."""
    claim = of_signature(one)
    assert sorted({*contradictions(claim), *failing_within(claim, any_of=False)}) == []


def test_bounds_of_expectations() -> None:
    """The advice of an expectation excludes no release that works, and no cell that fails follows it already."""
    claims = dict(of_expectations())
    assert len(claims) >= ENOUGH
    found = {text: {*contradictions(claim), *failing_within(claim, any_of=True)} for text, claim in claims.items()}
    assert {text: sorted(told) for text, told in found.items() if told} == {}


def test_page_of_breakages() -> None:
    """Its figures and rows are those of the certificates, and what has no boundary stands apart."""
    folder = ROOT / "benchmarks"
    spec = importlib.util.spec_from_file_location("breakages", folder / "breakages.py")
    assert spec
    assert spec.loader
    breakages = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(breakages)
    listed = tomllib.loads((folder / "breakages.toml").read_text(encoding="utf-8"))["breakage"]
    lines = list(breakages.page(listed, folder))
    assert (folder / "breakages.md").read_text(encoding="utf-8") == "\n".join(lines) + "\n"
    apart = lines[lines.index("## Without a boundary") :]
    assert any("no candidate was found that works" in line for line in apart)
    assert any("is not bad" in line for line in apart)


def test_figures_of_the_documents() -> None:
    """The cells that a page counts behind a link are those of the report."""
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    counted = re.findall(r"\[(\d+) (cells|ways)\b[^\]]*\]\([./]*reports/([\w-]+)/", text)
    assert counted
    for number, what, name in counted:
        made = json.loads((ROOT / "reports" / name / "report.json").read_text(encoding="utf-8"))
        assert int(number) == len(made["cells"]), (what, name)


def test_figures_of_the_judge() -> None:
    """The counts above the table of judged diagnoses are those of its rows."""
    lines = (ROOT / "benchmarks" / "judged.md").read_text(encoding="utf-8").splitlines()
    start = lines.index(next(line for line in lines if line.startswith("| cell |"))) + 2
    rows = [[part.strip() for part in line.strip("|").split("|")] for line in lines[start:] if line.startswith("|")]
    stated = {one[0].strip("| "): one[1] for one in (line.split(" | ", 1) for line in lines[:start] if " | " in line)}
    for word, row in (("right", "cause, right"), ("wrong", "cause, wrong")):
        counted = sum(each[2] == word for each in rows)
        assert stated[row].startswith(f"{counted} of {len(rows)} "), row


def test_enough_is_measured() -> None:
    """Reports, combinations measured by hand, certificates and judges are all read."""
    sources = [one.source for one in everything()]
    assert any(source.startswith("gymnasium-mujoco/") for source in sources)
    assert any(source.startswith("measured.toml") for source in sources)
    assert any(source.startswith("py3.11_newton1.0-warp, run") for source in sources)
    assert any(source.startswith("judged-truth.toml") for source in sources)


@pytest.mark.parametrize(
    ("name", "bound", "word"),
    [
        ("newton-warp-config-verbose", "warp-lang<1.16", "excluded"),
        ("mujoco-warp-beside-other-mujoco", "mujoco<3.7", "excluded"),
        ("mujoco312-joint-type-in-tuple", "mujoco<3.10", "excluded"),
        ("mujoco312-joint-type-in-tuple", "mujoco<3.13", "fails of it"),
        ("gym-numpy124-generator-copy", "numpy<2", "fails"),
    ],
)
def test_wrong_bounds_are_found(name: str, bound: str, word: str) -> None:
    """Bounds that contradict a certificate or a report, above or below, are told."""
    one = next(each for each in KNOWN if each.id == name)
    claim = of_signature(msgspec.structs.replace(one, remedy=RemedyTable(requirements=(bound,))))
    assert any(word in text for text in (*contradictions(claim), *failing_within(claim, any_of=False)))
