"""The plugin for sessions with a matrix: it plans before collection, then stores and reports the results."""

from __future__ import annotations

import os
import sysconfig
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from harness.judging.assess import assess
from harness.machine import this_machine
from harness.model import Cell, CellRecord, Phase, cellid, decoding
from harness.model.errors import HarnessError
from harness.reports import publishing
from harness.running.scheduler import QuietObserver, Runner
from harness.smoke import PLUGIN, SUITE, frozen, junit
from harness.smoke import items as tree
from harness.smoke.measuring import Measuring

FOLDER = Path(__file__).parent
INPUT, FACTS, RECORD = "simmatrix_plan", "simmatrix_facts", "simmatrix_record"


class Face:
    """The pytest hooks of the suite. A worker gets its plan from the controller and reads no matrix."""

    frozen: frozen.SessionPlan
    measuring: Measuring

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        self.worker = hasattr(config, "workerinput")
        self.facts: dict[str, dict[str, str]] = {}
        self.records: dict[str, CellRecord] = {}
        self.chosen: tuple[str, ...] = ()
        self.told: list[str] = []
        self.summary: list[str] = []
        config.stash[tree.SESSION] = self
        for name, meaning in tree.MARKERS.items():
            config.addinivalue_line("markers", f"{name}: simmatrix: {meaning}")

    # --- the plan ----------------------------------------------------------------------------------------------

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionstart(self) -> None:
        """Plan before workers are started. A mistake in the matrix raises pytest's UsageError."""
        sysconfig.get_config_vars()  # its first use is not safe in threads, and finding uv is one
        if self.worker:
            plan = self.config.workerinput[INPUT]  # type: ignore[attr-defined]
            self.frozen = decoding.decoder(frozen.SessionPlan).decode(plan)
            self._take_chosen()
            return
        given = self.config.getoption
        options = {name: bool(given(f"matrix_{name}")) for name in ("fresh", "offline", "verify")}
        options["listed"] = bool(given("collectonly"))
        try:
            self.frozen = frozen.freeze(given("matrix"), self.told.append, **options)
        except HarnessError as error:
            raise pytest.UsageError(str(error)) from None
        self._take_chosen()

    def _take_chosen(self) -> None:
        """Accept node ids of the suite as arguments, also those of earlier versions, though they name no file."""
        cell_ids = {name: cell.id for cell in self.frozen.cells for name in (cellid.to_old_form(cell), cell.id)}
        named = {given: given.partition("::") for given in self.config.args}
        chosen = {
            given: cell_ids[name] + sign + rest for given, (name, sign, rest) in named.items() if name in cell_ids
        }
        self.chosen = tuple(chosen.values())
        if self.chosen:
            files = [given for given in self.config.args if given not in {*chosen, SUITE}]
            # Cells lie in no file: this folder stands for all, `pytest_collection_modifyitems` keeps the named ones.
            self.config.args[:] = [*files, str(FOLDER)]

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """Hand the plan to a worker."""
        node.workerinput[INPUT] = msgspec.json.encode(self.frozen).decode()

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_make_scheduler(self, config: pytest.Config, log: Any) -> Any:
        """Return the scheduler that gives cells with one environment to one worker. None for another `--dist`."""
        if config.getoption("dist") != "loadgroup":
            return None
        from harness.smoke import distribute  # noqa: PLC0415 - xdist may be absent

        runner = Runner(self.frozen.store, self.frozen.settings(Phase.RESOLVE), QuietObserver())
        return distribute.ByEnvironment(
            config, log, self.frozen.cells, lambda cells: distribute.by_environment(runner, cells)
        )

    def pytest_report_header(self) -> list[str]:
        """Return the header lines: the number of cells of each matrix, then notes of the planning."""
        return [f"simmatrix: {plan.matrix}: {len(plan.cells)} cells" for plan in self.frozen.plans] + self.told

    # --- items -------------------------------------------------------------------------------------------------

    @pytest.hookimpl(tryfirst=True)
    def pytest_collect_directory(self, path: Path, parent: pytest.Collector) -> pytest.Collector | None:
        """Return the suite of the matrices for the folder of this package, None for any other folder."""
        ours = path.name == FOLDER.name and path.samefile(FOLDER)
        return tree.Suite.from_parent(parent, path=path) if ours else None

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """Run a user's function that asks for our fixture `cell` or `env` once for each of them."""
        if not _ours(metafunc, "cell"):
            return
        if _ours(metafunc, "env"):
            pairs = [(cell, case) for cell in self.frozen.cells for case in cell.cases]
            ids = [f"{cell.id}-{case.id}" for cell, case in pairs]
            metafunc.parametrize(("cell", "env"), pairs, ids=ids, indirect=True, scope="session")
        else:
            cells = self.frozen.cells
            metafunc.parametrize("cell", cells, ids=[cell.id for cell in cells], indirect=True, scope="session")

    def pytest_itemcollected(self, item: pytest.Item) -> None:
        """Let `-k` find functions of the user by the ids of earlier versions, too."""
        params = getattr(getattr(item, "callspec", None), "params", {})
        candidates = [value[0] if isinstance(value, tuple) else value for value in params.values() if value]
        item.extra_keyword_matches.update(cellid.to_old_form(cell) for cell in candidates if isinstance(cell, Cell))

    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        """Keep only the named items of the suite, if node ids were given."""
        if not self.chosen:
            return
        left = [item for item in items if isinstance(item, tree.OutcomeItem) and not _within(item.nodeid, self.chosen)]
        config.hook.pytest_deselected(items=left)
        gone = frozenset(left)
        items[:] = [item for item in items if item not in gone]

    @pytest.hookimpl(trylast=True)
    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Determine the wanted phases of each case before the first item runs."""
        jobs = 1 if self.worker else self.config.getoption("matrix_jobs")
        self.measuring = Measuring(self.frozen, tree.selection(session.items), worker=self.worker, jobs=jobs)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Attach the facts and the record of a cell to the report, for the controller. Correct its duration."""
        report = yield
        if call.when == "call" and isinstance(item, tree.OutcomeItem):
            report.duration = item.seconds
            if report.skipped and isinstance(report.longrepr, tuple):  # not the line of ours that said so
                report.longrepr = (str(item.reportinfo()[0]), None, report.longrepr[2])  # type: ignore[assignment]
        if call.when == "call" and isinstance(item, tree.CellItem):
            # A report takes only plain values from a worker to the controller, so the record goes as text.
            setattr(report, FACTS, {"cell": item.cell.id, **item.facts})
            setattr(report, RECORD, msgspec.json.encode(item.record).decode() if item.record else None)
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Collect the facts and records of reports, from this process and from workers."""
        facts = dict(getattr(report, FACTS, {}))
        record = getattr(report, RECORD, None)
        if self.worker or not facts:
            return
        self.facts.setdefault(facts.pop("cell"), {}).update(facts)
        if record:
            cell_record = decoding.decoder(CellRecord).decode(record)
            self.records[cell_record.cell.id] = cell_record

    # --- the end -----------------------------------------------------------------------------------------------

    @pytest.hookimpl(wrapper=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> Generator[None]:
        """Store and report the records of cells that were measured in full, and split the JUnit file by cell."""
        # pytest writes the JUnit file in this same hook, so there is nothing to split before the others have run.
        yield
        if hasattr(self, "measuring"):
            self.measuring.close()
        if self.worker or session.config.getoption("collectonly"):
            return
        if self.records:
            self._report()
        xml_option = session.config.getoption("xmlpath", None)
        xml = Path(os.path.expandvars(xml_option)).expanduser() if xml_option else None  # as pytest reads it
        if xml and self.facts and xml.is_file():
            axes = {cell.id: {f"axis.{name}": value for name, value in cell.axes.items()} for cell in self.frozen.cells}
            junit.regroup(xml, {cell: {**known, **self.facts.get(cell, {})} for cell, known in axes.items()})

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Name the verdicts and the reports."""
        for line in self.summary:
            terminalreporter.write_line(line)

    def _report(self) -> None:
        store, here = self.frozen.store, this_machine.facts()
        store.save_machine(here.id, here.facts)
        for record in self.records.values():
            store.save_cell(record)
        out = self.config.getoption("matrix_out")
        wanted = publishing.Wanted(out=Path(out) if out else None, pivot=None, json=False, fail_on=())
        reports = publishing.publish(self.frozen.plans, self.records, store, wanted)
        counts = Counter(assess(record).verdict for record in self.records.values())
        verdicts = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
        folders = ", ".join(os.path.relpath(one.folder) for one in reports)
        self.summary.append(f"simmatrix: {verdicts}; report: {folders}")
        self.summary += [f"simmatrix: the report is not written: {one.trouble}" for one in reports if one.trouble]


def _within(nodeid: str, chosen: tuple[str, ...]) -> bool:
    """Return whether a node id is one of these or lies below."""
    return any(nodeid == place or nodeid.startswith(f"{place}::") for place in chosen)


def _ours(metafunc: pytest.Metafunc, name: str) -> bool:
    """Return whether a fixture that a function asks for is ours, and not one of the user's by the same name."""
    fixtures = metafunc._arg2fixturedefs.get(name, ())  # pytest has no other way to ask
    return bool(fixtures) and fixtures[-1].func.__module__ == PLUGIN
