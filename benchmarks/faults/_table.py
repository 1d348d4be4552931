"""The table of all faults: `reports/faults/report.md` and `faults.json`."""

from __future__ import annotations

import json
import os
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any

from ._declaring import SECTIONS

ROOT = Path(__file__).parents[2]
REPORT = ROOT / "reports" / "faults"
COMMAND = "python -m benchmarks.faults --write"


def write(rows: Sequence[Mapping[str, Any]], current: int, folder: Path = REPORT) -> None:
    """Write both files; `current` is how many rows were run with the code as it is now."""
    folder.mkdir(parents=True, exist_ok=True)
    faults = [{**row, "came": hide_paths(row["came"])} for row in rows]
    document = {"command": COMMAND, "machine": machine(), "current": current, "faults": faults}
    text = json.dumps(document, indent=1, ensure_ascii=False)
    (folder / "faults.json").write_text(text + "\n", encoding="utf-8")
    (folder / "report.md").write_text(rendered(document), encoding="utf-8")


def load_rows() -> list[dict[str, Any]]:
    """Return the rows that are there."""
    file = REPORT / "faults.json"
    return list(json.loads(file.read_text(encoding="utf-8"))["faults"]) if file.exists() else []


def machine() -> dict[str, str]:
    """Return the facts about this machine that a reader needs."""
    return {
        "system": f"{platform.system()} {platform.release().split('-')[0]} {platform.machine()}",
        "python": platform.python_version(),
        "uv": version("uv"),
        "user": "root" if os.geteuid() == 0 else "an ordinary user",
        "cores": str(os.cpu_count()),
    }


def hide_paths(text: str) -> str:
    """Return a text without folders of this machine."""
    text = re.sub(r"[\w./-]*/fault-\w{8}(?:/desk)?", "$DESK", text)
    return text.replace(str(ROOT), "$REPOSITORY").replace(str(Path.home()) + "/", "~/")


def rendered(document: Mapping[str, Any]) -> str:
    """Return the page of a document."""
    rows = document["faults"]
    tried = [row for row in rows if row["tried"]]
    held = [row for row in tried if row["held"] and not row["documented"]]
    documented = [row for row in tried if row["documented"]]
    broken = [row for row in tried if not row["held"] and not row["documented"]]
    days = sorted({row["at"][:10] for row in rows})
    facts = ", ".join(f"{name} {value}" for name, value in document["machine"].items())
    return "\n".join(
        [
            "# Faults",
            "",
            f"**{len(rows)} faults: {len(held)} promises held, {len(broken)} broken, {len(documented)} documented, "
            f"{len(rows) - len(tried)} not tried here.**",
            "",
            f"Made by `{document['command']}` on {' to '.join(dict.fromkeys((days[0], days[-1])))}: {facts}. Each "
            "fault was done for real with packages made for it. For every fault the harness also has to end without a "
            "traceback, with an exit code other than 4, and to leave no process behind. *documented*: no mechanism can "
            "prevent it, and [the threat model](../../docs/threat-model.md) says so."
            + _older(len(rows) - document["current"]),
            *_sections(rows),
            "",
        ]
    )


def _older(count: int) -> str:
    return f" {count} of them were done with earlier code." if count else ""


def _sections(rows: Sequence[Mapping[str, Any]]) -> Iterable[str]:
    ordered = sorted(rows, key=lambda row: SECTIONS.index(row["section"]))
    for section, members in groupby(ordered, key=lambda row: row["section"]):
        yield from ("", f"## {section[0].upper()}{section[1:]}", "")
        yield from ("| row | what was done | what came | held |", "| --- | --- | --- | --- |")
        for row in members:
            yield f"| {row['row']} | {safe(row['done'])} | {safe(row['came'])} | {_held(row)} |"


def _held(row: Mapping[str, Any]) -> str:
    if not row["tried"]:
        return "not tried"
    if row["documented"]:
        return f"[documented](../../docs/threat-model.md#{anchor(row['documented'])})"
    return "yes" if row["held"] else "**no**"


def anchor(heading: str) -> str:
    """Return the fragment of a Markdown heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def safe(text: str, most: int = 400) -> str:
    """Return a text that can stand in a cell of a table: one line, nothing live."""
    line = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())
    line = line if len(line) <= most else line[: most - 3] + "..."
    return re.sub(r"([|<>\[\]*_!@])", r"\\\1", line) if "`" not in line else line.replace("|", "\\|")
