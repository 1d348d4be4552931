"""Load the known issues in words, read once for each state of the signature files: checking all patterns takes long."""

from __future__ import annotations

from pathlib import Path

import msgspec

from harness.judging import known_issues
from harness.judging.known_issues import Issue
from harness.machine import store
from harness.model import decoding
from harness.running.signatures.signature_files import files


def load() -> tuple[Issue, ...]:
    """Return all known issues, without their cells. Raises BadInput."""
    # The two source files count, too: another version may word the same signatures otherwise.
    marks = [
        (str(path), path.stat().st_mtime_ns, path.stat().st_size)
        for path in (*files(), Path(__file__), Path(known_issues.__file__))
    ]
    read = decoding.decoder(tuple[Issue, ...]).decode
    return store.load_or_make("issues", repr(marks), _encode_issues, read)


def _encode_issues() -> bytes:
    from harness.judging.known_issues import from_signature  # noqa: PLC0415 - start-up
    from harness.running.signatures import shipped_signatures  # noqa: PLC0415 - start-up

    return msgspec.json.encode(tuple(map(from_signature, shipped_signatures.load_all())))
