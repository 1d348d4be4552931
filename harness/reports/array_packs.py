"""Pack files of arrays: equal arrays once, others as differences from similar ones.

Releases that differ by rounding differ in few bits. A difference is the exclusive or of two arrays of one size, its
bytes laid out by their place in each number of eight bytes: then the many zeros lie together, and the archive around
them makes little of them.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping
from hashlib import sha256

import msgspec
import numpy as np

from harness.model import decoding
from harness.model.hostile_data import Unreadable, raise_unreadable
from harness.probes import array_files

WIDTH = 8
NO_BASE = "0" * 64
"""Stands before an array that is kept as it is, where the SHA-256 of the array that it differs from would stand."""

NEAR = 3
"""Arrays before an array among which the most similar one is chosen."""

FILES, ARRAYS = "npz", "array"
"""Folders of a pack: the arrays of each file by name, and the arrays."""


class Contents(msgspec.Struct, frozen=True):
    """The arrays of one file: the name of each, and the SHA-256 of its `.npy` form."""

    arrays: tuple[tuple[str, str], ...]


def pack(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the members of a pack for files of arrays, given by SHA-256.

    Arrays of one name and size are kept as differences, each from the most similar of the few before it: neighbouring
    releases have to stand near each other. Two versions of a task often have arrays of one size.
    """
    members: dict[str, bytes] = {}
    before: dict[tuple[str, int], list[str]] = {}
    plain: dict[str, bytes] = {}
    for file, content in files.items():
        named = []
        for name, array in parts(content):
            sha = sha256(array).hexdigest()
            named.append((name, sha))
            key = name, len(array)
            latest = before.setdefault(key, [])
            if sha not in plain:
                plain[sha] = array
                differences = [(base, _difference(array, plain[base])) for base in latest]
                base, bits = max(differences or [(NO_BASE, array)], key=lambda pair: pair[1].count(0))
                members[f"{ARRAYS}/{sha}"] = base.encode() + _laid_out(bits)
            before[key] = [sha, *(one for one in latest if one != sha)][:NEAR]
        members[f"{FILES}/{file}"] = msgspec.json.encode(Contents(tuple(named)))
    return members


def parts(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield name and `.npy` form of each array in a file."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for member in archive.infolist():
            yield member.filename, archive.read(member)


def can_pack(content: bytes) -> bool:
    """Return whether a file comes back to the byte from its arrays."""
    try:
        return array_files.encode(array_files.decode(content)) == content
    except Unreadable:
        return False


def unpack(members: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files that `pack` made these members of, by SHA-256. Raises Unreadable."""
    arrays = _arrays({name.partition("/")[2]: one for name, one in members.items() if name.startswith(f"{ARRAYS}/")})
    files = {}
    for name, member in members.items():
        folder, _, file = name.partition("/")
        if folder == FILES:
            with raise_unreadable():
                contents = decoding.decoder(Contents).decode(member)
                files[file] = array_files.join({part: arrays[sha] for part, sha in contents.arrays})
            if sha256(files[file]).hexdigest() != file:
                message = f"{name} is not the content of that name"
                raise Unreadable(message)
    return files


def _arrays(packed: Mapping[str, bytes]) -> dict[str, bytes]:
    """Restore arrays, each after the one that it differs from. Raises Unreadable."""
    followers: dict[str, list[str]] = {}
    for name, member in packed.items():
        followers.setdefault(member[: len(NO_BASE)].decode("ascii", "replace"), []).append(name)
    arrays: dict[str, bytes] = {}
    waiting = [NO_BASE]
    while waiting:
        base = waiting.pop()
        for name in followers.get(base, ()):
            bits = _restored(packed[name][len(NO_BASE) :])
            if base != NO_BASE and len(arrays[base]) != len(bits):
                message = f"{ARRAYS}/{name} has another size than the array that it differs from"
                raise Unreadable(message)
            arrays[name] = _difference(bits, arrays.get(base))
            waiting.append(name)
    if len(arrays) != len(packed):
        message = "an array differs from one that is not there"
        raise Unreadable(message)
    return arrays


def _difference(content: bytes, base: bytes | None) -> bytes:
    if base is None:
        return content
    return np.bitwise_xor(np.frombuffer(content, np.uint8), np.frombuffer(base, np.uint8)).tobytes()


def _laid_out(content: bytes) -> bytes:
    whole = len(content) - len(content) % WIDTH
    table = np.frombuffer(content[:whole], np.uint8).reshape(-1, WIDTH)
    return np.ascontiguousarray(table.T).tobytes() + content[whole:]


def _restored(content: bytes) -> bytes:
    whole = len(content) - len(content) % WIDTH
    table = np.frombuffer(content[:whole], np.uint8).reshape(WIDTH, -1)
    return np.ascontiguousarray(table.T).tobytes() + content[whole:]
