"""Certify real breakages: `python benchmarks/breakages.py --folder DIR` bisects what `breakages.toml` lists.

Each certificate lies in the folder and is not made twice; `breakages.md` is written of all that there are; those
that are to stay are copied to `certificates/`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from time import monotonic
from typing import Any

HERE = Path(__file__).parent
MATRIX = "breakages"
MINUTES_EACH = 15
CERTIFIED = "found"


def main() -> None:
    """Bisect what is left of the list, as long as there is time, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=60, help="after which no other is begun")
    args = parser.parse_args()
    listed = tomllib.loads((HERE / "breakages.toml").read_text(encoding="utf-8"))["breakage"]
    began = monotonic()
    for breakage in listed:
        if monotonic() - began < args.minutes * 60 and not certificate(args.folder, breakage):
            bisect(args.folder, breakage)
    text = "\n".join(page(listed, args.folder))
    (HERE / "breakages.md").write_text(text + "\n", encoding="utf-8")
    print(text)


def bisect(folder: Path, breakage: Mapping[str, str]) -> None:
    """Make the certificate of one breakage."""
    environment = {**os.environ, "HARNESS_STATE": str(folder / "state")}
    out = folder / "certificates" / breakage["cell"]
    command = [sys.executable, "-m", "harness", "bisect", f"{MATRIX}/{breakage['cell']}", *breakage["by"].split()]
    subprocess.run([*command, "--minutes", str(MINUTES_EACH), "--out", str(out)], env=environment, check=False)


def certificate(folder: Path, breakage: Mapping[str, str]) -> Mapping[str, Any] | None:
    """Return the certificate of a breakage, if it was made."""
    paths = sorted((folder / "certificates" / breakage["cell"]).rglob("*.json"))
    return json.loads(paths[0].read_text(encoding="utf-8")) if paths else None


def page(listed: Sequence[Mapping[str, str]], folder: Path) -> Iterator[str]:
    """Yield the lines of the whole document, all of them made of the list and the certificates."""
    certificates = {one["cell"]: certificate(folder, one) for one in listed}
    successes = [one for one in listed if (it := certificates[one["cell"]]) and it["status"] == CERTIFIED]
    others = [one for one in listed if one not in successes]
    days = sorted({it["generated"][:10] for it in certificates.values() if it})
    yield "# Real breakages, bisected"
    yield ""
    yield (
        f"{len(listed)} breakages were listed in [breakages.toml](breakages.toml), each with what was expected of it, "
        f"before the first run. `python benchmarks/breakages.py` bisected them ({days[0]} to {days[-1]}): of "
        f"{len(successes)} it certifies the boundary, of {len(others)} there is none to certify. The bound is that of "
        "a binary search between two ends that are known; looking for a good end and confirming both come on top."
    )
    yield ""
    yield "## Certified boundaries"
    yield ""
    yield from _table(successes, certificates)
    if others:
        yield ""
        yield "## Without a boundary"
        yield ""
        yield from _table(others, certificates)


def _table(listed: Sequence[Mapping[str, str]], certificates: Mapping[str, Mapping[str, Any] | None]) -> Iterator[str]:
    yield "| cell | along | expected | found | runs | environments built | bound |"
    yield "| --- | --- | --- | --- | --: | --: | --: |"
    for breakage in listed:
        it = certificates[breakage["cell"]]
        name = f"[{breakage['cell']}](certificates/{breakage['cell']}/bisect.md)" if it else breakage["cell"]
        fields = [name, f"`{breakage['by']}`", breakage["foretold"] or "nothing"]
        row = fields + (describe_certificate(it) if it else ["not tried", "", "", ""])
        yield "| " + " | ".join(text.replace("|", "\\|").replace("\n", " ") for text in row) + " |"


def describe_certificate(document: Mapping[str, Any]) -> list[str]:
    """Return the claim of a certificate, and the numbers of its runs, environments and bound."""
    return [document["claim"], *(str(document[key]) for key in ("measured", "built", "bound"))]


if __name__ == "__main__":
    main()
