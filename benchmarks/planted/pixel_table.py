"""Hold what is said of pictures against planted changes: `python -m benchmarks.planted.pixel_table [--write]`.

Run `simmatrix run benchmarks/planted/planted-pixels.toml` first: one scene of MuJoCo, one change of its looks in each
case, drawn at the same states. Each case is compared with the clean one. `--write` writes the last section of
`planted.md`.
"""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.planted.table import PAGE, PICTURES
from harness.machine import store, this_machine
from harness.physics.pixels import Drawings, compare
from harness.physics.relation import Look, Part, PixelComparison
from harness.probes.vault import Vault
from harness.reports.pictures import stored_pictures
from harness.running import open_matrix

MATRIX = Path(__file__).parent / "planted-pixels.toml"
CLEAN = "clean"
PARTS: dict[str, tuple[Part, ...]] = {
    "pixel": (Part.DRAWING,),
    "camera": (Part.CAMERA,),
    "turn": (Part.CAMERA,),
    "lens": (Part.LENS,),
    "light": (Part.LIGHTS,),
    "lamp": (Part.LIGHTS,),
    "colour": (Part.COLOURS,),
    "texture": (Part.TEXTURES,),
    "thing": (Part.THINGS,),
    "samples": (Part.SETTINGS,),
}
"""The part that has to be named, by the first word of a case's id."""

LOOKS = {
    "clean": {Look.IDENTICAL},
    "again": {Look.IDENTICAL},
    "loose": {Look.NONDETERMINISTIC},
    "pixel": {Look.IMPERCEPTIBLE},
    "samples": {Look.CHANGED, Look.IMPERCEPTIBLE, Look.IDENTICAL},  # software that draws may have one sample anyway
}
"""The looks that are right, by the first word; all others are `changed` from their power on, and may be less below."""

POWER = {"camera": 1e-2, "lens": 1e-2}
OTHER_POWER = 1e-1
"""The relative size from which on a planted change of the looks has to be seen."""


@dataclass(frozen=True, kw_only=True)
class Planted:
    """One planted change: its name, what was said, and whether that is right."""

    case: str
    comparison: PixelComparison
    right: bool


def load() -> dict[str, Drawings]:
    """Return the drawings of each case."""
    opened, plan = store.open_store(), open_matrix.load(str(MATRIX), lambda _: None, offline=True)
    plan = open_matrix.set_instant(plan, opened, offline=True)
    record = opened.load_current(this_machine.facts().id, plan.cells[0])
    drawn = (
        {case.case: stored_pictures.of_states(case, Vault(opened.folder)) for case in record.cases} if record else {}
    )
    if not drawn or None in drawn.values():
        sys.exit("run `simmatrix run benchmarks/planted/planted-pixels.toml` first")
    return {case: drawings for case, drawings in drawn.items() if drawings}


def judge(drawings: dict[str, Drawings]) -> Iterator[Planted]:
    """Yield each planted change with the answer."""
    for case, drawn in drawings.items():
        comparison = compare(drawings[CLEAN], drawn)
        word, _, size = case.partition("-")
        below = bool(size) and float(size) < POWER.get(word, OTHER_POWER)
        looks = LOOKS.get(word, {*Look} if below else {Look.CHANGED})
        parts = {PARTS.get(word, ()), ()} if below else {PARTS.get(word, ())}
        if below and comparison.kind is Look.IMPERCEPTIBLE:
            parts.add((Part.DRAWING,))  # a camera that moved by less than rounding
        yield Planted(case=case, comparison=comparison, right=comparison.kind in looks and comparison.moved in parts)


def section(planted: list[Planted]) -> str:
    """Return the section of the page."""
    wrong = [one.case for one in planted if not one.right]
    lines = [
        PICTURES,
        "",
        "Made by `simmatrix run benchmarks/planted/planted-pixels.toml` and "
        f"`python -m benchmarks.planted.pixel_table --write` on {datetime.now(UTC):%Y-%m-%d}; {platform.machine()}, "
        f"Python {platform.python_version()}.",
        "",
        f"{len(planted) - len(wrong)} of {len(planted)} right"
        + (f"; wrong: {', '.join(wrong)}" if wrong else "")
        + f". Stated power: a relative change of {POWER['camera']:g} of a camera's place or its lens, and of "
        f"{OTHER_POWER:g} of a light, a colour, a texture or a thing, is seen, and the part is named. A single pixel "
        "is found, and not seen.",
        "",
        "| planted | pictures | part that moved | of the picture | mean distance of colours | right |",
        "| --- | --- | --- | --: | --: | :-: |",
    ]
    for planted_change in planted:
        comparison = planted_change.comparison
        moved = ", ".join(comparison.moved) or "-"
        lines.append(
            f"| {planted_change.case} | {comparison.kind} | {moved} | {comparison.share:.1%} | "
            f"{comparison.distance:.2g} | {'yes' if planted_change.right else 'NO'} |"
        )
    return "\n".join([*lines, ""])


def main() -> int:
    """Print the section; return 1 if an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    args = parser.parse_args()
    planted = list(judge(load()))
    text = section(planted)
    print(text)
    if args.write:
        before = PAGE.read_text(encoding="utf-8").partition(PICTURES)[0].rstrip()
        PAGE.write_text(f"{before}\n\n{text}", encoding="utf-8")
    return 0 if all(one.right for one in planted) else 1


if __name__ == "__main__":
    sys.exit(main())
