"""What tests of several tiers share: running the in-cell side with any interpreter."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

import harness
from harness import wire
from harness.model import Case, CheckReply, ProbeReply, ProbeRequest

INCELL = Path(harness.__file__).parent / "incell"


@dataclass(frozen=True, kw_only=True, slots=True)
class Probed:
    """What came of one probe; `returncode` is None when it was ended at the deadline."""

    reply: ProbeReply
    returncode: int | None
    output: str
    folder: Path

    def __getitem__(self, check: str) -> CheckReply:
        return {reply.check: reply for reply in self.reply.checks}[check]

    @property
    def findings(self) -> dict[str, list[str]]:
        """Texts by check."""
        found: dict[str, list[str]] = {}
        for finding in self.reply.findings:
            found.setdefault(finding.check, []).append(finding.text)
        return found


@pytest.fixture
def probe(tmp_path: Path) -> Callable[..., Probed]:
    """Run checks of a case with an interpreter, without the supervisor; modules in `path` can be imported."""

    def run(
        python: str,
        case: Case,
        *,
        path: Path = tmp_path,
        limit: float = 60,
        deadline: float = 60,
        variables: Mapping[str, str] = {},
    ) -> Probed:
        folder = tmp_path / "reply"
        folder.mkdir()
        request = ProbeRequest(
            case=case, checks=case.checks, folder=str(folder), limits=dict.fromkeys(case.checks, limit)
        )
        (tmp_path / "request.json").write_text(wire.request_to_json(request))
        process = subprocess.Popen(
            [python, "-s", "-B", str(INCELL / "bootstrap.py"), str(tmp_path / "request.json")],
            cwd=tmp_path,
            env={"PATH": os.defpath, "HOME": str(tmp_path), "PYTHONPATH": str(path), **variables},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            output, _ = process.communicate(timeout=deadline)
            returncode = process.returncode
        except subprocess.TimeoutExpired:
            returncode = None
        finally:
            _end_session(process.pid)
        if returncode is None:
            output, _ = process.communicate()
        with (folder / "reply.jsonl").open("rb") as lines:
            reply = wire.read_reply(lines, {file.name: file.read_bytes() for file in folder.glob("worker-*")})
        return Probed(reply=reply, returncode=returncode, output=output.decode("utf-8", "replace"), folder=folder)

    return run


def _end_session(leader: int) -> None:
    try:
        os.killpg(leader, signal.SIGKILL)
    except ProcessLookupError:
        return
