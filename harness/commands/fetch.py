"""`simmatrix fetch MATRIX --to DIR`: collect all that a matrix needs in a folder, for machines without network."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import msgspec

from harness.commands import arguments
from harness.commands.lock import headline
from harness.commands.select_cells import committed_report, durations, select
from harness.machine import store
from harness.machine.console import tell
from harness.machine.files.file_locks import exclusive
from harness.model import Cell, CellRecord, Phase, Plan, replace
from harness.model.errors import BadInput
from harness.model.report_types import format_count
from harness.reports.text import progress
from harness.running import controls, open_matrix, scheduler
from harness.running.offline import offline_bundle, offline_collect
from harness.running.offline.offline_bundle import FetchedCell, FetchedMatrix, Manifest
from harness.standalone.output import print_json

HELP = (
    "Download everything that a matrix needs into a folder: locks, wheels, builds and Pythons. Then `simmatrix run"
    " MATRIX --fetched DIR` needs no network. An interrupted download continues where it stopped."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `fetch`."""
    arguments.matrix(parser)
    parser.add_argument(
        "--to", type=Path, metavar="DIR", required=True, help="the folder; it is created if it does not exist"
    )
    parser.add_argument("-k", metavar="GLOB", help="only combinations whose id matches")
    arguments.jobs(parser)
    parser.add_argument("--json", action="store_true", help="print the manifest as JSON on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Fetch all cells. Return 0 if each has its files, or the reason why it has no lock; else 3."""
    planned = open_matrix.load(args.matrix, tell)
    if any(cell.subject for cell in select(planned.cells, args.k)):
        hint = "build its wheel and name that as a requirement"
        message = f"{args.matrix}: fetch does not bring a package under test; {hint}"
        raise BadInput(message)
    opened = store.open_store()
    folder = store.writable(args.to).absolute()
    with exclusive(folder / ".fetch.lock"):
        earlier = _earlier(folder, args.matrix, planned.matrix)
        plan = _dated(planned, earlier, opened)
        cells = select(plan.cells, args.k)
        with progress.Progress(len(cells), args.jobs, headline) as board:
            settings = scheduler.Settings(jobs=args.jobs, until=Phase.RESOLVE)
            # Cells are only resolved here, so this machine need not have what they need to run.
            records = scheduler.run([replace(cell, needs=(), system=()) for cell in cells], opened, settings, board)
        beside = scheduler.run(_controls(records, opened), opened, settings, scheduler.QuietObserver(board))
        bringing = offline_collect.Collector(folder, opened, tell)
        fetched_cells, known_good = bringing.cells(records), bringing.cells(beside)
        manifest = _manifest(bringing, args.matrix, plan, earlier, (*fetched_cells, *known_good))
        offline_collect.write(folder, manifest)
    _tell_pythons(manifest, fetched_cells)
    for control in known_good:
        if control.lock is None:
            tell(f"{control.id}: not fetched, and so cannot be run when a cell fails: {control.decisive}")
    if args.json:
        print_json((folder / offline_bundle.MANIFEST).read_bytes())
    else:
        _summary(fetched_cells, folder, bringing.brought)
    return 0 if all(cell.complete for cell in fetched_cells) else 3


def _controls(records: Sequence[CellRecord], opened: store.Store) -> tuple[Cell, ...]:
    """Return the controls that have to run if one of these cells fails."""
    locked = ((one.cell, (opened.folder / one.lock).read_text(encoding="utf-8")) for one in records if one.lock)
    possible = (control for cell, lock in locked for control in controls.possible(cell, lock))
    return tuple({control.id: control for control in possible}.values())


def _earlier(folder: Path, name: str, matrix: str) -> Manifest | None:
    """Return the manifest of earlier fetches, without this matrix if it has changed since. None if there is none."""
    old = offline_collect.load_intact(folder)
    mine = next((one for one in old.matrices if one.name == matrix), None) if old else None
    if old is None or mine is None:
        return old
    now = {f"matrices/{matrix}/{inner}": path for inner, path in open_matrix.files(name).items()}
    if now.keys() == {mine.file, *mine.beside} and all(
        store.sha256_of(path) == old.files[file].sha256 for file, path in now.items()
    ):
        return old
    tell(f"{name}: was changed since it was fetched; its cells are fetched again")
    manifest = msgspec.structs.replace(
        old,
        matrices=tuple(one for one in old.matrices if one is not mine),
        cells=tuple(one for one in old.cells if one.matrix != matrix),
        files={file: known for file, known in old.files.items() if file not in {mine.file, *mine.beside}},
    )
    # Written at once: a fetch that is killed later must not leave a manifest of the matrix as it was.
    offline_collect.write(folder, manifest)
    return manifest


def _dated(planned: Plan, earlier: Manifest | None, opened: store.Store) -> Plan:
    """Return the plan as of the instant of the earlier fetch, if any: all its cells in the folder share one instant."""
    instants = {one.name: one.instant for one in earlier.matrices} if earlier else {}
    instant = instants.get(planned.matrix)
    return open_matrix.as_of(planned, instant) if instant else open_matrix.set_instant(planned, opened)


def _manifest(
    bringing: offline_collect.Collector,
    name: str,
    plan: Plan,
    earlier: Manifest | None,
    fetched_cells: Sequence[FetchedCell],
) -> Manifest:
    mine = bringing.files(plan.matrix, open_matrix.files(name), plan.cells[0].question.snapshot)
    # The machine without network balances its shards by these seconds.
    report = committed_report(open_matrix.locate(name), plan.matrix)
    mine = msgspec.structs.replace(mine, seconds=durations([report] if report else []))
    before: tuple[FetchedMatrix, ...] = earlier.matrices if earlier else ()
    matrices = {one.name: one for one in (*before, mine)}
    cells = {one.id: one for one in (*(earlier.cells if earlier else ()), *fetched_cells)}
    return Manifest(
        made=store.now(),
        harness=version("simmatrix"),
        architecture=os.uname().machine,
        matrices=tuple(matrices[key] for key in sorted(matrices)),
        cells=tuple(cells[key] for key in sorted(cells)),
        pythons=bringing.pythons(cells.values()),
        files=earlier.files if earlier else {},
    )


def _tell_pythons(manifest: Manifest, fetched_cells: Sequence[FetchedCell]) -> None:
    """Say which Pythons the other machine has to have."""
    needed = {(cell.implementation, cell.python) for cell in fetched_cells}
    for python in manifest.pythons:
        if python.file is None and (python.implementation, python.version) in needed:
            tell(f"{python.implementation} {python.version} must exist where this is run: it {python.note}")


def _summary(fetched_cells: Sequence[FetchedCell], folder: Path, brought: int) -> None:
    for cell in fetched_cells:
        if cell.lock is None:
            what = "no lock" if cell.complete else "not fetched"
            print(f"{cell.id}  {what}: {cell.decisive}")
    locked = [cell for cell in fetched_cells if cell.lock]
    wheels = {name for cell in fetched_cells for name in cell.wheels}
    counted = (
        f"{format_count(len(fetched_cells), 'cell')}, {len(locked)} with a lock; {format_count(len(wheels), 'wheel')}"
    )
    print(f"{counted}; {brought / 1e6:.1f} MB downloaded into {os.path.relpath(folder)}")
    print(f"without network: simmatrix run {fetched_cells[0].matrix} --fetched {os.path.relpath(folder)}")
