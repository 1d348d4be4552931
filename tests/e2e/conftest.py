"""Share fixtures: an empty cache and state, no settings of this machine's user, a wheelhouse of fakes."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest
import wheelhouse as fakes
from supervised import marker, python, sandbox

from harness.machine import interpreters
from harness.model import IndexSettings, Interpreter

__all__ = ["marker", "python", "sandbox"]


@pytest.fixture(autouse=True, scope="session")
def terminal_signals() -> None:
    """Let commands start with the signals that a terminal gives, though the suite itself runs under `nohup`."""
    for number in (signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Set an empty cache, an empty state, and no index settings but those of the test; return the test's folder."""
    for name in os.environ:
        if name.startswith(("UV_", "PIP_")):
            monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("UV_HTTP_RETRIES", "0")
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    return tmp_path


@pytest.fixture(scope="session")
def wheelhouse(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with all fakes but those named torch, as wheels and sdists."""
    names = [path.parent.name for path in fakes.FAKES.glob("*/fake.toml") if not path.parent.name.startswith("torch")]
    return fakes.make(tmp_path_factory.mktemp("wheelhouse"), *names)


@pytest.fixture
def host() -> Interpreter:
    """Return the Python that runs the tests."""
    interpreter = interpreters.find("host")
    assert interpreter
    return interpreter


@pytest.fixture
def other() -> Interpreter:
    """Return Python 3.9, or skip the test where it is missing."""
    interpreter = interpreters.find("3.9")
    if interpreter is None:
        pytest.skip("unavailable: python3.9")
    return interpreter


@pytest.fixture
def offline_index(wheelhouse: Path) -> IndexSettings:
    """Return index settings that offer the fakes and nothing else."""
    return IndexSettings(no_index=True, find_links=(str(wheelhouse),))


@pytest.fixture
def serve() -> Iterator[Callable[[Callable[[BaseHTTPRequestHandler], None]], str]]:
    """Yield a function that starts an index on the loopback and returns its address; `answer` writes each response."""
    servers = []

    def start(answer: Callable[[BaseHTTPRequestHandler], None]) -> str:
        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                answer(self)

            do_HEAD = do_GET  # noqa: N815  (the name is the server's)

            def log_message(self, *_: object) -> None:
                pass

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_address[1]}/simple"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()
