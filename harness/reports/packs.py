"""Pack the evidence behind a report into one file beside it, from which the report can be made again.

`evidence.tar.xz` holds the records of the cells without anything that was judged from a probe run, every run that they
were judged by with the texts that it left, and the logs of steps on the host. Frames lie beside the report as pictures,
banks of states that come with the harness beside their matrices.
`index.json` names the packs of a report by their SHA-256, and the instant that the report was judged at.
"""

from __future__ import annotations

import hashlib
import io
import lzma
import re
import tarfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from harness.machine.files import guarded_files
from harness.machine.store import write_atomic, write_changed
from harness.model import CaseRecord, CellRecord, Outcome, Phase, PhaseRecord, Plan, decoding, replace
from harness.model.errors import BadInput
from harness.model.hostile_data import Absent, Unreadable, raise_unreadable
from harness.probes.evidence import PICTURE
from harness.probes.vault import MOST_FILE, Vault
from harness.reports import array_packs
from harness.running import open_matrix

INDEX, PACK = "index.json", "evidence{}.tar.xz"
CELLS, CONTENTS, LOGS = "cells.json", "cas", "evidence"
MOST_PACK = 5_000_000
"""Bytes of one pack; the evidence of a report that needs more lies in several."""

# A report may come from anybody: these limits bound what its pack makes us read and unpack.
MOST_INDEX, MOST_UNPACKED, MOST_MEMBERS = 1 << 20, 2 << 30, 200_000
MOST_FRAME = 4 << 20
# No part begins with a dot, so no member can be `..` and leave the state folder.
HASHED = "|".join((CONTENTS, array_packs.FILES, array_packs.ARRAYS))
NAME = re.compile(rf"{CELLS}|({HASHED})/[0-9a-f]{{64}}|{LOGS}/\w[\w.+-]{{0,150}}/\w[\w.+-]{{0,150}}")
FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 9, "dict_size": 64 << 20}]
"""Cells of one report said the same in long stretches: the dictionary reaches over all of them."""

FILTERS_OF_ARRAYS = [{**FILTERS[0], "lc": 1, "lp": 3, "pb": 3, "nice_len": 273, "depth": 1000}]
"""Numbers of eight bytes want other settings, which take a fiftieth of the size away."""


class Packed(msgspec.Struct, frozen=True, kw_only=True):
    """The records of cells, the plans that they belong to, machines, and in-cell digests."""

    plans: tuple[Plan, ...]
    machines: dict[str, dict[str, Any]]
    probes: dict[str, str]
    records: tuple[CellRecord, ...]


class Index(msgspec.Struct, frozen=True, kw_only=True):
    """The file `index.json`: the instant of judging, the hash of the document made then, and the packs by hash."""

    schema: int = 1
    judged: str
    report: str
    packs: dict[str, str]


# --- packing ---------------------------------------------------------------------------------------------------


def write(packed: Packed, state: Path, folder: Path) -> dict[str, str]:
    """Write the packs of a report into its folder, and return their hashes by name."""
    hashes = {}
    bare = msgspec.structs.replace(packed, records=tuple(map(_bare, packed.records)))
    for number, content in enumerate(_packs(bare, state)):
        name = PACK.format(f"-{number + 1}" if number else "")
        write_changed(folder / name, content)
        hashes[name] = sha256(content)
    # An earlier report of more cells may have left packs that the index no longer names.
    for path in folder.glob(PACK.format("*")):
        if path.name not in hashes:
            path.unlink()
    return hashes


def write_index(folder: Path, index: Index) -> None:
    """Write the index of a report."""
    content = msgspec.json.format(msgspec.json.encode(index, order="deterministic"), indent=1)
    write_changed(folder / INDEX, content + b"\n")


def sha256(content: bytes) -> str:
    """Return the SHA-256 of a content, which is its name."""
    return hashlib.sha256(content).hexdigest()


def runs(record: CellRecord) -> tuple[str, ...]:
    """Return the probe runs that a cell was judged by."""
    names = [name for one in record.cases for name in one.runs]
    return tuple(dict.fromkeys([*names, *(record.suite.runs if record.suite else ())]))


def _packs(packed: Packed, state: Path) -> Iterator[bytes]:
    """Yield the packs: records with their texts first, then the arrays of each task."""
    yield from _text_packs(packed, state)
    for arrays in _arrays_by_task(packed, Vault(state)).values():
        yield from _array_packs(arrays, Vault(state))


def _text_packs(packed: Packed, state: Path) -> Iterator[bytes]:
    """Yield the packs of these records; only a pack of a single cell may be larger than `MOST_PACK`."""
    content = _archive(_members(packed, state))
    if len(content) <= MOST_PACK or len(packed.records) == 1:
        yield content
        return
    half = len(packed.records) // 2
    for records in (packed.records[:half], packed.records[half:]):
        yield from _text_packs(msgspec.structs.replace(packed, records=records), state)


def _arrays_by_task(packed: Packed, vault: Vault) -> dict[str, list[str]]:
    """Return the files of arrays of each task, in the order of the cells.

    They are not divided by cells: each pack begins with whole arrays, from which those of the next releases differ.
    """
    tasks: dict[str, list[str]] = {}
    banks = _shipped_banks()
    for record in packed.records:
        for case in record.cases:
            for name in case.runs:
                arrays = [one for one in vault.arrays(name) if one not in banks]
                tasks.setdefault(_task(case), []).extend(arrays)
    return {task: list(dict.fromkeys(names)) for task, names in tasks.items() if names}


def _array_packs(names: list[str], vault: Vault) -> Iterator[bytes]:
    contents = {name: vault.content(name, MOST_FILE) for name in names}
    packable = {name: content for name, content in contents.items() if array_packs.can_pack(content)}
    members = {f"{CONTENTS}/{name}": content for name, content in contents.items() if name not in packable}
    archive = _archive(members | array_packs.pack(packable), FILTERS_OF_ARRAYS)
    if len(archive) <= MOST_PACK or len(names) == 1:
        yield archive
        return
    half = len(names) // 2
    for some in (names[:half], names[half:]):
        yield from _array_packs(some, vault)


def _bare(record: CellRecord) -> CellRecord:
    """Return a record without the results that were judged from its runs."""
    # A case without runs keeps its phases: there is no evidence from which they could be judged again.
    cases = tuple(replace(one, phases=()) if one.runs else one for one in record.cases)
    tests = record.suite
    if tests and tests.runs:
        tests = PhaseRecord(phase=Phase.SUITE, outcome=Outcome.NOT_REACHED, runs=tests.runs)
    return replace(record, cases=cases, suite=tests, mark=None)


def _members(packed: Packed, state: Path) -> dict[str, bytes]:
    vault, banks = Vault(state), _shipped_banks()
    files = {CELLS: msgspec.json.encode(packed, order="deterministic")}
    for record in packed.records:
        files |= _logs(record, state)
        for name in runs(record):
            files |= {f"{CONTENTS}/{sha}": content for sha, content in vault.contents(name).items() if sha not in banks}
    return files


def _shipped_banks() -> dict[str, bytes]:
    """Return the banks of states that come with the harness, by SHA-256: no pack has to repeat them."""
    contents = (file.read_bytes() for file in sorted((open_matrix.data_folder() / "banks").glob("*.npz")))
    return {sha256(content): content for content in contents}


def _task(case: CaseRecord) -> str:
    """Return the id of a case without the version of its environment: versions of a task share most arrays."""
    return case.case.rpartition("-v")[0] or case.case


def _logs(record: CellRecord, state: Path) -> dict[str, bytes]:
    """Return the logs of steps on the host, and of faults: texts by their path below the state folder."""
    steps = [step.log for step in (record.resolve, record.install) if step]
    phases = [phase.evidence for one in record.cases if not one.runs for phase in one.phases]
    tests = [record.suite.evidence] if record.suite and not record.suite.runs else []
    places = [state / path for path in (*steps, *phases, *tests) if path]
    files = [file for place in places for file in (sorted(place.iterdir()) if place.is_dir() else [place])]
    logs = {}
    for file in files:
        name = file.relative_to(state).as_posix()
        if NAME.fullmatch(name) and file.suffix in {".log", ".txt", ".jsonl"} and file.is_file():
            logs[name] = guarded_files.head(file, MOST_FILE)
    return logs


def _archive(members: Mapping[str, bytes], filters: list[dict[str, int]] = FILTERS) -> bytes:
    """Return a compressed archive, equal for equal members."""
    plain = io.BytesIO()
    with tarfile.open(fileobj=plain, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        # The first bytes are part of the order, so that similar contents lie side by side.
        for name, content in sorted(members.items(), key=lambda pair: (pair[0] != CELLS, pair[1][:12], pair[0])):
            # A bare TarInfo holds no time and no owner, so equal members make equal bytes.
            info = tarfile.TarInfo(name)
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return lzma.compress(plain.getvalue(), format=lzma.FORMAT_XZ, check=lzma.CHECK_SHA256, filters=filters)


# --- unpacking -------------------------------------------------------------------------------------------------


def index(folder: Path) -> Index | None:
    """Return the index of a report, or None if it has none. Raises BadInput."""
    path = folder / INDEX
    try:
        return guarded_files.read_decoded(path, MOST_INDEX, decoding.decoder(Index).decode, follow=True)
    except Absent:
        return None
    except Unreadable as error:
        message = f"{path}: {error}"
        raise BadInput(message) from None


def unpack(folder: Path, report_index: Index, state: Path) -> tuple[Packed, ...]:
    """Unpack the evidence of a report into a state folder, and return the cells in its packs.

    Raises BadInput for a pack that is damaged, or gone.
    """
    unpacked = [_unpacked(folder / name, sha, state) for name, sha in report_index.packs.items()]
    packs = tuple(one for one in unpacked if one)
    vault = Vault(state)
    for bank in _shipped_banks().values():
        vault.keep(bank)
    for path in sorted((folder / "frames").glob(f"*{PICTURE}")):
        vault.keep(guarded_files.read(path, MOST_FRAME))
    for path in sorted((folder / "locks").glob("*")):
        write_atomic(state / "locks" / path.name, guarded_files.read(path, MOST_FRAME))
    # Runs are laid out last: their pictures come from `frames`, not from the packs.
    for packed in packs:
        for record in packed.records:
            for name in runs(record):
                vault.show(name)
    return packs


def _unpacked(path: Path, sha: str, state: Path) -> Packed | None:
    if "/" in path.name or not re.fullmatch(PACK.format(r"(-\d+)?"), path.name):
        message = f"{path}: is not the name of a pack"
        raise BadInput(message)
    try:
        content = guarded_files.read(path, MOST_UNPACKED, follow=True)
        if sha256(content) != sha:
            message = "it is not the pack that the index names"
            raise Unreadable(message)
        with raise_unreadable():
            return _extract(content, state)
    except Unreadable as error:
        message = f"{path}: {error}"
        raise BadInput(message) from None


def _extract(content: bytes, state: Path) -> Packed | None:
    """Unpack one pack and return its records; a pack of arrays alone has none."""
    vault, packed, arrays = Vault(state), None, dict[str, bytes]()
    for name, member in members(content):
        if name == CELLS:
            packed = decoding.decoder(Packed).decode(member)
        elif name.startswith(CONTENTS):
            if vault.keep(member) != name.rpartition("/")[2]:
                message = f"{name} is not the content of that name"
                raise Unreadable(message)
        elif name.startswith((f"{array_packs.FILES}/", f"{array_packs.ARRAYS}/")):
            arrays[name] = member
        else:
            write_atomic(state / name, member)
    for file in array_packs.unpack(arrays).values():
        vault.keep(file)
    if packed is None and not arrays:
        message = f"there is no {CELLS} in it"
        raise Unreadable(message)
    return packed


def members(content: bytes) -> Iterable[tuple[str, bytes]]:
    """Yield the members of an archive. Raises Unreadable for more or other members than a pack may have."""
    plain = lzma.LZMADecompressor(memlimit=1 << 30).decompress(content, MOST_UNPACKED)
    # `r:` refuses a second compression inside, to which the limit above would not apply.
    with tarfile.open(fileobj=io.BytesIO(plain), mode="r:") as archive:
        for number, member in enumerate(archive):
            if number > MOST_MEMBERS or not member.isreg() or not NAME.fullmatch(member.name):
                message = f"{member.name[:100]!r} is no part of a pack"
                raise Unreadable(message)
            file = archive.extractfile(member)
            yield member.name, file.read() if file else b""
