"""Ask for locks in end-to-end tests, and check the answers."""

from __future__ import annotations

from http.server import BaseHTTPRequestHandler

from harness.model import IndexSettings, Interpreter, Lock, Outcome, Phase, Question, Step
from harness.packages.environments import environments
from harness.packages.environments.environments import Environment
from harness.packages.step_failed import StepFailed


def question(*requirements: str, index: IndexSettings, **more: object) -> Question:
    """Return a question about these requirements with a cutoff of 2026-01-01; `more` sets other fields."""
    return Question(requirements=requirements, index=index, **{"snapshot": "2026-01-01T00:00:00Z", **more})  # type: ignore[arg-type]


def expect_lock(answer: Lock | Step) -> Lock:
    """Return the answer, which must be a lock."""
    assert isinstance(answer, Lock), answer
    return answer


def install(lock: Lock, python: Interpreter, needs: Question) -> Environment | Step:
    """Make the environment of a lock, or return the step that failed."""
    try:
        return environments.ensure(lock, python, needs)
    except StepFailed as failed:
        return failed.step


def expect_failure(answer: object) -> tuple[Phase, Outcome, str | None]:
    """Return phase, outcome and decisive line of the answer, which must be a step and not a lock."""
    assert isinstance(answer, Step), answer
    return answer.phase, answer.outcome, answer.decisive


def send(handler: BaseHTTPRequestHandler, code: int, body: bytes = b"", *, announced: int | None = None) -> None:
    """Send a page; `announced` replaces the true length of the body in the header."""
    handler.send_response(code)
    handler.send_header("Content-Type", "text/html")
    handler.send_header("Content-Length", str(len(body) if announced is None else announced))
    handler.end_headers()
    handler.wfile.write(body)
