"""Measure the newest releases together: `python -m benchmarks.newest` writes `newest.md`; `nox -s newest` calls it.

For each package that a case exercises, the newest combination that the committed reports have of it is taken, and all
its requirements lose their versions: what a user gets who installs the package today. Where the resolver holds a
neighbour back, two more runs say who asks for that, and whether it has to be: with the newest release required, and
with the newest release in spite of everybody's bounds. What was measured before is not measured again on the same day.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import msgspec
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version

from harness.judging.assess import Assessed, assess
from harness.machine import store, this_machine
from harness.model import Case, Cell, CellRecord, Verdict, replace
from harness.model.errors import HarnessError
from harness.model.vocabulary import parsed_requirement
from harness.packages import index
from harness.reports import document
from harness.reports.text.markdown_texts import code_cell
from harness.reports.text.progress import Progress, headline
from harness.running import open_matrix, scheduler

PAGE = Path(__file__).parent / "newest.md"
REPORTS = PAGE.parents[1] / "reports"
NAME = "newest"
CAP = r"(?P<who>[\w.-]+)(?:\[[\w,-]*\])?(?:[=<>!~]=?[^ ]+)? depends? on {}(?P<bound>[=<>!~][^ ]*)"
HEAD = """# What is broken today

Made by `nox -s newest` on {day}: Python {python}, {machine}. Each of {count} packages that a case of a committed report
exercises was installed without any version, as of that day, and its case was run. Where the resolver held a neighbour
back, the newest release of it was required, which says who holds it back, and then installed in spite of all bounds,
which says whether the bound has to be.
"""


@dataclass(frozen=True, kw_only=True)
class Subject:
    """A package, the cell that is measured for it, and the packages whose newest releases count."""

    package: str
    cell: Cell
    neighbours: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Bound:
    """A neighbour that is held back: by whom, and what happens with its newest release all the same."""

    neighbour: str
    held: str
    newest: str
    line: str
    spite: Assessed | None

    @property
    def who(self) -> str:
        """Return who asks for an older release, with the bound; empty if the resolver does not say."""
        hit = re.search(CAP.format(re.escape(self.neighbour)), self.line)
        return f"{hit['who']} ({hit['bound'].rstrip(',')})" if hit else ""


# --- the cells -------------------------------------------------------------------------------------------------


def subjects(instant: str) -> list[Subject]:
    """Return each exercised package with the cell that has its newest release, without versions."""
    best: dict[str, tuple[tuple[Version, Version, int], Cell, Case]] = {}
    for name in sorted(path.parent.name for path in REPORTS.glob("*/report.json")):
        cells = {cell.id: cell for cell in open_matrix.load(name, lambda _: None, offline=True).cells}
        for entry in document.read_file(REPORTS / name / "report.json").cells:
            cell = cells.get(entry.id)
            if entry.verdict is not Verdict.WORKS or entry.repairs or entry.brought or cell is None or cell.base:
                continue
            cases = {case.id: case for case in cell.cases}
            for ran in entry.cases:
                for package in () if ran.exercised is msgspec.UNSET else ran.exercised:
                    if package not in (entry.installed or {}) or ran.case not in cases:
                        continue
                    rank = Version((entry.installed or {})[package]), Version(cell.python), -len(cell.cases)
                    if package not in best or best[package][0] < rank:
                        best[package] = rank, cell, cases[ran.case]
    return [_subject(package, cell, case, instant) for package, (_, cell, case) in sorted(best.items())]


def _subject(package: str, cell: Cell, case: Case, instant: str) -> Subject:
    named = [parsed_requirement(text) for text in cell.question.requirements]
    extras = {canonicalize_name(one.name): f"[{','.join(sorted(one.extras))}]" if one.extras else "" for one in named}
    requirements = tuple(f"{name}{extra}" for name, extra in {package: "", **extras}.items())
    bare = replace(cell.question, requirements=requirements, constraints=(), overrides=(), absent=(), snapshot=instant)
    bare_cell = replace(cell, id=f"{NAME}/{package}", matrix=NAME, question=bare, cases=(case,), expect=None, axes={})
    return Subject(package=package, cell=bare_cell, neighbours=tuple(dict.fromkeys((package, *extras))))


def required(subject: Subject, neighbour: str, newest: str) -> Cell:
    """Return the cell that asks for the newest release of a neighbour."""
    texts = (f"{text}=={newest}" if _key(text) == neighbour else text for text in subject.cell.question.requirements)
    question = replace(subject.cell.question, requirements=tuple(texts))
    return replace(subject.cell, id=f"{subject.cell.id}_required-{neighbour}", question=question)


def in_spite(subject: Subject, neighbour: str, newest: str) -> Cell:
    """Return the cell that has the newest release of a neighbour, whatever others ask for."""
    question = replace(subject.cell.question, overrides=(f"{neighbour}=={newest}",))
    return replace(subject.cell, id=f"{subject.cell.id}_in-spite-{neighbour}", question=question)


def _key(text: str) -> str:
    return canonicalize_name(parsed_requirement(text).name)


@cache
def newest_release(name: str, python: str) -> str | None:
    """Return the newest stable release of a package that declares to support a Python; None if none does."""
    try:
        listed = index.releases(name)
    except HarnessError:
        return None
    stable = [one for one in listed if not one.yanked and not Version(one.version).is_prerelease]
    fit = [one.version for one in stable if SpecifierSet(one.requires_python or "").contains(f"{python}.99")]
    return max(fit, key=Version, default=None)


# --- measuring -------------------------------------------------------------------------------------------------


def measure(cells: Sequence[Cell]) -> dict[str, CellRecord]:
    """Measure cells; what was measured today is not measured again."""
    settings = scheduler.Settings(jobs=scheduler.default_jobs())
    with Progress(len(cells), settings.jobs, headline) as board:
        return {record.cell.id: record for record in scheduler.run(cells, store.open_store(), settings, board)}


def bounds(subjects_at_hand: Sequence[Subject], today: Mapping[str, CellRecord]) -> dict[str, list[Bound]]:
    """Return what holds neighbours back, by package: two more runs for each."""
    held = {
        (one.package, neighbour): newest
        for one in subjects_at_hand
        for neighbour in one.neighbours
        if (version := (today[one.cell.id].installed or {}).get(neighbour))
        and (newest := newest_release(neighbour, one.cell.python))
        and Version(version) < Version(newest)
    }
    by_name = {one.package: one for one in subjects_at_hand}
    cells = {
        (key, make.__name__): make(by_name[key[0]], key[1], newest)
        for key, newest in held.items()
        for make in (required, in_spite)
    }
    records = measure(list(cells.values()))
    by_package: dict[str, list[Bound]] = {}
    for (package, neighbour), newest in held.items():
        with_it_required, all_the_same = (
            records.get(cells[(package, neighbour), make.__name__].id) for make in (required, in_spite)
        )
        by_package.setdefault(package, []).append(
            Bound(
                neighbour=neighbour,
                held=(today[by_name[package].cell.id].installed or {})[neighbour],
                newest=newest,
                line=(assess(with_it_required).decisive or "") if with_it_required else "",
                spite=assess(all_the_same) if all_the_same else None,
            )
        )
    return by_package


# --- the page --------------------------------------------------------------------------------------------------


def render(measured: Sequence[Subject], today: Mapping[str, CellRecord], held: Mapping[str, list[Bound]]) -> str:
    """Return the page."""
    machine = this_machine.facts().id
    judged = {one.package: assess(today[one.cell.id]) for one in measured}
    broken = [one for one in measured if judged[one.package].verdict is not Verdict.WORKS]
    pythons = ", ".join(sorted({one.cell.python for one in measured}))
    lines = [HEAD.format(day=store.now()[:10], python=pythons, machine=machine, count=len(measured))]
    lines += [f"{len(measured) - len(broken)} of {len(measured)} work as they install today.", ""]
    lines += [
        "## Broken as it installs today",
        "",
        "| package | beside | verdict | line |",
        "| --- | --- | --- | --- |",
    ]
    lines += [_broken_row(one, today[one.cell.id], judged[one.package]) for one in broken]
    lines += ["", "## Held back: by whom, and whether it has to be", ""]
    lines += ["| package | neighbour | gets | newest | held back by | with the newest all the same |"]
    lines += ["| --- | --- | --- | --- | --- | --- |"]
    lines += [_bound_row(package, bound) for package, bounds_ in held.items() for bound in bounds_]
    lines += ["", "## What works today", "", "| package | environment | installed |", "| --- | --- | --- |"]
    lines += [_works_row(one, today[one.cell.id]) for one in measured if one not in broken]
    return "\n".join([*lines, ""])


def _broken_row(subject: Subject, record: CellRecord, judged: Assessed) -> str:
    return f"| {subject.package} | {_versions(subject, record)} | {judged.verdict} | {_code(judged.decisive)} |"


def _bound_row(package: str, bound: Bound) -> str:
    spite = bound.spite
    if spite is None:
        what = "not measured"
    elif spite.verdict is Verdict.WORKS:
        what = "works: the bound is too narrow for this case"
    else:
        what = f"{spite.verdict}: {_code(spite.decisive)}"
    who = bound.who or _code(bound.line) or "nobody: another choice of the resolver"
    return f"| {package} | {bound.neighbour} | {bound.held} | {bound.newest} | {who} | {what} |"


def _works_row(subject: Subject, record: CellRecord) -> str:
    (case,) = subject.cell.cases
    return f"| {subject.package} | {case.env or case.id} | {_versions(subject, record)} |"


def _versions(subject: Subject, record: CellRecord) -> str:
    installed = record.installed or {}
    return ", ".join(f"{name} {installed[name]}" for name in subject.neighbours if name in installed)


def _code(text: str | None) -> str:
    return code_cell((text or "")[:160])


def main(arguments: Iterable[str] | None = None) -> None:
    """Measure, and write the page if no package was named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("package", nargs="*", help="only these; the page is printed and not written")
    chosen = parser.parse_args(list(arguments) if arguments is not None else None).package
    instant = datetime.now(UTC).strftime("%Y-%m-%dT00:00:00Z")
    measured = [one for one in subjects(instant) if not chosen or one.package in chosen]
    records = measure([one.cell for one in measured])
    page = render(measured, records, bounds(measured, records))
    if not chosen:
        PAGE.write_text(page, encoding="utf-8")
    print(page)


if __name__ == "__main__":
    main()
