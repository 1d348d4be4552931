"""Read and write files of arrays: a zip of `.npy` parts, as NumPy reads it, whose bytes depend on the arrays alone.

A file is read as hostile data: no pickles, bounded parts, numbers only.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from harness.model import decoding
from harness.model.hostile_data import Unreadable, raise_unreadable
from harness.probes.evidence import MOST_ARRAYS

MOST_PARTS = 64
FACTS, HASH = "facts", "sha256"
"""The part that holds JSON, as bytes, and the fact that holds the hash of the rest."""

Arrays = Mapping[str, NDArray[Any]]


def decode(content: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file by name. Raises Unreadable."""
    if len(content) > MOST_ARRAYS:
        message = f"it is longer than {MOST_ARRAYS} bytes"
        raise Unreadable(message)
    arrays = {}
    with raise_unreadable(), zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = archive.infolist()
        if len(members) > MOST_PARTS or sum(one.file_size for one in members) > MOST_ARRAYS:
            message = f"it holds more than {MOST_PARTS} arrays or {MOST_ARRAYS} bytes"
            raise Unreadable(message)
        for member in members:
            array = np.lib.format.read_array(io.BytesIO(archive.read(member)), allow_pickle=False)
            if array.dtype.kind not in "biuf":
                message = f"{member.filename} does not hold numbers"
                raise Unreadable(message)
            arrays[member.filename.removesuffix(".npy")] = array
    return arrays


def seal(arrays: Arrays) -> bytes:
    """Return a compressed file of these arrays that carries the hash of its numbers."""
    new_facts = {**facts(arrays), HASH: hash_arrays(arrays)}
    return encode(with_facts(arrays, new_facts), zipfile.ZIP_DEFLATED)


def unseal(content: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file that `seal` made. Raises Unreadable, also if any number was altered."""
    arrays = decode(content)
    if facts(arrays).get(HASH) != hash_arrays(arrays):
        message = "its numbers are not those that it was written with"
        raise Unreadable(message)
    return arrays


def hash_arrays(arrays: Arrays) -> str:
    """Return the SHA-256 of the numbers, and of all facts but itself."""
    new_facts = {name: fact for name, fact in facts(arrays).items() if name != HASH}
    return hashlib.sha256(encode(with_facts(arrays, new_facts))).hexdigest()


def encode(arrays: Arrays, method: int = zipfile.ZIP_STORED) -> bytes:
    """Return the file of these arrays, in the order of their names, without dates."""
    parts = {}
    for name, array in arrays.items():
        part = io.BytesIO()
        np.lib.format.write_array(part, np.ascontiguousarray(array), version=(1, 0), allow_pickle=False)
        parts[f"{name}.npy"] = part.getvalue()
    return join(parts, method)


def join(parts: Mapping[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    """Return the file of these parts, each in the form `.npy`."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name in sorted(parts):
            archive.writestr(zipfile.ZipInfo(name), parts[name], method)
    return file.getvalue()


def facts(arrays: Arrays) -> dict[str, Any]:
    """Return the facts of a file, empty where it has none. Raises Unreadable."""
    if FACTS not in arrays:
        return {}
    with raise_unreadable():
        return decoding.decoder(dict[str, Any]).decode(arrays[FACTS].tobytes())


def with_facts(arrays: Arrays, new_facts: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Return the arrays with other facts."""
    text = msgspec.json.encode(new_facts, order="deterministic")
    return {**arrays, FACTS: np.frombuffer(text, dtype=np.uint8)}
