"""Test the files beside a report."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from builders import case, record

from harness.machine import store
from harness.machine.store import Store
from harness.model import CaseRecord, Phase, replace
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


def test_the_copy_of_a_reply_has_what_a_reader_needs(tmp_path: Path) -> None:
    """The copy beside a report holds failures and findings; numbers and all that passed stay in the pack."""
    source = tmp_path / "evidence" / "1"
    source.mkdir(parents=True)
    failed = (
        b'{"kind": "check", "check": "single.loop", "outcome": "failed", "facts": {"values": [1.5], "gl": "egl"}}\n'
    )
    imported = (
        b'{"kind": "check", "check": "import.modules", "outcome": "passed", "facts": {"seconds": {"mujoco": 1}}}\n'
    )
    others = b'{"kind": "hello", "pid": 2}\n{"kind": "finding", "facts": {}}\nno json at all\n{"facts": 3}\n'
    gone = (
        b'{"kind": "start", "check": "single.loop"}\n{"kind": "check", "check": "single.loop", "outcome": "passed"}\n'
    )
    end = b'{"kind": "end", "modules": ["api_gym.py"], "versions": {"gym": "0.21.0"}}\n'
    (source / "reply.jsonl").write_bytes(gone + imported + others + failed + end)

    assert publishing.copy_file(source, tmp_path / "copy")

    copied = (tmp_path / "copy" / "reply.jsonl").read_bytes()
    shown = b'{"kind":"check","check":"single.loop","outcome":"failed","facts":{"gl":"egl"}}\n'
    assert copied == imported + others + shown + b'{"kind":"end","versions":{"gym":"0.21.0"}}\n'
    assert (source / "reply.jsonl").read_bytes() == gone + imported + others + failed + end


def test_the_copy_of_a_long_log_lacks_its_middle(tmp_path: Path) -> None:
    """A long log of evidence keeps its two ends, and a copy of the copy is the same; a lock is always whole."""
    source = tmp_path / "evidence"
    source.mkdir()
    text = b"first\n" + b"x" * 100_000 + b"\nlast"
    (source / "log.txt").write_bytes(text)

    assert publishing.copy_file(source, tmp_path / "copy")
    assert publishing.copy_file(tmp_path / "copy", tmp_path / "again")
    assert publishing.copy_file(source / "log.txt", tmp_path / "lock.txt")

    copied = (tmp_path / "copy" / "log.txt").read_bytes()
    assert copied.startswith(b"first\n")
    assert copied.endswith(b"\nlast")
    assert b"\n[... 92011 bytes left out here ...]\n" in copied
    assert (tmp_path / "again" / "log.txt").read_bytes() == copied
    assert (tmp_path / "lock.txt").read_bytes() == text
