"""A maintainer's first run in the repositories of `firstruns.toml`: `python benchmarks/firstruns.py run FOLDER [NAME]`.

FOLDER holds a checkout of each at its commit. `run` types `simmatrix init` in it, then `simmatrix run` for a few of the
cells that `init` wrote, and keeps what came of it in `firstruns-seen.json`; `page` writes `firstruns.md` from that and
from the answers, judged by hand, in `firstruns-judged.toml`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from time import monotonic
from typing import Any

HERE = Path(__file__).parent
LIST, SEEN, JUDGED, PAGE = (HERE / f"firstruns{end}" for end in (".toml", "-seen.json", "-judged.toml", ".md"))
CELLS = 2
"""Cells of a first matrix that are run: the oldest and the newest values on its main Python."""

MINUTES = 20.0
ANSWERS = ("right", "honest", "wrong")


def main() -> int:
    """Run some of the repositories, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    running = verbs.add_parser("run")
    running.add_argument("folder", type=Path)
    running.add_argument("names", nargs="*")
    running.add_argument("--until", default="suite", help="the last phase of the cells [suite]")
    running.add_argument("--cells", type=int, default=CELLS, help="how many are run [2]; 1 is the newest alone")
    running.add_argument("--minutes", type=float, default=MINUTES, help="for each command [20]")
    verbs.add_parser("page")
    args = parser.parse_args()
    if args.verb == "page":
        PAGE.write_text(page(), encoding="utf-8")
        return 0
    for repository in listed():
        if not args.names or repository["name"] in args.names:
            keep(repository["name"], run_repository(repository, args))
    return 0


def listed() -> list[dict[str, str]]:
    """Return the repositories, in their order."""
    return list(tomllib.loads(LIST.read_text(encoding="utf-8"))["repository"])


def keep(name: str, result: dict[str, Any]) -> None:
    """Write what came of one repository beside the others, those of another process among them."""
    results = json.loads(SEEN.read_text(encoding="utf-8")) if SEEN.exists() else {}
    results[name] = result
    SEEN.write_text(json.dumps(results, indent=1, sort_keys=True, ensure_ascii=False) + "\n", encoding="utf-8")


# --- one repository --------------------------------------------------------------------------------------------


def run_repository(repository: dict[str, str], args: argparse.Namespace) -> dict[str, Any]:
    """Return the files and messages of `init`, and the results of the cells."""
    folder = args.folder / repository["name"]
    commit = typed(folder, ("git", "rev-parse", "HEAD"), 1)[1].strip()
    if commit != repository["commit"]:
        message = f"{folder}: stands at {commit}, and the list says {repository['commit']}"
        raise SystemExit(message)
    began = monotonic()
    code, out, _ = typed(folder, simmatrix("init", "--install", "simmatrix"), args.minutes)
    result: dict[str, Any] = {"code": code, "seconds": round(monotonic() - began), "said": out.splitlines()}
    matrices = sorted([*folder.glob("matrices/*.toml"), *folder.glob(".simmatrix/*.toml")])
    if not matrices:
        return result
    text = matrices[0].read_text(encoding="utf-8")
    result["matrix"] = [line for line in text.splitlines() if line and not line.startswith("# A first draft")]
    path = str(matrices[0].relative_to(folder))
    planned = typed(folder, simmatrix("plan", path, "--json"), 2)[1]
    cells = json.loads(planned)["cells"] if planned.startswith("{") else []
    result["planned"] = len(cells)
    result["cells"] = [run_cell(folder, path, cell, args) for cell in chosen(cells, args.cells)]
    return result


def chosen(cells: Sequence[dict[str, Any]], count: int) -> list[dict[str, Any]]:
    """Return the first and the last cells on the Python that most cells have; of one the last."""
    if not cells:
        return []
    python = Counter(cell["axes"]["python"] for cell in cells).most_common(1)[0][0]
    there = [cell for cell in cells if cell["axes"]["python"] == python]
    return there[-1:] if count == 1 else [*there[:1], *there[1:][1 - count :]]


def run_cell(folder: Path, matrix: str, cell: dict[str, Any], args: argparse.Namespace) -> dict[str, Any]:
    """Run one cell and return its results, in short."""
    command = simmatrix("run", matrix, "-k", cell["id"], "--until", args.until, "--json")
    code, out, err = typed(folder, command, args.minutes)
    if not out.startswith("{"):
        return {"id": cell["id"], "code": code, "said": err.splitlines()[-3:]}
    entry = next(each for each in json.loads(out)["cells"] if each["id"] == cell["id"])
    suite = entry.get("suite")
    return {
        "id": entry["id"],
        "code": code,
        "until": args.until,
        "verdict": entry["verdict"],
        "decisive": entry["decisive"],
        "known_as": [each["signature"] for each in entry["diagnoses"]],
        "cases": {case["env"] or case["case"]: short(case["phases"]) for case in entry["cases"]},
        "suite": suite and {
            "outcome": suite["outcome"],
            "tests": suite["tests"],
            "decisive": suite["decisive"],
            "known_as": [each["signature"] for each in suite.get("diagnoses") or ()],
        },
    }  # fmt: skip


def short(phases: dict[str, str]) -> str:
    """Return the phases of a case that were tried, in words."""
    outcomes = {phase: outcome for phase, outcome in phases.items() if outcome != "skipped"}
    return ", ".join(f"{phase} {outcome}" for phase, outcome in outcomes.items())


def simmatrix(*words: str) -> tuple[str, ...]:
    """Return the command line of a verb."""
    return (sys.executable, "-m", "harness", *words)


def typed(folder: Path, command: Sequence[str], minutes: float) -> tuple[int, str, str]:
    """Run a command in a folder: exit code, stdout, stderr."""
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60 * minutes, check=False)
    except subprocess.TimeoutExpired:
        return 124, "", f"no end within {minutes:g} minutes"
    return done.returncode, done.stdout, done.stderr


# --- the page --------------------------------------------------------------------------------------------------


def page() -> str:
    """Return the page: one line each, then what was seen."""
    results = json.loads(SEEN.read_text(encoding="utf-8"))
    judged = tomllib.loads(JUDGED.read_text(encoding="utf-8"))
    counts = Counter(judged[each["name"]]["answer"] for each in listed() if each["name"] in judged)
    summary = ", ".join(f"{counts[answer]} {answer}" for answer in ANSWERS)
    lines = [
        "# A maintainer's first run in twelve repositories",
        "",
        "The list and the right answers were committed before the first run (`firstruns.toml`). In each repository, at",
        "the commit named there, `simmatrix init` was typed, then `simmatrix run` for the newest cell (in some the",
        "oldest, too) on the main Python of the matrix that it wrote; the tests where the table says how they ended.",
        "Both were repeated while `init` was mended: the answers are those of the last time. *honest*: it says what it",
        "could not find out.",
        "Made by `python benchmarks/firstruns.py page`.",
        "",
        f"**{summary}** of {len(listed())}.",
        "",
        "| repository | answer | init | cases | tests | cells run | why |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [row(each["name"], results.get(each["name"]), judged.get(each["name"])) for each in listed()]
    for each in listed():
        if each["name"] in results:
            lines += ["", f"## {each['name']}", "", *section(each, results[each["name"]])]
    return "\n".join(lines) + "\n"


def row(name: str, result: dict[str, Any] | None, judged: dict[str, str] | None) -> str:
    """Return a repository's line of the table."""
    if not result or not judged:
        return f"| {name} | not run yet | | | | | |"
    cells = result.get("cells", [])
    cases = max((len(cell.get("cases", {})) for cell in cells), default=0)
    tests = "; ".join(dict.fromkeys(suite_words(cell) for cell in cells if cell.get("suite"))) or "not asked for"
    verdicts = "; ".join(f"{count} {what}" for what, count in Counter(describe_verdict(cell) for cell in cells).items())
    init = f"exit {result['code']}, {result['seconds']} s"
    return f"| {name} | {judged['answer']} | {init} | {cases} | {tests} | {verdicts} | {judged['why']} |"


def describe_verdict(cell: dict[str, Any]) -> str:
    """Return the verdict of a cell in words."""
    return str(cell.get("verdict", f"exit {cell['code']}")).replace("_", " ")


def suite_words(cell: dict[str, Any]) -> str:
    """Return how the tests ended: passed of all, or why they were not run."""
    suite = cell["suite"]
    if cell["until"] != "suite":
        return "not asked for"
    total = sum(suite["tests"].values())
    if total:
        return f"{suite['tests'].get('passed', 0)}/{total} passed"
    return f"{suite['outcome'].replace('_', ' ')}" + (f" ({', '.join(suite['known_as'])})" if suite["known_as"] else "")


def section(repository: dict[str, str], result: dict[str, Any]) -> Iterator[str]:
    """Yield the expectation that was written before, and the results."""
    expected = " ".join(repository["right"].split())
    yield f"`{repository['source']}` at `{repository['commit'][:12]}`. Expected: {expected}"
    yield from ("", "`init`:", "", "```")
    yield from result["said"]
    yield from ("```", "")
    for cell in result.get("cells", []):
        line = f"- `{cell['id']}`: **{describe_verdict(cell)}**, exit {cell['code']}. {cell.get('decisive') or ''}"
        yield line.rstrip()
        if cell.get("known_as"):
            yield f"  - known as {', '.join(cell['known_as'])}"
        yield from (f"  - {env}: {phases}" for env, phases in cell.get("cases", {}).items())
        if cell.get("suite"):
            yield f"  - tests: {suite_words(cell)}. {cell['suite']['decisive'] or ''}".rstrip()


if __name__ == "__main__":
    sys.exit(main())
