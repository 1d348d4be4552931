"""Make the table of files in Debian's packages: `python -m harness.history.debian_files FILE`.

It has libraries, headers and programs. FILE is `Contents-amd64.gz` of a Debian release, as its archive has it below
`dists/RELEASE/main/`.
"""

from __future__ import annotations

import gzip
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec

from harness.history.making import OUT
from harness.machine.store import write_atomic

PLACES = {
    "libraries": re.compile(r"(?:usr/)?lib/(?:x86_64-linux-gnu/)?(lib[\w+.-]+?\.so\.[\d.]+)"),
    "links": re.compile(r"usr/lib/(?:x86_64-linux-gnu/)?(lib[\w+.-]+?\.so)"),
    "headers": re.compile(r"usr/include/(?:x86_64-linux-gnu/)?((?:[\w.+-]+/)?[\w.+-]+\.h(?:pp)?)"),
    "programs": re.compile(r"usr/bin/([\w.+-]+)"),
}


def main() -> None:
    """Write the table beside the histories."""
    table: dict[str, dict[str, str]] = {kind: {} for kind in PLACES}
    with gzip.open(sys.argv[1], "rt", encoding="utf-8", errors="replace") as lines:
        for line in lines:
            path, _, packages = line.rstrip().rpartition(" ")
            for kind, place in PLACES.items():
                match = place.fullmatch(path.strip())
                if match:
                    table[kind][match.group(1)] = min(
                        _names(packages), key=lambda name: (name.count("-"), len(name), name)
                    )
    # Each Python of Debian has its own; a compiler finds it by the name alone.
    table["headers"]["Python.h"] = "python3-dev"
    file = Path(OUT / "debian-files.json.gz")
    write_atomic(file, gzip.compress(msgspec.json.encode(table, order="sorted"), mtime=0))
    print(f"{file.name}: {', '.join(f'{len(files)} {kind}' for kind, files in table.items())}")


def _plainness(name: str) -> tuple[int, int, str]:
    return name.count("-"), len(name), name


def _names(packages: str) -> Iterator[str]:
    return (one.rpartition("/")[2] for one in packages.split(","))


if __name__ == "__main__":
    main()
