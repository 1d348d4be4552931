"""How the end-to-end tests ask for locks, and what they expect of the answers."""

from __future__ import annotations

from http.server import BaseHTTPRequestHandler

from harness.model import IndexSettings, Lock, Outcome, Phase, Question, Step


def question(*requirements: str, index: IndexSettings, **more: object) -> Question:
    """Ask for requirements under a cutoff."""
    return Question(requirements=requirements, index=index, **{"snapshot": "2026-01-01T00:00:00Z", **more})  # type: ignore[arg-type]


def locked(answer: Lock | Step) -> Lock:
    """Expect a lock."""
    assert isinstance(answer, Lock), answer
    return answer


def failed(answer: object) -> tuple[Phase, Outcome, str | None]:
    """Expect a step that did not succeed."""
    assert isinstance(answer, Step), answer
    return answer.phase, answer.outcome, answer.decisive


def send(handler: BaseHTTPRequestHandler, code: int, body: bytes = b"", *, announced: int | None = None) -> None:
    """Answer with a page; `announced` is a length that the body does not have."""
    handler.send_response(code)
    handler.send_header("Content-Type", "text/html")
    handler.send_header("Content-Length", str(len(body) if announced is None else announced))
    handler.end_headers()
    handler.wfile.write(body)
