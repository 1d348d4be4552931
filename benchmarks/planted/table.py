"""Hold what comparisons say against planted changes of known sizes: `python -m benchmarks.planted.table [--write]`.

Run `simmatrix run benchmarks/planted/planted-changes.toml` first: one scene of MuJoCo, one change in each case, all
stepped from one bank of states. Each case is compared with the clean one. Clean pairs are those in which nothing was
changed that arithmetic tells apart: the same scene in another process, and with every number moved by one ulp.
`--write` writes `planted.md`.
"""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from harness.machine import store, this_machine
from harness.physics.comparison import ROUND_OFF_RATIO, compare, gaps, ratios
from harness.physics.outputs import Bank, Outputs
from harness.physics.relation import Class, Comparison
from harness.probes import array_files
from harness.probes.evidence import GIVEN, OUTPUTS
from harness.probes.vault import MOST_FILE, Vault
from harness.running import behaviour_runs, open_matrix

PAGE = Path(__file__).parents[1] / "planted.md"
PICTURES = "## Pictures"
"""The heading of the last section, which `pixel_table.py` writes and this module leaves as it is."""

CLEAN = "clean"
SAME = frozenset({Class.IDENTICAL, Class.ROUND_OFF})
EXPECTED: dict[str, frozenset[Class]] = {
    "clean": frozenset({Class.IDENTICAL}),
    "ulp": frozenset({Class.ROUND_OFF}),
    "iterations": frozenset({Class.SOLVER_PRECISION, Class.CHANGED}),
    "tolerance": frozenset({Class.SOLVER_PRECISION, Class.UNDECIDED, *SAME}),
    "order": frozenset({Class.OTHER_OBSERVATION}),
    "dtype": frozenset({Class.OTHER_OBSERVATION}),
    "reward": frozenset({Class.OTHER_REWARD}),
    "ending": frozenset({Class.OTHER_TERMINATION}),
    "bounds": frozenset({Class.OTHER_INTERFACE}),
    "generator": frozenset({Class.IDENTICAL}),
    "spread": frozenset({Class.IDENTICAL}),
    "info": frozenset({Class.IDENTICAL}),
}
"""The classes that are right for a case, by the first word of its id; all others are `changed`."""

STARTS = {
    "generator": Class.RESEEDED,
    "spread": Class.OTHER_START,
    "order": Class.NOT_COMPARABLE,
    "dtype": Class.ROUND_OFF,
}
"""The class of the resets that is right, where it is not `identical`."""

POWER = 1e-9
"""The relative size from which on every planted change has to be found; below it nothing is promised."""


@dataclass(frozen=True, kw_only=True)
class Planted:
    """One planted change: its name, its relative size, what was said, and whether that is right."""

    case: str
    size: float
    comparison: Comparison
    right: bool


def load() -> tuple[Bank, dict[str, Outputs]]:
    """Return the bank of the matrix and the outputs of each case."""
    opened, plan = (
        store.open_store(),
        open_matrix.load(str(Path(__file__).parent / "planted-changes.toml"), lambda _: None, offline=True),
    )
    plan = open_matrix.set_instant(plan, opened, offline=True)
    record = opened.load_current(this_machine.facts().id, plan.cells[0])
    if record is None:
        sys.exit("run `simmatrix run benchmarks/planted/planted-changes.toml` first")
    vault = Vault(opened.folder)
    outputs = {}
    for case in record.cases:
        arrays = behaviour_runs.arrays_of(case, OUTPUTS, vault)
        if arrays is None:
            sys.exit(f"{case.case} was not measured")
        outputs[case.case] = Outputs(arrays, array_files.facts(arrays))
    given = vault.content(vault.files(record.cases[0].runs[-1])[GIVEN], MOST_FILE)
    arrays = array_files.decode(given)
    return Bank.of(arrays, array_files.facts(arrays)), outputs


def judge(bank: Bank, outputs: dict[str, Outputs]) -> Iterator[Planted]:
    """Yield each planted change with the answer."""
    for case, output in outputs.items():
        comparison = compare(outputs[CLEAN], output, bank)
        word, _, size = case.partition("-")
        number = float(size) if size[:1].isdigit() else 0.0
        expected = EXPECTED.get(word, frozenset({Class.CHANGED}))
        if number and number < POWER and word not in {"iterations", "tolerance"}:
            expected |= {Class.IDENTICAL, Class.ROUND_OFF, Class.UNDECIDED}  # below the stated power
        right = comparison.kind in expected and comparison.start is STARTS.get(word, Class.IDENTICAL)
        yield Planted(case=case, size=number, comparison=comparison, right=right)


def clean_states(bank: Bank, output: Outputs, other: Outputs) -> tuple[int, int, int, float]:
    """Return of two clean cases: compared states, those not equal to the bit, false alarms, the largest ratio."""
    compared = unequal = alarms = 0
    largest = 0.0
    for name in ("state", "observation", "reward"):  # what one ulp was planted into
        ratio = ratios(name, gaps(name, output.arrays[name], other.arrays[name], bank), bank)
        compared += len(ratio)
        unequal += int(np.sum(ratio > 0))
        alarms += int(np.sum(ratio > ROUND_OFF_RATIO))
        largest = max(largest, float(ratio.max()))
    return compared, unequal, alarms, largest


def page(bank: Bank, outputs: dict[str, Outputs], planted: list[Planted]) -> str:
    """Return the tables."""
    clean = [name for name in outputs if name.partition("-")[0] in {"clean", "ulp"}]
    pairs = [(a, b) for n, a in enumerate(clean) for b in clean[n + 1 :]]
    counts = [clean_states(bank, outputs[a], outputs[b]) for a, b in pairs]
    compared, unequal, alarms = (sum(one[n] for one in counts) for n in range(3))
    # No alarm in n comparisons bounds the rate below 3/n with 95 % confidence.
    bound = 3 / max(1, compared) if not alarms else (alarms + 2 * alarms**0.5 + 2) / max(1, compared)
    wrong = [one.case for one in planted if not one.right]
    lines = [
        "# Planted changes: what a comparison says of them",
        "",
        "Made by `simmatrix run benchmarks/planted/planted-changes.toml` and "
        f"`python -m benchmarks.planted.table --write` on {datetime.now(UTC):%Y-%m-%d}; {platform.machine()}, "
        f"Python {platform.python_version()}.",
        "",
        f"{len(planted) - len(wrong)} of {len(planted)} right"
        + (f"; wrong: {', '.join(wrong)}" if wrong else "")
        + f". Stated power: a relative change of {POWER:g} of gravity, a mass, a contact, one geometry's friction, "
        "damping, a gear, a joint limit or the reward is found.",
        "",
        f"Clean pairs: {compared} comparisons of states, {unequal} of them not equal to the bit, {alarms} false alarms "
        f"(rate below {bound:.2g} with 95 % confidence), the largest ratio of difference to noise "
        f"{max((one[3] for one in counts), default=0):.2g}.",
        "",
        "| planted | said | starts | states that differ | largest ratio to noise | first stage | right |",
        "| --- | --- | --- | --: | --: | --- | :-: |",
    ]
    for planted_change in planted:
        comparison = planted_change.comparison
        worst = max(comparison.differences, key=lambda difference: difference.ratio, default=None)
        share, ratio = (worst.share, worst.ratio) if worst else (0.0, 0.0)
        stage = comparison.stage or "-"
        if comparison.start_of_stage:
            stage += f" ({comparison.start_of_stage})"
        lines.append(
            f"| {planted_change.case} | {comparison.kind} | {comparison.start} | {share:.0%} | {ratio:.1g} | {stage} | "
            f"{'yes' if planted_change.right else 'NO'} |"
        )
    return "\n".join([*lines, ""])


def main() -> int:
    """Print the tables; return 1 if an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    args = parser.parse_args()
    bank, outputs = load()
    planted = list(judge(bank, outputs))
    text = page(bank, outputs, planted)
    print(text)
    if args.write:
        _, heading, pictures = PAGE.read_text(encoding="utf-8").partition(PICTURES)
        PAGE.write_text(f"{text}\n{heading}{pictures}" if heading else text, encoding="utf-8")
    return 0 if all(one.right for one in planted) else 1


if __name__ == "__main__":
    sys.exit(main())
