"""`simmatrix compare CELL CELL`: tell whether two cells behave the same, environment by environment."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import msgspec

from harness.commands import find_cell
from harness.commands.freeze import exit_code
from harness.machine import store, this_machine
from harness.model import Case, Cell, replace
from harness.model.errors import BadInput, CouldNotTell
from harness.model.vocabulary import DRAW
from harness.physics import families, pixel_sentences, pixels, sentences
from harness.physics.comparison import compare
from harness.physics.consequence import Play, consequence
from harness.physics.outputs import Outputs
from harness.physics.relation import Comparison, Look, PixelComparison
from harness.probes import array_files
from harness.probes.vault import Vault
from harness.reports import publishing
from harness.reports.pictures import stored_pictures
from harness.reports.text import progress
from harness.running import behaviour_runs, scheduler
from harness.standalone import wrapping
from harness.standalone.output import print_json

HELP = (
    "Compare how two combinations behave: step both from the same states, and name the first difference and its size."
    " Where a matrix asks for it, also compare the pictures, and the return of a policy."
)


class ComparedEnvironment(msgspec.Struct, frozen=True, kw_only=True):
    """One environment in the document of `compare --json`; `state` is the state of the bank that differs most.

    `pixels` is how both look at some of the states, None where that was not asked, `moved_parts` what makes it so.
    `consequence` is what the change does to the policy of the case.
    """

    env: str
    kind: str
    start: str
    stage: str | None
    state: int | None
    text: str
    frames: tuple[tuple[str, ...], tuple[str, ...]]
    pixels: str | None = None
    moved_parts: tuple[str, ...] = ()
    pixels_text: str = ""
    consequence: str | None = None


class ComparedCells(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `compare --json`; `moved` maps each package that differs to both versions."""

    schema: int = 1
    cells: tuple[str, str]
    moved: dict[str, tuple[str | None, str | None]]
    environments: tuple[ComparedEnvironment, ...]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `compare`."""
    parser.add_argument("cells", metavar="CELL", nargs=2, help="id of a combination, or a glob that matches one")
    parser.add_argument("--env", metavar="ID", help="only this environment, such as Ant-v5")
    parser.add_argument(
        "--pixels",
        action="store_true",
        help="also compare pictures of some states, even if the matrix does not ask for `behave.pixels`",
    )
    parser.add_argument("--offline", action="store_true", help="never ask the package index")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Measure both cells where that was not done before, and compare them."""
    opened = store.open_store()
    settings = scheduler.Settings(offline=args.offline)
    with progress.Progress(0, 1, progress.headline) as board:
        first, second = (find_cell.find("compare", text, opened, offline=args.offline)[1] for text in args.cells)
        pairs = _common(first, second, args.env)
        runner = scheduler.Runner(opened, settings, board)
        installed = [runner.measure(_bare(cell)).installed or {} for cell in (first, second)]
        measuring = _Measuring((first, second), opened, settings, board)
        comparisons, pictures, consequences = [], [], []
        for pair in pairs:
            bank = measuring.bank(pair)
            comparisons.append(measuring.compare_steps(pair, bank))
            drawn = args.pixels or all(DRAW in case.checks for case in pair)
            pictures.append(measuring.compare_pixels(pair, bank) if drawn else None)
            consequences.append(measuring.compare_plays(pair))
    moved = families.moved_packages(*installed)
    compared = zip(pairs, comparisons, pictures, consequences, strict=True)
    entries = tuple(
        _entry(pair, found, drawn, effect, (first, second), opened) for pair, found, drawn, effect in compared
    )
    if args.json:
        print_json(msgspec.json.encode(ComparedCells(cells=(first.id, second.id), moved=moved, environments=entries)))
    else:
        print(f"{first.id}\n{second.id}")
        print(f"  {sentences.moves(moved) or 'the same packages'}")
        for entry in entries:
            for text in filter(None, (entry.text, entry.pixels_text, entry.consequence)):
                print("\n".join(wrapping.wrap(text, wrapping.width(sys.stdout))))
            for cell, frames in zip((first, second), entry.frames, strict=True):
                print(f"  frame: {frames[0]}  ({cell.label})" if frames else f"  no frame of {cell.label}")
    codes = [exit_code(found) for found in comparisons] + [_pixel_code(drawn.comparison) for drawn in pictures if drawn]
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


def _pixel_code(comparison: PixelComparison) -> int:
    """Return 0 where both look the same, 1 where they do not, 3 where that cannot be told."""
    if comparison.looks_same:
        return 0
    return 1 if comparison.kind in {Look.CHANGED, Look.OTHER_SIZE} else CouldNotTell.exit_code


@dataclass(frozen=True)
class _Pictures:
    """The comparison of the pictures of two cells, and the paths of the frames of each."""

    comparison: PixelComparison
    frames: tuple[tuple[str, ...], tuple[str, ...]]


@dataclass(frozen=True)
class _Measuring:
    """Measures two cells where that was not done before."""

    cells: tuple[Cell, Cell]
    opened: store.Store
    settings: scheduler.Settings
    board: scheduler.Observer

    def bank(self, pair: tuple[Case, Case]) -> str:
        """Return the bank of the case, or one that the first cell makes."""
        name = pair[0].bank
        if name is None:
            new_bank = behaviour_runs.make_bank(self.cells[0], pair[0], self.opened, self.settings, self.board)
            name = Vault(self.opened.folder).keep(array_files.seal(new_bank))
        return name

    def compare_steps(self, pair: tuple[Case, Case], bank: str) -> Comparison:
        """Step both cells from a bank."""
        outputs = [
            behaviour_runs.step_from(cell, case, bank, self.opened, self.settings, self.board)
            for cell, case in zip(self.cells, pair, strict=True)
        ]
        mine, theirs = (Outputs(arrays, array_files.facts(arrays)) for arrays in outputs)
        return compare(mine, theirs, behaviour_runs.read_bank(bank, Vault(self.opened.folder)))

    def compare_pixels(self, pair: tuple[Case, Case], bank: str) -> _Pictures:
        """Draw some states of a bank in both cells."""
        (mine, my_frames), (theirs, their_frames) = (
            behaviour_runs.draw_states(cell, case, bank, self.opened, self.settings, self.board)
            for cell, case in zip(self.cells, pair, strict=True)
        )
        drawings = stored_pictures.read_states(mine, bank), stored_pictures.read_states(theirs, bank)
        return _Pictures(pixels.compare(*drawings), (my_frames, their_frames))

    def compare_plays(self, pair: tuple[Case, Case]) -> str | None:
        """Play the policy of a case in both cells and say what the change does to it; None where they have not one."""
        mine, theirs = pair
        if not mine.policy or (mine.policy, mine.seed) != (theirs.policy, theirs.seed):
            return None
        arrays = [
            behaviour_runs.play(cell, case, self.opened, self.settings, self.board)
            for cell, case in zip(self.cells, pair, strict=True)
        ]
        before, after = (Play.of(one, array_files.facts(one)) for one in arrays)
        effect = consequence(before, after, mine.policy.get("gain"))
        return f"{mine.id}, by a policy: {sentences.describe_consequence(effect)}" if effect else None


def _entry(
    pair: tuple[Case, Case],
    comparison: Comparison,
    drawn: _Pictures | None,
    effect: str | None,
    cells: tuple[Cell, Cell],
    opened: store.Store,
) -> ComparedEnvironment:
    leading = sentences.leading_difference(comparison)
    entry = ComparedEnvironment(
        env=str(pair[0].env),
        kind=comparison.kind,
        start=comparison.start,
        stage=comparison.stage,
        state=leading.state if leading else None,
        text=f"{pair[0].env}: {sentences.describe(comparison)}",
        frames=(_frames(cells[0], pair[0], opened), _frames(cells[1], pair[1], opened)),
        consequence=effect,
    )
    if drawn is None:
        return entry
    locate = publishing.seen_from_here(Path(opened.folder))
    first, second = (tuple(map(locate, frames)) for frames in drawn.frames)
    return msgspec.structs.replace(
        entry,
        frames=(first, second),
        pixels=drawn.comparison.kind,
        moved_parts=tuple(drawn.comparison.moved),
        pixels_text=f"{pair[0].env}: {pixel_sentences.describe(drawn.comparison)}",
    )


def _frames(cell: Cell, case: Case, opened: store.Store) -> tuple[str, ...]:
    """Return the frames that were drawn of a case when its cell was measured."""
    record = opened.load_current(this_machine.facts().id, cell)
    cases = record.cases if record else ()
    locate = publishing.seen_from_here(Path(opened.folder))
    return tuple(
        locate(frame) for one in cases if one.case == case.id for phase in one.phases for frame in phase.frames
    )
