"""Cells that look measured: a matrix of any size, and a store that holds what a run of it would have written."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image

from harness.judging.runs.fold import Folded, add_run
from harness.judging.runs.todo import todo
from harness.machine import interpreters, this_machine
from harness.machine.store import InstallResult, Store, digest, question_key
from harness.model import Artifact, Cell, CellRecord, Interpreter, Lock, Pin, Question
from harness.model.vocabulary import APIS
from harness.probes import wire
from harness.probes.evidence import LOG, REPLY, ProbeRun, Request, RunEnd
from harness.probes.vault import keep_files
from harness.running import case_run
from harness.running.scheduler import Observer, Runner, Settings
from harness.running.scheduler.shared_environment import Pool

PER_LOCK = 5
"""Cells that share a question: they differ in a variable."""

PACKAGES = 25
"""Packages of a lock, about as many as gymnasium with MuJoCo and rendering needs."""

_picture = BytesIO()
Image.new("RGB", (48, 32)).save(_picture, "PNG")
FRAME = _picture.getvalue()

PICTURE = "frame-first"

FACTS = {
    "action_space": "Box(-1.0, 1.0, (8,), float32)",
    "observation_space": "Box(-inf, inf, (27,), float64)",
    "trajectory": ["0" * 12] * 101,
}
"""Of a loop of 100 steps."""

INSTANT = "2026-11-20T23:59:59Z"


def matrix_text(count: int) -> str:
    """Return a matrix of `count` cells on this Python: questions by a version, cells of one question by a variable."""
    versions = ", ".join(f'"1.{number}"' for number in range(-(-count // PER_LOCK)))
    values = ", ".join(f'"{number}"' for number in range(PER_LOCK))
    return f"""
snapshot = {INSTANT[:10]}
requirements = ["fake-simulator"]
index = {{ no_index = true, find_links = ["wheels"] }}
[axes]
python = ["host"]
fake-simulator = [{versions}]
FAKE_SEED = {{ variable = [{values}] }}
[[cases]]
env = "Fake-v0"
api = "gymnasium"
[[cases]]
env = "Fake-v1"
api = "gymnasium"
"""


def fill(cells: Sequence[Cell], opened: Store, observer: Observer) -> None:
    """Store locks, installs, results, logs and frames of all cells, as measured and passed."""
    runner = Runner(opened, Settings(), observer)
    host = interpreters.find("host")
    assert host
    locks: dict[str, Lock] = {}
    for cell in cells:
        key = question_key(cell.question, host)
        if key not in locks:
            locks[key] = lock(cell.question, host)
            opened.save_lock(key, locks[key])
        _measured(cell, runner, locks[key], host)


def lock(question: Question, interpreter: Interpreter) -> Lock:
    """Return a lock with the packages that were asked for and others beside them."""
    named = question.requirements[-1].replace(" ", "").partition("==")
    versions = {named[0]: named[2] or "1.0"} | {f"package-{number}": "1.2.3" for number in range(PACKAGES - 1)}
    pins = tuple(_pin(name, version) for name, version in sorted(versions.items()))
    text = "".join(f"{pin.name}=={pin.version} \\\n    --hash=sha256:{pin.hashes[0]}\n" for pin in pins)
    mark = hashlib.sha256(text.encode()).hexdigest()
    return Lock(pins=pins, requirements=text, sha256=mark, instant=question.snapshot or INSTANT)


def _pin(name: str, version: str) -> Pin:
    sha256 = hashlib.sha256(f"{name} {version}".encode()).hexdigest()
    file = f"{name.replace('-', '_')}-{version}-py3-none-any.whl"
    artifact = Artifact(filename=file, sha256=sha256, source=f"file:///{file}", size=1000, uploaded=INSTANT)
    return Pin(name=name, version=version, artifact=artifact, hashes=(sha256,))


def _measured(cell: Cell, runner: Runner, lock: Lock, interpreter: Interpreter) -> None:
    pool = Pool(runner, cell, lock, interpreter)
    installation = InstallResult(
        key=digest("environment", lock.sha256),
        versions=lock.versions,
        modules={name: (name.replace("-", "_"),) for name in lock.versions},
        speaking=dict.fromkeys(APIS, ()),
        seconds=1.0,
    )
    runner.store.save_installed(pool.key, installation)
    record = CellRecord(
        cell=cell,
        machine=this_machine.facts().id,
        python=interpreter.version,
        key=installation.key,
        supplied=this_machine.choose_variables(cell.environment),
    )
    context = runner._context(record, pool, None)
    vault = context.laboratory.vault
    picture = vault.keep(FRAME)
    for case in cell.cases:
        case_plan, folded = context.plan_case(case), Folded()
        while request := todo(case_plan, folded):
            texts = {LOG: f"{cell.id} {case.id}\n".encode(), REPLY: _reply(request)}
            files = {**keep_files(vault, texts), f"{PICTURE}.png": picture}
            names = (*request.limits, *request.followers)
            run = ProbeRun(
                request=request,
                program={name: case_plan.program[name] for name in names},
                end=RunEnd(exit_code=0, seconds=1.0, peak_mb=100),
                host=context.laboratory.host,
                files=files,
                measured=INSTANT,
            )
            folded = add_run(case_plan, folded, vault.reading(vault.put(run, case_run.claim(context, case))))


def _reply(request: Request) -> bytes:
    """Return the reply of a probe in which all passed."""
    python = {"python": platform.python_version(), "implementation": "CPython", "executable": "$ENV/bin/python"}
    records: list[dict[str, Any]] = [{"kind": "hello", **python}]
    for check in (name for led in request.limits for name in (led, *wire.FOLLOWERS.get(led, ()))):
        facts = FACTS if check in {"single.loop", "single.repeat"} else {}
        ended = {"outcome": "passed", "seconds": 0.1, "raised": None, "observed": None, "workers": [], "facts": facts}
        records.append({"kind": "start", "check": check})
        if check == "render.rgb_array":
            records.append({"kind": "frame", "check": check, "which": "first", "path": f"{PICTURE}.npy"})
        records.append({"kind": "check", "check": check, **ended})
    records.append({"kind": "end", "modules": [], "versions": {}})
    lines = (json.dumps({**record, "seq": number, "pid": 2}) for number, record in enumerate(records))
    return "".join(f"{line}\n" for line in lines).encode()


def write_matrix(folder: Path, count: int) -> Path:
    """Write a matrix of so many cells and the empty wheels that it needs, and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"cells{count}.toml"
    path.write_text(matrix_text(count))
    (folder / "wheels").mkdir(exist_ok=True)
    for number in range(-(-count // PER_LOCK)):  # by their names a run sees that what is asked for exists
        (folder / "wheels" / f"fake_simulator-1.{number}-py3-none-any.whl").touch()
    return path
