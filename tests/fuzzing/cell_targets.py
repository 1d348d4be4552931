"""Fuzzes the files that cells and caches leave: replies, frames, metadata of packages, records of the state.

Each is read as a run reads it. It may be refused; any exception is a fault of ours.
"""

from __future__ import annotations

import io
import json
import random
import re
from pathlib import Path

import msgspec
import numpy as np
from fuzzing.mutating import content, mutate, mutate_json
from fuzzing.targets import Target

from harness.judging import failure_texts
from harness.judging.runs.check import Ending, check_record, side_findings
from harness.machine.store import InstallResult, Store
from harness.model import (
    Artifact,
    Case,
    CaseRecord,
    Cell,
    CellRecord,
    CheckRecord,
    Lock,
    Outcome,
    Phase,
    PhaseRecord,
    Pin,
    Question,
    Step,
)
from harness.model.hostile_data import Unreadable
from harness.packages.environments import environment_damage, site_packages
from harness.probes import thumbnails, wire
from harness.reports.issue import upstream
from harness.standalone.failures.lines import normalise

ENDING = Ending(exit_code=1, stacks="Fatal Python error: Segmentation fault\n")
RAISED = {"type": "ValueError", "message": "wrong", "traceback": "Traceback ...\nValueError: wrong", "blame": "library"}
GONE = [{"pid": 77, "exit_code": 1}]
WHERE = {"call": "reset()", "value": "an observation", "path": "'x'"}
OBSERVED = {
    "code": "value.shape",
    "at": 3,
    "got": "(2,)",
    "promised": "(3,)",
    "data": {"where": WHERE, "promise": "space"},
}
CHECK = {"kind": "check", "outcome": "passed", "seconds": 1.5, "raised": None, "observed": None, "workers": []}
RECORDS: list[dict[str, object]] = [
    {"kind": "hello", "python": "3.9.1", "implementation": "CPython", "executable": "/python"},
    {"kind": "start", "check": "single.loop"},
    {"kind": "finding", "check": "single.space", "level": "warning", "observed": OBSERVED},
    {**CHECK, "check": "single.loop", "facts": {"trajectory": ["ab", "cd"], "gl": {"renderer": "x"}}},
    {"kind": "start", "check": "vector.async.fork"},
    {**CHECK, "check": "vector.async.fork", "outcome": "failed", "raised": RAISED, "facts": {}, "workers": GONE},
    {"kind": "start", "check": "single.solver"},
    {**CHECK, "check": "single.solver", "outcome": "skipped", "observed": {**OBSERVED, "data": {}}, "facts": {}},
    {"kind": "start", "check": "single.contact"},
    {**CHECK, "check": "single.contact", "outcome": "failed", "observed": OBSERVED, "facts": {}},
    {"kind": "start", "check": "render.rgb_array"},
    {"kind": "frame", "check": "render.rgb_array", "which": "first", "path": "render.rgb_array-first.npy"},
    {"kind": "end", "modules": ["bootstrap.py"], "versions": {"numpy": "2.0.0"}},
]
CHECK_NAMES = {str(one["check"]) for one in RECORDS if one["kind"] == "start"}
WORKER: list[dict[str, object]] = [
    {"kind": "reached", "check": "vector.async.fork", "stage": "step"},
    {"kind": "raised", "check": "vector.async.fork", "raised": RAISED, "observed": None},
]
METADATA = (
    "Metadata-Version: 2.1\nName: hx\nVersion: 1.0\nRequires-Python: >=3.8\nRequires-Dist: numpy>=1.26\n"
    'Requires-Dist: mujoco[a,b]>=3; extra == "x" and python_version < "4"\nProvides-Extra: x\n\nText.\n'
)
RECORD = "hx.py,sha256=47DEQpj8HBSa-_TImW-5JCeuQeRkm5NMpJWZG3hSuFU,0\nhx/a.so,,\nhx-1.0.dist-info/RECORD,,\n"
CELL = Cell(
    id="m/a",
    matrix="m",
    axes={"python": "3.11"},
    python="3.11",
    question=Question(requirements=("numpy<2",)),
    environment={},
    cases=(Case(id="ant", env="Ant-v5", api="gymnasium"),),
)
LOOP = CheckRecord(check="single.loop", outcome=Outcome.PASSED)
CASE = CaseRecord(
    case="ant",
    env="Ant-v5",
    api="gymnasium",
    required=(),
    phases=(PhaseRecord(phase=Phase.SINGLE, outcome=Outcome.PASSED, checks=(LOOP,)),),
)
ARTIFACT = Artifact(filename="numpy-1.26.4-cp311-cp311-linux_x86_64.whl", sha256="0" * 64, source="https://x.test/a")
PIN = Pin(name="numpy", version="1.26.4", artifact=ARTIFACT, hashes=("0" * 64,))
STORED: dict[str, object] = {
    "locks/ab/cd.json": Lock(pins=(PIN,), requirements="numpy==1.26.4\n", sha256="0" * 64, instant=None),
    "steps/ab/cd.json": Step(phase=Phase.RESOLVE, outcome=Outcome.FAILED, decisive="no numpy", log="evidence/a/log"),
    "installed/ab/cd.json": InstallResult(key="e", versions={"numpy": "1.26.4"}, modules={"numpy": ("numpy",)}),
    "cells/here/m/a.json": CellRecord(cell=CELL, machine="here", cases=(CASE,), measured="2026-11-21T12:00:00Z"),
}
"""A record of each kind that a state folder keeps, by its path there."""


def jsonl(records: list[dict[str, object]], pid: int) -> str:
    """Return records as a cell writes them."""
    return "".join(json.dumps({"seq": number, "pid": pid, **one}) + "\n" for number, one in enumerate(records))


def damage_bytes(whole: bytes, chance: random.Random) -> bytes:
    """Return bytes with one to four of them changed, cut out, doubled, or in another place."""
    data = bytearray(whole)
    for _ in range(chance.randrange(1, 5)):
        place, length = chance.randrange(len(data) + 1), chance.choice((1, 1, 2, 8, 64))
        piece = bytes(data[place : place + length])
        match chance.randrange(5):
            case 0:
                data[place : place + length] = chance.randbytes(length)
            case 1:
                del data[place : place + length]
            case 2:
                data[place:place] = piece * chance.choice((1, 2, 1000))
            case 3:
                data[place:place] = chance.choice((b"(", b"-", b"9", b"\0", b"\n", b"PK\3\4")) * chance.choice(
                    (1, 5000)
                )
            case _ if piece:
                data[place] ^= 1 << chance.randrange(8)
    return bytes(data)


def _reply(chance: random.Random) -> list[str]:
    lines = jsonl(RECORDS, 7).splitlines(keepends=True)
    place = chance.randrange(len(lines))
    lines[place] = mutate_json([lines[place]], chance) + "\n" * (chance.random() < 0.9)
    whole = "".join(lines) if chance.random() < 0.8 else mutate(["".join(lines)], chance)
    Path("reply.jsonl").write_bytes(content(whole, chance))
    worker = jsonl(WORKER, 77)
    worker = mutate([worker], chance) if chance.random() < 0.3 else worker
    Path("worker-77.jsonl").write_bytes(content(worker, chance))
    return ["reply"]


def _read_reply(words: list[str]) -> int:
    whole = Path("reply.jsonl").read_bytes()
    files = {"worker-77.jsonl": Path("worker-77.jsonl").read_bytes(), "worker-77.txt": whole[:1000]}
    reply = wire.read_reply(whole.splitlines(keepends=True), files)
    for check in (one for one in reply.checks if one.check in CHECK_NAMES):
        record = check_record(check, ENDING, {})
        normalise(record.decisive or "", {"/python": "$ENV"})
        msgspec.json.decode(msgspec.json.encode(record))
    list(side_findings(reply, ENDING, wire.followers_of(wire.FOLLOWERS)))
    text = whole.decode("utf-8", "replace")
    list(failure_texts.extract_texts({"reply.jsonl": text, "log.txt": text}, Phase.SINGLE))
    upstream.excerpt({"reply.jsonl": text}, "vector.async.fork", None)
    return 2 if reply.problems else 0


def _frame(chance: random.Random) -> list[str]:
    stream = io.BytesIO()
    shape = chance.choice(((4, 6, 3), (1, 1, 3), (64, 48, 3), (4, 6), (4, 6, 4)))
    array = np.zeros(shape, chance.choice((np.uint8, np.uint8, np.uint8, np.float32, np.int64)))
    np.save(stream, array if chance.random() < 0.7 else np.asfortranarray(array))
    whole = stream.getvalue()
    if chance.random() < 0.3:
        numbers = re.sub(rb"\d+(?=[,)])", lambda _: str(chance.choice((0, -1, 3, 10**6, 10**30))).encode(), whole[:128])
        whole = numbers + whole[128:]
    Path("frame.npy").write_bytes(damage_bytes(whole, chance) if chance.random() < 0.9 else whole)
    return ["frame"]


def _keep_frame(words: list[str]) -> int:
    return 0 if thumbnails.thumbnail(Path("frame.npy").read_bytes()) else 2


def _metadata(chance: random.Random) -> list[str]:
    folder = Path("env/lib/python3.11/site-packages/hx-1.0.dist-info")
    folder.mkdir(parents=True)
    for name, text in (("METADATA", METADATA), ("RECORD", RECORD)):
        whole = (
            content(mutate([text], chance), chance) if chance.random() < 0.7 else damage_bytes(text.encode(), chance)
        )
        (folder / name).write_bytes(whole)
    (folder.parent / "hx.py").touch()
    return ["env"]


def _read_metadata(words: list[str]) -> int:
    environment = Path("env").absolute()
    list(environment_damage.find_damage(environment, thorough=True))
    environment_damage.replacing(environment)
    try:
        site_packages.versions(environment)
        site_packages.describe(environment, ["numpy"])
        site_packages.requiring(environment, "numpy")
    except Unreadable:
        return 2
    return 0


def _stored(chance: random.Random) -> list[str]:
    path = chance.choice(list(STORED))
    seeds = [msgspec.json.encode(STORED[path]).decode()]
    seed = mutate_json(seeds, chance) if chance.random() < 0.7 else mutate(seeds, chance)
    file = Path("state", path)
    file.parent.mkdir(parents=True)
    file.write_bytes(content(seed, chance))
    return ["state"]


def _read_stored(words: list[str]) -> int:
    store = Store(Path("state").absolute())
    records = (*store.cells(), store.load_cell("here", CELL), store.read_summary("here", CELL))
    return 0 if any((store.load_lock("abcd"), store.load_installed("abcd"), *records)) else 2


CELL_TARGETS = {
    target.name: target
    for target in (
        Target(name="replies", make=_reply, run=_read_reply),
        Target(name="frames", make=_frame, run=_keep_frame),
        Target(name="metadata", make=_metadata, run=_read_metadata),
        Target(name="stored records", make=_stored, run=_read_stored),
    )
}
