"""Write the page of a cell: cause and fix first, then the proof, then all that was measured."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from typing import Any

from packaging.version import InvalidVersion

from harness.judging.known_failures import select_counting
from harness.model import Verdict
from harness.model.report_types import CaseEntry, CellEntry
from harness.reports.answers import recommending
from harness.reports.answers.measured_cells import CellResult
from harness.reports.install_texts import environment_files, install_commands
from harness.reports.site import addresses, evidence_files, excuses
from harness.reports.site.evidence_files import EvidenceFiles, SiteFile
from harness.reports.site.excuses import Nearest
from harness.reports.site.page_writer import PageWriter
from harness.reports.site.site_facts import SiteFacts
from harness.reports.site.site_sources import Source
from harness.reports.tables import tables
from harness.reports.tables.family_tables import FamilyTable
from harness.reports.text import progress
from harness.running import lock_files
from harness.standalone.failures.remedies import in_words


class CellPages:
    """Writes the pages of cells."""

    def __init__(self, facts: SiteFacts, writer: PageWriter, files: EvidenceFiles) -> None:
        self._facts, self._writer, self._files = facts, writer, files

    def write(self) -> None:
        """Write a page for each cell of each report."""
        for cell_id, held in progress.count_off(list(self._facts.entries.items()), "page"):
            source, first = held[0]
            self._writer.write(
                addresses.cell_page(cell_id, first.matrix),
                "cell.html.j2",
                id=cell_id,
                label=first.label,
                matrix=first.matrix,
                matrix_address=addresses.matrix_page(first.matrix),
                report=source.name,
                results=[self._result(source, entry) for source, entry in held],
                commands=_commands(first, whole=source.folder is not None),
            )

    def _result(self, source: Source, entry: CellEntry) -> dict[str, Any]:
        """Return all that the page shows of one result, on one machine."""
        facts = self._facts
        near = self._nearest(source, entry)
        row = facts.rows.get(entry.id)
        result = facts.results.get((entry.id, entry.machine))
        lock = self._files.copy(source, entry.lock) if entry.lock else None
        logs = list(self._logs(source, entry))
        cases = [self._case(source, case, near) for case in entry.cases]
        files = [*logs, *([lock] if lock else []), *(file for case in cases for file in case["files"])]
        return {
            "entry": entry,
            "row": row,
            "causes": list(self._causes(entry)),
            "excuses": [(each, facts.cell_link(each.proof) if each.proof else None) for each in
                        excuses.excuses(entry, near, facts.signatures)],
            "near": near,
            "near_link": facts.cell_link(near.cell.id) if near else None,
            "installed": _installed(entry, near),
            "cases": cases,
            "families": list(self._families(source, entry)),
            "logs": logs,
            "tail": next((tail for file in logs if file.name.endswith((".txt", ".log"))
                          if (tail := self._files.tail(file))), ""),
            "lock": lock,
            "formats": list(self._formats(result)) if result else [],
            "missing": [*evidence_files.list_missing(files), *_left_behind(source, entry)],
            "environment_address": facts.environment_address,
            "package_address": facts.package_address,
        }  # fmt: skip

    def _causes(self, entry: CellEntry) -> Iterator[dict[str, Any]]:
        """Yield the known issues that count in a cell, the deepest cause first."""
        facts = self._facts
        for diagnosis in select_counting(entry):
            yield {
                "id": diagnosis.signature,
                "cause": diagnosis.cause,
                "fix": in_words(diagnosis.remedy),
                "seen": diagnosis.seen,
                "proof": facts.cell_link(diagnosis.proof) if diagnosis.proof else None,
                "references": diagnosis.references,
                "address": facts.issue_address(diagnosis.signature),
            }

    def _nearest(self, source: Source, entry: CellEntry) -> Nearest | None:
        """Return the nearest cell of the same report that works; None for a cell that works itself."""
        if entry.verdict is Verdict.WORKS:
            return None
        return excuses.nearest(entry, (one for one in source.document.cells if one.matrix == entry.matrix))

    def _case(self, source: Source, case: CaseEntry, near: Nearest | None) -> dict[str, Any]:
        """Return an environment with its pictures; one that misleads gets the right ones beside its own."""
        frames = [self._files.copy(source, frame) for frame in case.frames]
        right: list[SiteFile] = []
        if case.misleads and near:
            twin = next((one for one in near.cell.cases if one.case == case.case), None)
            right = [self._files.copy(source, frame) for frame in (twin.frames if twin else ())]
        return {
            "case": case,
            "frames": frames,
            "right": right,
            "files": [*frames, *right],
            "drawn": tables.context(case) if case.drawn else "",
        }

    def _logs(self, source: Source, entry: CellEntry) -> Iterator[SiteFile]:
        """Yield the logs of a cell, each once."""
        places = [entry.evidence, *(path for case in entry.cases for path in case.evidence.values())]
        places += [entry.suite.evidence] if entry.suite else []
        for place in dict.fromkeys(filter(None, places)):
            yield from self._files.copy_folder(source, place)

    def _families(self, source: Source, entry: CellEntry) -> Iterator[dict[str, Any]]:
        """Yield each comparison over releases that this cell is a part of: its plot, and the letters of its tasks."""
        envs = {case.env or case.case for case in entry.cases if case.behaviour}
        sheet = next(sheet for sheet in source.report.sheets if sheet.matrix == entry.matrix)
        for table in sheet.families if envs else ():
            rest = ", ".join(f"{name} {value}" for name, value in sorted(entry.axes.items()) if name != table.axis)
            if rest != table.where or entry.axes[table.axis] not in table.releases:
                continue
            rows = [(self._facts.environment_links(names), letters) for names, letters in table.rows]
            yield {
                "table": table,
                "here": _column(table, entry.axes[table.axis]),
                "rows": [(links, letters) for links, letters in rows if envs & {name for _, name, _ in links}],
                "plot": self._files.plot(source, table),
            }

    def _formats(self, result: CellResult) -> Iterator[tuple[str, str]]:
        """Yield the versions of a cell as each tool takes them."""
        if not result.pins:
            return
        try:
            combination = recommending.combination(result.chosen, [result])
        except InvalidVersion:
            return
        header = lock_files.header(
            lock_files.MeasuredLock(
                lock=combination.lock,
                cell=combination.cell,
                python=combination.python,
                machine=combination.machine,
                measured=combination.measured,
                settings=install_commands.variables(combination),
            )
        )
        yield "pip", install_commands.command(combination)
        yield "uv", install_commands.command(combination, install_commands.UV)
        if not (combination.brought or combination.repaired):
            system = str(self._facts.measured.machines.get(combination.machine, {}).get("os", ""))
            yield "environment.yml", environment_files.conda(combination, header)
            yield "pyproject.toml", environment_files.pyproject(combination, header)
            yield "Dockerfile", environment_files.dockerfile(combination, header, system)


def _column(table: FamilyTable, release: str) -> int:
    """Return the column of a release: the last range that does not begin after it."""
    starts = [table.releases.index(column.partition(" to ")[0]) for column in table.columns]
    return sum(start <= table.releases.index(release) for start in starts) - 1


def _left_behind(source: Source, entry: CellEntry) -> Iterator[str]:
    """Yield a sentence where a report came without the evidence of a cell."""
    if entry.measured and entry.verdict not in {Verdict.UNAVAILABLE, Verdict.NOT_RUN} and not _has_files(entry):
        yield "This report came without locks, logs and pictures."


def _has_files(entry: CellEntry) -> bool:
    return any((entry.lock, entry.evidence, *(case.evidence for case in entry.cases)))


def _installed(entry: CellEntry, near: Nearest | None) -> list[tuple[str, str, str | None]]:
    """Return the packages with their versions here, and there where they differ; those that differ come first."""
    differs = near.differs if near else {}
    here = entry.installed or {}
    names = {name for name in differs if name in here or (near and name in (near.cell.installed or {}))}
    moved = [(name, here.get(name, "absent"), differs[name][1] or "absent") for name in sorted(names)]
    return [*moved, *((name, version, None) for name, version in sorted(here.items()) if name not in names)]


def _commands(entry: CellEntry, *, whole: bool) -> list[str]:
    """Return the command that measures a cell again, then the one that shows it on a terminal."""
    if whole:
        again = ["simmatrix", "run", entry.matrix, "-k", entry.label, "--fresh"]
    else:
        envs = [word for case in entry.cases if case.env for word in ("--env", case.env)]
        again = ["simmatrix", "try", *entry.requirements, "--python", entry.requested_python, *envs]
    return [shlex.join(again), shlex.join(["simmatrix", "show", entry.id])]
