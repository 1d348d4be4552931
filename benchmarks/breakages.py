"""Certify real breakages: `python benchmarks/breakages.py --folder DIR` bisects what `breakages.toml` lists.

Each certificate lies in the folder and is not made twice; `breakages.md` is written of all that there are; those
that are to stay are copied to `certificates/`.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic
from typing import Any

HERE = Path(__file__).parent
MATRIX = "breakages"
MINUTES_EACH = 15


def main() -> None:
    """Bisect what is left of the list, as long as there is time, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=60, help="after which no other is begun")
    args = parser.parse_args()
    listed = tomllib.loads((HERE / "breakages.toml").read_text(encoding="utf-8"))["breakage"]
    began = monotonic()
    for one in listed:
        if monotonic() - began < args.minutes * 60 and not certificate(args.folder, one):
            bisect(args.folder, one)
    text = "\n".join(page(listed, args.folder))
    (HERE / "breakages.md").write_text(text + "\n", encoding="utf-8")
    print(text)


def bisect(folder: Path, one: Mapping[str, str]) -> None:
    """Make the certificate of one breakage."""
    environment = {**os.environ, "HARNESS_STATE": str(folder / "state")}
    out = folder / "certificates" / one["cell"]
    command = [sys.executable, "-m", "harness", "bisect", f"{MATRIX}/{one['cell']}", *one["by"].split()]
    subprocess.run([*command, "--minutes", str(MINUTES_EACH), "--out", str(out)], env=environment, check=False)


def certificate(folder: Path, one: Mapping[str, str]) -> Mapping[str, Any] | None:
    """The certificate of a breakage, if it was made."""
    found = sorted((folder / "certificates" / one["cell"]).rglob("*.json"))
    return json.loads(found[0].read_text(encoding="utf-8")) if found else None


def page(listed: Sequence[Mapping[str, str]], folder: Path) -> Iterator[str]:
    """The whole document."""
    today = datetime.now(UTC).strftime("%Y-%m-%d")
    yield "# Twenty breakages, certified by bisection"
    yield ""
    yield (
        f"Made by `python benchmarks/breakages.py` on {today}: Python {platform.python_version()}, "
        f"Linux {platform.machine()}, {os.cpu_count()} cores, which other work shared. What was foretold stands in "
        "[breakages.toml](breakages.toml) since before the first run. The bound is that of a binary search between "
        "two ends that are known; looking for a good end and confirming both come on top."
    )
    yield ""
    yield "| cell | along | foretold | found | runs | environments built | bound |"
    yield "| --- | --- | --- | --- | --: | --: | --: |"
    for one in listed:
        made = certificate(folder, one)
        name = f"[{one['cell']}](certificates/{one['cell']}/bisect.md)" if made else one["cell"]
        told = [name, f"`{one['by']}`", one["foretold"] or "nothing"]
        row = told + (said(made) if made else ["not tried", "", "", ""])
        yield "| " + " | ".join(text.replace("|", "\\|").replace("\n", " ") for text in row) + " |"


def said(made: Mapping[str, Any]) -> list[str]:
    """What a certificate claims, and what that took."""
    return [made["claim"], *(str(made[key]) for key in ("measured", "built", "bound"))]


if __name__ == "__main__":
    main()
