"""Judge diagnoses and repairs: `python benchmarks/judged.py run|repair|score` on the cells of `judged.toml`.

`run` measures the combinations, `repair` repairs red ones, in an order drawn once, for as many minutes as it is given,
and `score` holds both against `judged-truth.toml` and writes `judged.md`. What was done before is not done again;
`--folder` is where results lie.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import random
import statistics
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic
from typing import Any

HERE = Path(__file__).parent
MATRIX = HERE / "judged.toml"
TRUTH = HERE / "judged-truth.toml"
RED = {"unresolvable", "uninstallable", "import_fails", "broken", "partial"}
SEED = 6
MINUTES_EACH = 6


@dataclass(frozen=True)
class Judged:
    """One failing combination: the truth about it, and the diagnoses and the repair that we gave."""

    label: str
    truth: Mapping[str, Any]
    cell: Mapping[str, Any]
    proof: Mapping[str, Any] | None
    log: Mapping[str, Any] | None

    @property
    def phase(self) -> str | None:
        """Return the first phase that failed."""
        return next((phase for phase in PHASES if self.cell["phases"].get(phase) in FAILED), None)

    @property
    def named(self) -> str | None:
        """Return the cause that was named first: a mask only where nothing else was."""
        return first(self.cell["diagnoses"])

    @property
    def cause(self) -> str:
        """Return the grade of the cell's diagnosis, see `held`."""
        return self.held(self.cell)

    @property
    def explained(self) -> str | None:
        """Return the grade of the diagnosis by the log alone, see `held`; None if there is no log."""
        return self.held(self.log) if self.log else None

    @property
    def cured(self) -> bool:
        """Return whether a remedy was proven that leaves the versions that were asked for."""
        return bool(self.proof) and self.proof["status"] == "found" and not self.proof["remedy"]["moved"]

    def held(self, document: Mapping[str, Any]) -> str:
        """Grade the diagnosis in a document: `right`, `wrong`, `unknown`, or `unknown, another line`.

        The last two name no cause. With `unknown` the decisive line is the right one.
        """
        named = first(document["diagnoses"])
        if named:
            return "right" if named in self.truth["named"] else "wrong"
        return "unknown" if self.truth["line"] in (document["decisive"] or "") else "unknown, another line"


def first(diagnoses: Sequence[Mapping[str, Any]]) -> str | None:
    """Return the cause that is named first: a mask only where nothing else is."""
    return next(
        (one["signature"] for one in diagnoses if not one["masks"]), diagnoses[0]["signature"] if diagnoses else None
    )


PHASES = ("resolve", "install", "import", "single", "vector", "render")
FAILED = {"failed", "crashed", "timed_out", "flaky"}


def main() -> None:
    """Do one of the three steps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("step", choices=["run", "repair", "score"])
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=60, help="of `repair` in all")
    args = parser.parse_args()
    {"run": run, "repair": repair, "score": score}[args.step](args.folder.resolve(), args.minutes)


def simmatrix(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command of ours with the results of this folder."""
    environment = {**os.environ, "HARNESS_STATE": str(folder / "state")}
    command = [sys.executable, "-m", "harness", *arguments]
    return subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=False)


def run(folder: Path, _: float) -> None:
    """Measure all cells; those measured before are judged again by the signatures of today."""
    simmatrix(folder, "run", str(MATRIX), "-j", "1", "--out", str(folder / "report"))


def repair(folder: Path, minutes: float) -> None:
    """Repair red cells in the drawn order until the time is over, those first of which a remedy is known."""
    began = monotonic()
    so = truths()
    for label in sorted(drawn(cells(folder)), key=lambda label: not so[label]["curable"]):
        if so[label].get("heavy"):
            continue
        path = folder / "repairs" / f"{label}.json"
        if path.exists():
            continue
        if monotonic() - began > minutes * 60:
            break
        process = simmatrix(folder, "repair", f"{MATRIX}/{label}", "--minutes", str(MINUTES_EACH), "--json")
        if process.stdout.strip():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(process.stdout, encoding="utf-8")


def drawn(cells_by_label: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the red cells in an order that says nothing about them."""
    labels = sorted(label for label, cell in cells_by_label.items() if cell["verdict"] in RED)
    random.Random(SEED).shuffle(labels)
    return labels


def cells(folder: Path) -> dict[str, Mapping[str, Any]]:
    """Return the measured cells by label."""
    read = json.loads((folder / "report" / "report.json").read_text(encoding="utf-8"))
    return {cell["id"].partition("/")[2]: cell for cell in read["cells"]}


# --- the score -------------------------------------------------------------------------------------------------


def score(folder: Path, _: float) -> None:
    """Compare diagnoses and repairs with the truth, print the result and write `judged.md`."""
    cells_by_label = cells(folder)
    so = truths()
    if missing := [label for label in drawn(cells_by_label) if label not in so]:
        sys.exit(f"{TRUTH.name}: nothing is said of {', '.join(missing)}")
    judged = [
        Judged(
            label=label,
            truth=so[label],
            cell=cells_by_label[label],
            proof=proof(folder, label),
            log=log(folder, cells_by_label[label]),
        )
        for label in sorted(drawn(cells_by_label))
        for cell in [cells_by_label[label]]
    ]
    text = "\n".join(page(judged, cells_by_label))
    (HERE / "judged.md").write_text(text + "\n", encoding="utf-8")
    print(text)


def truths() -> dict[str, Mapping[str, Any]]:
    """Return the truths of `judged-truth.toml` by label."""
    return {one["cell"]: one for one in tomllib.loads(TRUTH.read_text(encoding="utf-8"))["truth"]}


def proof(folder: Path, label: str) -> Mapping[str, Any] | None:
    """Return the result of a cell's repair; None if it was not tried."""
    path = folder / "repairs" / f"{label}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def log(folder: Path, cell: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Run `explain` on what a user would have seen: the log, and the tracebacks of failures.

    Returns its document; None if the cell has no evidence.
    """
    place = folder / "report" / (cell["evidence"] or "")
    if not cell["evidence"]:
        return None
    files = sorted(place.iterdir()) if place.is_dir() else [place]
    texts = [path.read_text(encoding="utf-8") for path in files if path.suffix in {".txt", ".log"}]
    texts += [text for path in files if path.suffix == ".jsonl" for text in tracebacks(path)]
    seen = folder / "seen.log"
    seen.write_text("\n".join(texts), encoding="utf-8")
    return json.loads(simmatrix(folder, "explain", str(seen), "--json").stdout)


def tracebacks(path: Path) -> Iterator[str]:
    """Yield the tracebacks of a probe's reply."""
    for line in path.read_text(encoding="utf-8").splitlines():
        entry = json.loads(line)
        raised = [one for one in (entry, entry.get("raised")) if isinstance(one, dict)]
        yield from (one["traceback"] for one in raised if "traceback" in one)


def page(judged: Sequence[Judged], cells_by_label: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield the whole document."""
    today = datetime.now(UTC).strftime("%Y-%m-%d")
    yield "# How good diagnoses and repairs are"
    yield ""
    yield (
        f"Made by `python benchmarks/judged.py run`, `repair`, `score` on {today}: Python {platform.python_version()}, "
        f"Linux {platform.machine()}, {os.cpu_count()} cores, which other work shared. The "
        f"{len(cells_by_label)} combinations of [judged.toml](judged.toml) were listed before any was run, by a hand "
        "that wrote no signature; "
        "[judged-truth.toml](judged-truth.toml) says of each that fails what is so, from its logs."
    )
    yield ""
    unlabelled = sum("incurable" in one.truth for one in judged)
    yield (
        f"Of {unlabelled} that were first said to have a remedy it was seen, once `repair` had found none, that they "
        "have none (`incurable` says how). What else `repair` missed led to changes of it (cells that only import, an "
        "older Python with the index of its time, windows of SDL): for repairs these cells are unseen no longer. "
        f"Each was given {MINUTES_EACH} minutes."
    )
    yield ""
    yield from figures(judged)
    yield ""
    yield "| cell | fails in | cause | named | of its log | repair | runs | environments built | seconds |"
    yield "| --- | --- | --- | --- | --- | --- | --: | --: | --: |"
    yield from map(row, judged)


def figures(judged: Sequence[Judged]) -> Iterator[str]:
    """Yield a table of the figures that the issue asks for."""
    phases = sum(one.phase == one.truth["phase"] for one in judged)
    causes = Counter(one.cause for one in judged)
    logs = Counter(one.explained for one in judged if one.explained)
    tried = [one for one in judged if one.proof and (one.truth["curable"] or one.cured)]
    cured = [one for one in tried if one.cured]
    yield "| of | figure | target |"
    yield "| --- | --- | --- |"
    yield f"| first failing phase, right | {share(phases, len(judged))} | 95 of 100 |"
    yield f"| cause, right | {share(causes['right'], len(judged))} | 75 of 100 |"
    yield f"| cause, wrong | {share(causes['wrong'], len(judged))} | at most 2 of 100 |"
    yield f"| cause unknown, with the right line | {share(causes['unknown'], len(judged))} | the rest |"
    yield f"| cause unknown, with another line | {share(causes['unknown, another line'], len(judged))} | none |"
    summary = f"{share(logs['right'], logs.total())} right, {share(logs['wrong'], logs.total())} wrong"
    yield f"| cause, of the log alone (`explain`) | {summary} | |"
    yield f"| a proven remedy, of those tried that have one | {share(len(cured), len(tried))} | 80 of 100 |"
    if cured:
        seconds = statistics.median(one.proof["seconds"] for one in cured if one.proof)
        built = statistics.median(one.proof["built"] for one in cured if one.proof)
        yield f"| median repair | {seconds:.0f} s, {built:.0f} environments built | 90 s, caches warm |"
    if searched := [one.proof for one in cured if one.proof and one.proof["bound"]]:
        built, bound = (sum(proof[key] for proof in searched) for key in ("built", "bound"))
        summary = f"{built} environments built in all, {bound} tests that binary searches need at most"
        yield f"| the {len(searched)} that searched among packages | {summary} ({built / bound:.2f}) | |"


def share(count: int, whole: int) -> str:
    """Return a count of a whole, with its percentage."""
    return f"{count} of {whole} ({100 * count / whole:.0f} of 100)" if whole else "none"


def row(combination: Judged) -> str:
    """Return the line of the table for one combination."""
    phase = (
        combination.phase
        if combination.phase == combination.truth["phase"]
        else f"{combination.phase}, but it is {combination.truth['phase']}"
    )
    return (
        "| "
        + " | ".join(
            (
                combination.label,
                str(phase),
                combination.cause,
                combination.named or "",
                combination.explained or "",
                *repaired(combination),
            )
        )
        + " |"
    )


def repaired(combination: Judged) -> Iterable[str]:
    """Return the cells of the table about a repair: result, runs, environments built, seconds."""
    if combination.proof is None:
        return ("not tried", "", "", "")
    does = "; ".join((combination.proof.get("remedy") or {}).get("does", ()))
    outcome = does if combination.proof["status"] == "found" else combination.proof["status"]
    if not combination.truth["curable"] and not combination.cured:
        outcome = f"{outcome} (none is known)"
    return (
        outcome.replace("|", "\\|"),
        *(str(combination.proof[key]) for key in ("measured", "built")),
        f"{combination.proof['seconds']:.0f}",
    )


if __name__ == "__main__":
    main()
