"""Share between the tiers of tests: running the in-cell side with any interpreter."""

from __future__ import annotations

import os
import signal
import subprocess
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

import harness
from harness.model import Case, CheckReply, ProbeReply
from harness.packages import index_settings
from harness.probes import wire

os.environ.pop("COLUMNS", None)  # pytest's workers have one; texts of verbs are as wide as they are by themselves

INCELL = Path(harness.__file__).parent / "incell"


@dataclass(frozen=True, kw_only=True, slots=True)
class FinishedProbe:
    """The result of one probe; `returncode` is None when it was ended at the deadline."""

    reply: ProbeReply
    returncode: int | None
    output: str
    folder: Path

    def __getitem__(self, check: str) -> CheckReply:
        return {reply.check: reply for reply in self.reply.checks}[check]

    @property
    def findings(self) -> dict[str, list[str]]:
        """Texts by check."""
        texts: dict[str, list[str]] = {}
        for finding in self.reply.findings:
            texts.setdefault(finding.check, []).append(finding.text)
        return texts


@pytest.fixture
def probe(tmp_path: Path) -> Callable[..., FinishedProbe]:
    """Run checks of a case with an interpreter, without the supervisor; modules in `path` can be imported."""

    def run(
        python: str,
        case: Case,
        *,
        path: Path = tmp_path,
        limit: float = 60,
        deadline: float = 60,
        variables: Mapping[str, str] = {},
    ) -> FinishedProbe:
        folder = tmp_path / "reply"
        folder.mkdir()
        request = wire.request(case, dict.fromkeys(case.checks, limit), folder)
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
        return FinishedProbe(
            reply=reply, returncode=returncode, output=output.decode("utf-8", "replace"), folder=folder
        )

    return run


def _end_session(leader: int) -> None:
    try:
        os.killpg(leader, signal.SIGKILL)
    except ProcessLookupError:
        return


def pytest_configure() -> None:
    """A suite that was started in the background ignores SIGINT, and so would every command that it starts.

    No control is run but where a test names some: what they need would be downloaded. A uv that a fixture calls by
    itself trusts the certificates that the harness finds in the user's settings, so that an empty environment will do.
    """
    os.environ["HARNESS_CONTROLS"] = ""
    certificates = index_settings.settings().certificates
    if certificates:
        os.environ.setdefault("SSL_CERT_FILE", certificates)
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


# --- skips -----------------------------------------------------------------------------------------------------

ALLOWED = "unavailable: "
"""A GPU, a vendor's archive, an interpreter, torch: may be missing anywhere, and is counted."""
MENDABLE = "missing library: "
"""A system library: `.ci/run` installs those, so there none may be missing."""


def skip_reasons(reporter: pytest.TerminalReporter) -> Counter[str]:
    """Print why tests were skipped, and how many for each reason."""
    reports = reporter.stats.get("skipped", [])
    return Counter(str(report.longrepr[2]).removeprefix("Skipped: ") for report in reports)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """A skip without a reason of the two kinds fails everywhere, a missing library where CI could have installed it."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or hasattr(session.config, "workerinput"):
        return
    reasons = skip_reasons(reporter)
    wrong = [reason for reason in reasons if not reason.startswith((ALLOWED, MENDABLE))]
    mendable = [reason for reason in reasons if reason.startswith(MENDABLE)]
    if wrong or (mendable and os.environ.get("CI")):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Count what was not verified here."""
    for reason, count in sorted(skip_reasons(terminalreporter).items()):
        terminalreporter.write_line(f"not verified here: {reason} ({count} tests)")
