"""Test the files beside a report."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest
from builders import case, record

from harness.machine import store
from harness.machine.store import Store
from harness.model import CaseRecord, Phase
from harness.reports import publishing


def case_with_frame(opened: Store, name: str, picture: bytes) -> CaseRecord:
    """Return a case of the environment `ant` with one frame, measured at a time of its own."""
    frame = opened.evidence(name) / "render.rgb_array-first.png"
    frame.write_bytes(picture)
    os.utime(frame, (len(name), len(name)))
    tried = case("pppp", "ant")
    phases = (
        replace(phase, frames=(opened.relative(frame),) if phase.phase is Phase.RENDER else ())
        for phase in tried.phases
    )
    return replace(tried, phases=tuple(phases))


def test_equal_frames_are_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames of the same case that are equal are named alike and written once, others apart."""
    opened, written = Store(tmp_path / "state"), []
    write = store.write_atomic
    monkeypatch.setattr(store, "write_atomic", lambda path, content: (written.append(path.name), write(path, content)))
    cases = [
        case_with_frame(opened, name, picture) for name, picture in (("a", b"one"), ("bb", b"one"), ("ccc", b"two"))
    ]

    locate = publishing.place([record(tried) for tried in cases], opened, tmp_path / "report")
    names = [locate(f"evidence/{name}/render.rgb_array-first.png") for name in ("a", "bb", "ccc")]

    assert names[0] == names[1] == "frames/ant--render.rgb_array-first--7692c3ad.png"
    assert names[2] != names[0]
    assert [(tmp_path / "report" / name).read_bytes() for name in names] == [b"one", b"one", b"two"]
    assert sorted(written) == sorted({Path(name).name for name in names})


def test_the_copy_of_a_reply_has_no_long_lists_of_numbers(tmp_path: Path) -> None:
    """A report's folder holds what a reader needs; the numbers stay in the state folder and in the pack."""
    source = tmp_path / "evidence" / "1"
    source.mkdir(parents=True)
    reply = b'{"check": "single.loop", "facts": {"values": {"entries": [[1.5]]}, "exercised": ["mujoco"]}}\n'
    others = b'{"kind": "hello", "pid": 2}\nno json at all\n{"facts": 3}\n'
    (source / "reply.jsonl").write_bytes(others + reply)

    assert publishing.copy_file(source, tmp_path / "copy")

    copied = (tmp_path / "copy" / "reply.jsonl").read_bytes()
    assert copied == others + b'{"check":"single.loop","facts":{"exercised":["mujoco"]}}\n'
    assert (source / "reply.jsonl").read_bytes() == others + reply
