"""Faults of package indexes: a real little index on the loopback that misbehaves, and is mended."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

from benchmarks.faults import Desk, FaultResult, fault

SECTION = "whose fault"
MATRIX = """
requirements = ["odd"]
index = {{ default = "{address}" }}
[axes]
python = ["host"]
[axes.which.odd]
cases = [{{ id = "odd", imports = ["odd"], checks = ["import"] }}]
"""
DAY = 'data-upload-time="2020-01-01T12:00:00Z"'
PAGE, FILE = "page", "file"
IMPORTED = {"not_run"}
"""Only the import is tried: that is no verdict, but an import that fails is one."""

NOT_BLAMED = frozenset({"inconclusive", "not_run"})


@dataclass
class Index:
    """Wheels by their file's name; `trouble` answers in the place of the index, or tells by False that it does not.

    `hashes` are told on the pages in the place of the right ones.
    """

    files: dict[str, bytes] = field(default_factory=dict)
    hashes: dict[str, str | None] = field(default_factory=dict)
    trouble: Callable[[BaseHTTPRequestHandler, str, str], bool] = lambda *_: False
    request_count: int = 0

    def answer(self, handler: BaseHTTPRequestHandler) -> None:
        """Answer one request."""
        self.request_count += 1
        name = handler.path.strip("/").rpartition("/")[2]
        kind = FILE if handler.path.startswith("/files/") else PAGE
        if self.trouble(handler, kind, name):
            return
        if kind == FILE:
            send(handler, self.files[name.removesuffix(".metadata")]) if name in self.files else send(handler, b"", 404)
            return
        listed = [file for file in sorted(self.files) if file.partition("-")[0] == name]
        links = "".join(f'<a href="/files/{file}{self.hash(file)}" {DAY}>{file}</a>' for file in listed)
        send(handler, f"<!DOCTYPE html><html><body>{links}</body></html>".encode(), 200 if listed else 404)

    def hash(self, file: str) -> str:
        """Return the hash of a file as its page tells it."""
        digest = self.hashes.get(file, hashlib.sha256(self.files[file]).hexdigest())
        return f"#sha256={digest}" if digest else ""


def send(
    handler: BaseHTTPRequestHandler, body: bytes, code: int = 200, kind: str = "text/html", **headers: str
) -> bool:
    """Send one answer."""
    handler.send_response(code)
    handler.send_header("Content-Type", kind)
    for name, value in {"Content_Length": str(len(body)), **headers}.items():
        handler.send_header(name.replace("_", "-"), value)
    handler.end_headers()
    if handler.command == "GET":
        handler.wfile.write(body)
    return True


@contextmanager
def serve_index(desk: Desk) -> Iterator[tuple[Index, str]]:
    """Serve an index that has `odd`, which requires `dep`; its matrix."""
    index = Index()
    for wheel in (
        desk.shelve({"odd.py": "import dep\n"}, name="odd", requires=["dep"]),
        desk.shelve({"dep.py": "VALUE = 1\n"}, name="dep"),
    ):
        index.files[wheel.name] = wheel.read_bytes()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            index.answer(self)

        do_HEAD = do_GET  # noqa: N815 - the name is the server's

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield index, MATRIX.format(address=f"http://127.0.0.1:{server.server_address[1]}/simple")
    finally:
        server.shutdown()
        server.server_close()


def run_with_trouble(
    desk: Desk, trouble: Callable[[BaseHTTPRequestHandler, str, str], bool], *, hurt: frozenset[str]
) -> FaultResult:
    """Run while the index misbehaves, and again once it is mended."""
    with serve_index(desk) as (index, text):
        matrix = desk.matrix("m", text)
        index.trouble = trouble
        first = desk.check_verdicts(desk.measure(matrix, UV_HTTP_TIMEOUT="10"), odd=set(hurt))
        index.trouble = Index().trouble
        second = desk.check_verdicts(desk.measure(matrix), odd=IMPORTED)
    return FaultResult(f"{first.what}; mended: {second.what}", first.held and second.held)


def on(kind: str, send_it: Callable[[BaseHTTPRequestHandler], object], name: str = "") -> Callable[..., bool]:
    """Misbehave for pages or files only, and only for those of this name."""

    def trouble(handler: BaseHTTPRequestHandler, what: str, which: str) -> bool:
        if what != kind or not which.startswith(name):
            return False
        send_it(handler)
        return True

    return trouble


def cut(handler: BaseHTTPRequestHandler) -> None:
    """Promise more than is sent."""
    send(handler, b"PK\x03\x04", Content_Length="5000")
    handler.close_connection = True


def flaky(share: int) -> Callable[[BaseHTTPRequestHandler, str, str], bool]:
    """Fail the first of so many requests."""
    seen: list[str] = []

    def trouble(handler: BaseHTTPRequestHandler, _: str, __: str) -> bool:
        seen.append(handler.path)
        return len(seen) % share == 1 and send(handler, b"busy", 503)

    return trouble


LOGIN = b"<!DOCTYPE html><html><body><form>Please log in to the network</form></body></html>"
TROUBLES: dict[str, tuple[str, Callable[[BaseHTTPRequestHandler, str, str], bool]]] = {
    "a": ("answers every page with 500", on(PAGE, lambda handler: send(handler, b"oops", 500))),
    "b": ("answers now and then with 503", flaky(3)),
    "c": ("answers every page with 403", on(PAGE, lambda handler: send(handler, b"no", 403))),
    "d": ("answers every page with 401", on(PAGE, lambda handler: send(handler, b"no", 401))),
    "e": ("shows a login page for every page", on(PAGE, lambda handler: send(handler, LOGIN))),
    "f": (
        "sends broken JSON",
        on(PAGE, lambda handler: send(handler, b'{"files": [', kind="application/vnd.pypi.simple.v1+json")),
    ),
    "g": ("sends empty pages", on(PAGE, lambda handler: send(handler, b""))),
    "h": ("sends random bytes", on(PAGE, lambda handler: send(handler, bytes(range(256)) * 9))),
    "i": ("redirects in a circle", on(PAGE, lambda handler: send(handler, b"", 302, Location=handler.path))),
    "j": (
        "redirects to nowhere",
        on(PAGE, lambda handler: send(handler, b"", 302, Location="http://127.0.0.1:1/simple/x/")),
    ),
    "k": ("has no file that its page lists", on(FILE, lambda handler: send(handler, b"", 404))),
    "l": ("answers every file with 500", on(FILE, lambda handler: send(handler, b"oops", 500))),
    "m": ("cuts every file", on(FILE, cut)),
    "n": ("sends empty files", on(FILE, lambda handler: send(handler, b""))),
    "o": ("shows a login page for every file", on(FILE, lambda handler: send(handler, LOGIN))),
    "p": ("sends random bytes for every file", on(FILE, lambda handler: send(handler, bytes(range(256)) * 9))),
    "q": ("closes every connection without a word", on(PAGE, lambda handler: handler.connection.close())),
    "r": ("answers every page with 429", on(PAGE, lambda handler: send(handler, b"slow down", 429))),
}
"""What an index does, which is no package's fault."""


def declare() -> None:
    """Declare a fault for each trouble."""
    for letter, (done, trouble) in TROUBLES.items():

        def troublesome(desk: Desk, trouble: Callable[..., bool] = trouble) -> FaultResult:
            """Misbehave, then be mended."""
            return run_with_trouble(desk, trouble, hurt=NOT_BLAMED)

        troublesome.__name__ = f"trouble_{letter}"
        promise = "inconclusive, or works; once it is mended it works"
        fault(f"123{letter}", section=SECTION, done=f"an index {done}", promise=promise, limit=200)(troublesome)


declare()


@fault(
    "123s",
    section=SECTION,
    done="one bit of a file is another than its hash on the page says",
    promise="inconclusive; once it is mended it works",
    limit=200,
)
def flipped_bit(desk: Desk) -> FaultResult:
    """Flip a bit in a file."""
    with serve_index(desk) as (index, text):
        matrix, (name, whole) = desk.matrix("m", text), next(iter(index.files.items()))
        index.hashes[name] = hashlib.sha256(whole).hexdigest()
        index.files[name] = whole[:60] + bytes([whole[60] ^ 1]) + whole[61:]
        first = desk.check_verdicts(desk.measure(matrix), odd={"inconclusive"})
        index.files[name] = whole
        second = desk.check_verdicts(desk.measure(matrix), odd=IMPORTED)
    return FaultResult(f"{first.what}; mended: {second.what}", first.held and second.held)


@fault(
    "124",
    section=SECTION,
    done="the page of a dependency is missing, then it is there",
    promise="unresolvable, which names the package; works once it is there",
    limit=200,
)
def missing_page(desk: Desk) -> FaultResult:
    """Answer 404 for the page of a dependency."""
    trouble = on(PAGE, lambda handler: send(handler, b"", 404), "dep")
    return run_with_trouble(desk, trouble, hurt=frozenset({"unresolvable", "inconclusive"}))


@fault(
    "125",
    section=SECTION,
    done="an index hands out another package's wheel under a name, with that wheel's hash",
    promise="inconclusive; works once it is mended",
    limit=200,
)
def another_wheel(desk: Desk) -> FaultResult:
    """Serve the bytes of another wheel."""
    return mixed_up(desk, right_hash=False)


@fault(
    "125b",
    section=SECTION,
    done="an index hands out another package's wheel under a name, with the right one's hash",
    promise="inconclusive; works once it is mended",
    limit=200,
)
def another_wheel_than_told(desk: Desk) -> FaultResult:
    """Serve the bytes of another wheel below the right hash."""
    return mixed_up(desk, right_hash=True)


def mixed_up(desk: Desk, *, right_hash: bool) -> FaultResult:
    """Measure beside an index that has another wheel's bytes under a name, and again once it is mended."""
    with serve_index(desk) as (index, text):
        matrix = desk.matrix("m", text)
        name, whole = next((name, content) for name, content in index.files.items() if name.startswith("dep"))
        if right_hash:
            index.hashes[name] = hashlib.sha256(whole).hexdigest()
        index.files[name] = desk.shelve({"other.py": ""}, name="other").read_bytes()
        first = desk.check_verdicts(desk.measure(matrix), odd={"inconclusive"})
        index.files[name] = whole
        second = desk.check_verdicts(desk.measure(matrix), odd=IMPORTED)
    return FaultResult(f"{first.what}; mended: {second.what}", first.held and second.held)


@fault(
    "126",
    section=SECTION,
    done="the page tells a wrong hash, then it is mended",
    promise="inconclusive, and the line says how to lock anew; works after that",
    limit=200,
)
def wrong_hash(desk: Desk) -> FaultResult:
    """Tell a wrong hash on the page."""
    with serve_index(desk) as (index, text):
        matrix, name = desk.matrix("m", text), next(iter(index.files))
        index.hashes[name] = "0" * 64
        first = desk.check_verdicts(desk.measure(matrix), odd={"inconclusive"}, says="lock MATRIX --upgrade")
        del index.hashes[name]
        desk.run("lock", matrix, "--upgrade")
        second = desk.check_verdicts(desk.measure(matrix), odd=IMPORTED)
    return FaultResult(f"{first.what}; locked anew: {second.what}", first.held and second.held)


@fault(
    "123t",
    section=SECTION,
    done="the page tells no hash of a file",
    promise="imported: the lock takes the hash of what was downloaded",
    limit=200,
)
def no_hash(desk: Desk) -> FaultResult:
    """Tell no hash on the page."""
    with serve_index(desk) as (index, text):
        matrix = desk.matrix("m", text)
        index.hashes = dict.fromkeys(index.files)
        return desk.check_verdicts(desk.measure(matrix), odd=IMPORTED)
