"""Index the words in which releases of a package differ: `python -m harness.history.word_index` writes `words.json.gz`.

With it `explain` opens only the histories that can answer a line.
"""

from __future__ import annotations

import gzip
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from harness.machine.store import write_atomic

FOLDER = Path(__file__).parents[2] / "matrices" / "history"
INDEX = FOLDER / "words.json.gz"
NO_HISTORIES = frozenset({"debian-files", "words"})


def main() -> None:
    """Write the index of the histories in `matrices/history/`."""
    write_atomic(INDEX, encode(read_histories(FOLDER)))


def read_histories(folder: Path) -> Iterator[Mapping[str, Any]]:
    """Yield the histories of a folder as plain data."""
    for file in sorted(folder.glob("*.json.gz")):
        if file.name.partition(".")[0] not in NO_HISTORIES:
            yield msgspec.json.decode(gzip.decompress(file.read_bytes()))


def encode(histories: Iterable[Mapping[str, Any]]) -> bytes:
    """Return the index as its file holds it: of each kind the words, and the packages whose releases differ in one."""
    index: dict[str, dict[str, set[str]]] = {"names": {}, "members": {}, "parameters": {}}
    for history in histories:
        for kind, word in differing(history):
            index[kind].setdefault(word, set()).add(str(history["package"]))
    plain = {kind: {word: sorted(packages) for word, packages in words.items()} for kind, words in index.items()}
    return gzip.compress(msgspec.json.encode(plain, order="sorted"), mtime=0)


def differing(history: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the kind and the word of all in which the releases of a package differ.

    `names` are those of its top-level modules, `members` those of classes, `parameters` those of functions.
    """
    read = {place for place, item in enumerate(history["releases"]) if item.get("read")}
    for module, names in history.get("names", {}).items():
        yield from (
            ("names", name) for name, spans in names.items() if "." not in module and _places(spans, read) != read
        )
    for members in history.get("members", {}).values():
        there = set().union(*(_places(spans, read) for spans in members.values()))
        yield from (("members", name) for name, spans in members.items() if _places(spans, read) != there)
    for texts in history.get("signatures", {}).values():
        there = set().union(*(_places([text[:2]], read) for text in texts))
        for kind in (_names, _required):
            having: dict[str, set[int]] = {}
            for first, last, parameters in texts:
                for name in kind(parameters):
                    having.setdefault(name, set()).update(_places([(first, last)], read))
            yield from (("parameters", name) for name, places in having.items() if places != there)


def _names(parameters: str) -> list[str]:
    return [name for item in parameters.split(", ") if (name := item.strip("=")).isidentifier()]


def _required(parameters: str) -> list[str]:
    return [item for item in parameters.split(", ") if item.isidentifier()]


def _places(spans: Iterable[Any], read: set[int]) -> set[int]:
    return {place for first, last in spans for place in range(first, last + 1)} & read


if __name__ == "__main__":
    main()
