"""Read the known failures: the signatures that come with the harness, from `matrices/signatures/`.

`HARNESS_SIGNATURES` names another folder of them; set to the empty string, nothing is known.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from harness.judging.known_failures import Knowledge
from harness.machine.files import guarded_files
from harness.matrix import signatures
from harness.matrix.signatures import Signature
from harness.model.errors import BadInput
from harness.model.hostile_data import Unreadable
from harness.packages import locks
from harness.running.signatures.signature_files import VARIABLE, folder

HEAD, TAIL = 16_000, 48_000
"""Characters of a kept text that are looked at; of a longer one its middle is left out."""
# Signatures have to write these two lines exactly so; tests/unit/standalone/test_silent.py checks that they do.
HEAD_LINE = re.compile(r"^\[\[signature\]\]$", re.MULTILINE)
SILENT = re.compile(r"^silent = true$", re.MULTILINE)
TEXT_SUFFIXES = (".log", ".txt", ".jsonl")


def load_all() -> tuple[Signature, ...]:
    """Return all signatures. Raises BadInput."""
    place = folder()
    return _read(place) if place else ()


@cache
def _read(place: Path) -> tuple[Signature, ...]:
    if not place.is_dir():
        message = f"{place}: is not a folder; {VARIABLE} names the folder of the signatures"
        raise BadInput(message)
    return signatures.read({path.name: _text(path) for path in sorted(place.glob("*.toml"))})


def silent() -> tuple[Signature, ...]:
    """Return the silent signatures without reading the others: a green result is compared with nothing else."""
    place = folder()
    return _read_silent(place) if place else ()


@cache
def _read_silent(place: Path) -> tuple[Signature, ...]:
    texts = {path.name: _text(path) for path in sorted(place.glob("*.toml"))}
    # Cut out as text: to check the patterns of all signatures takes long, and few are silent.
    blocks = {name: [one for one in HEAD_LINE.split(text)[1:] if SILENT.search(one)] for name, text in texts.items()}
    return signatures.read(
        {name: "".join(f"[[signature]]{one}" for one in found) for name, found in blocks.items() if found}
    )


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        message = f"{path}: cannot be read: {error}"
        raise BadInput(message) from None


def load_knowledge(state: Path) -> Knowledge:
    """Return the knowledge that failures are compared with; their logs lie below the state folder."""
    return Knowledge(
        signatures=load_all,
        logs=lambda path: texts(state / path),
        locked=lambda path: _pinned(state / path),
        silent=silent,
    )


def _pinned(lock: Path) -> tuple[str, ...]:
    """Return the lines `name==version` of a lock; none if it is gone."""
    pins = locks.read_pins(_text(lock)) if lock.is_file() else {}
    return tuple(f"{name}=={version}" for name, (version, _) in pins.items())


MOST_TEXT = 64 << 20


def texts(place: Path) -> dict[str, str]:
    """Return the texts of a log file, or of a folder of evidence, by name; none where it is gone."""
    files = sorted(place.iterdir()) if place.is_dir() else [place]
    return {path.name: _bounded(path) for path in files if path.suffix in TEXT_SUFFIXES and path.is_file()}


def _bounded(path: Path) -> str:
    try:
        text = guarded_files.head(path, MOST_TEXT, follow=True).decode("utf-8", "replace")
    except Unreadable:
        return ""
    return text if len(text) <= HEAD + TAIL else f"{text[:HEAD]}\n...\n{text[-TAIL:]}"
