"""`simmatrix compare CELL CELL`: tell whether two cells behave the same, environment by environment."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import msgspec

from harness.commands import find_cell
from harness.commands.freeze import exit_code
from harness.machine import store, this_machine
from harness.model import Case, Cell
from harness.model.errors import BadInput
from harness.physics import families, sentences
from harness.physics.comparison import compare
from harness.physics.consequence import Play, consequence
from harness.physics.outputs import Outputs
from harness.physics.relation import Comparison
from harness.probes import array_files
from harness.probes.vault import Vault
from harness.reports import publishing
from harness.reports.text import progress
from harness.running import behaviour_runs, scheduler
from harness.standalone import wrapping
from harness.standalone.output import print_json

HELP = (
    "Step two cells from the same states and tell what differs first, and by how much; play the policy of a case. "
    "Exit status 1: they behave otherwise; 3: it cannot be told."
)


class ComparedEnvironment(msgspec.Struct, frozen=True, kw_only=True):
    """One environment in the document of `compare --json`.

    `state` is the state of the bank that differs most, `consequence` what the change does to the policy of the case.
    """

    env: str
    kind: str
    start: str
    stage: str | None
    state: int | None
    text: str
    frames: tuple[tuple[str, ...], tuple[str, ...]]
    consequence: str | None = None


class ComparedCells(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `compare --json`; `moved` maps each package that differs to both versions."""

    schema: int = 1
    cells: tuple[str, str]
    moved: dict[str, tuple[str | None, str | None]]
    environments: tuple[ComparedEnvironment, ...]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `compare`."""
    parser.add_argument("cells", metavar="CELL", nargs=2, help="a cell's id, or a glob that matches one")
    parser.add_argument("--env", metavar="ID", help="only this environment")
    parser.add_argument("--offline", action="store_true", help="never ask the index")
    parser.add_argument("--json", action="store_true", help="print one JSON document, and nothing else, on stdout")


def main(args: argparse.Namespace) -> int:
    """Measure both cells where that was not done before, and compare them."""
    opened = store.open_store()
    settings = scheduler.Settings(offline=args.offline)
    with progress.Progress(0, 1, publishing.headline) as board:
        first, second = (find_cell.find("compare", text, opened, offline=args.offline)[1] for text in args.cells)
        pairs = _common(first, second, args.env)
        runner = scheduler.Runner(opened, settings, board)
        installed = [runner.measure(_bare(cell)).installed or {} for cell in (first, second)]
        comparisons = [_compare(first, second, pair, opened, settings, board) for pair in pairs]
        consequences = [_play(first, second, pair, opened, settings, board) for pair in pairs]
    moved = families.moved_packages(*installed)
    compared = zip(pairs, comparisons, consequences, strict=True)
    entries = tuple(_entry(pair, found, effect, (first, second), opened) for pair, found, effect in compared)
    if args.json:
        print_json(msgspec.json.encode(ComparedCells(cells=(first.id, second.id), moved=moved, environments=entries)))
    else:
        print(f"{first.id}\n{second.id}")
        print(f"  {sentences.moves(moved) or 'the same packages'}")
        for entry in entries:
            for text in filter(None, (entry.text, entry.consequence)):
                print("\n".join(wrapping.wrap(text, wrapping.width(sys.stdout))))
            for cell, frames in zip((first, second), entry.frames, strict=True):
                print(f"  frame: {frames[0]}  ({cell.label})" if frames else f"  no frame of {cell.label}")
    codes = [exit_code(found) for found in comparisons]
    return 1 if 1 in codes else max(codes)


def _bare(cell: Cell) -> Cell:
    """Return the cell without its cases: only its packages are wanted."""
    return replace(cell, cases=())


def _common(first: Cell, second: Cell, env: str | None) -> list[tuple[Case, Case]]:
    """Return the cases of both cells that try the same environment. Raises BadInput if there is none."""
    others = {case.env: case for case in second.cases if case.env}
    pairs = [(case, others[case.env]) for case in first.cases if case.env in others and env in {None, case.env}]
    if not pairs:
        lists = "; ".join(
            f"{cell.id} has {', '.join(case.env or case.id for case in cell.cases)}" for cell in (first, second)
        )
        message = f"compare: the two cells have no environment {f'{env} ' if env else ''}in common: {lists}"
        raise BadInput(message)
    return pairs


def _compare(
    first: Cell,
    second: Cell,
    pair: tuple[Case, Case],
    opened: store.Store,
    settings: scheduler.Settings,
    board: scheduler.Observer,
) -> Comparison:
    """Step both cells from the bank of the case, or from one that the first cell makes."""
    vault, name = Vault(opened.folder), pair[0].bank
    if name is None:
        name = vault.keep(array_files.seal(behaviour_runs.make_bank(first, pair[0], opened, settings, board)))
    bank = behaviour_runs.read_bank(name, vault)
    outputs = [
        behaviour_runs.step_from(cell, case, name, opened, settings, board)
        for cell, case in zip((first, second), pair, strict=True)
    ]
    mine, theirs = (Outputs(arrays, array_files.facts(arrays)) for arrays in outputs)
    return compare(mine, theirs, bank)


def _play(
    first: Cell,
    second: Cell,
    pair: tuple[Case, Case],
    opened: store.Store,
    settings: scheduler.Settings,
    board: scheduler.Observer,
) -> str | None:
    """Play the policy of a case in both cells and say what the change does to it; None where both have not the same."""
    mine, theirs = pair
    if not mine.policy or (mine.policy, mine.seed) != (theirs.policy, theirs.seed):
        return None
    arrays = [
        behaviour_runs.play(cell, case, opened, settings, board)
        for cell, case in zip((first, second), pair, strict=True)
    ]
    before, after = (Play.of(one, array_files.facts(one)) for one in arrays)
    effect = consequence(before, after, mine.policy.get("gain"))
    return f"{mine.id}, by a policy: {sentences.describe_consequence(effect)}" if effect else None


def _entry(
    pair: tuple[Case, Case],
    comparison: Comparison,
    effect: str | None,
    cells: tuple[Cell, Cell],
    opened: store.Store,
) -> ComparedEnvironment:
    leading = sentences.leading_difference(comparison)
    return ComparedEnvironment(
        env=str(pair[0].env),
        kind=comparison.kind,
        start=comparison.start,
        stage=comparison.stage,
        state=leading.state if leading else None,
        text=f"{pair[0].env}: {sentences.describe(comparison)}",
        frames=(_frames(cells[0], pair[0], opened), _frames(cells[1], pair[1], opened)),
        consequence=effect,
    )


def _frames(cell: Cell, case: Case, opened: store.Store) -> tuple[str, ...]:
    """Return the frames that were drawn of a case when its cell was measured."""
    record = publishing.load_record(opened, this_machine.facts().id, cell)
    cases = record.cases if record else ()
    locate = publishing.seen_from_here(Path(opened.folder))
    return tuple(
        locate(frame) for one in cases if one.case == case.id for phase in one.phases for frame in phase.frames
    )
