"""Releases and files from real small indexes: a loopback server, a folder index, a find-links folder."""

import gzip
import hashlib
import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from harness.machine import process
from harness.model import Artifact, IndexSettings
from harness.packages import index
from harness.packages.index import IndexUnreachable, Patience, Release, UnknownPackage
from harness.packages.network_bounds import MOST_PAGE

QUICK = Patience(pauses=(0, 0))
"""Three attempts like everybody's, without the waiting between them."""
BRIEF = Patience(pauses=(0, 0), timeout=(1, 0.5))
releases = partial(index.releases, patience=QUICK)
fetch = partial(index.fetch, patience=QUICK)

JSON_PAGE = {
    "meta": {"api-version": "1.1"},
    "name": "pole",
    "versions": ["1.0", "1.1", "2.0rc1"],
    "files": [
        {
            "filename": "pole-1.0-py3-none-any.whl",
            "url": "../../files/pole-1.0-py3-none-any.whl",
            "hashes": {},
            "size": 1,
            "requires-python": ">=3.7",
            "upload-time": "2024-01-02T03:04:05.678Z",
        },
        {
            "filename": "pole-1.0.tar.gz",
            "url": "../../files/pole-1.0.tar.gz",
            "hashes": {},
            "size": 1,
            "upload-time": "2024-01-01T00:00:00Z",
        },
        {
            "filename": "pole-1.1-cp311-cp311-manylinux_2_17_x86_64.whl",
            "url": "x.whl",
            "hashes": {},
            "size": 1,
            "yanked": "broken",
            "upload-time": "2025-01-01T00:00:00Z",
        },
        {"filename": "pole-2.0rc1.tar.gz", "url": "x.tar.gz", "hashes": {}, "size": 1},
        {"filename": "pole-1.1.exe", "url": "x.exe", "hashes": {}, "size": 1},
    ],
}
HTML_PAGE = """<!DOCTYPE html><html><body>
<a href="../../files/pole-1.0-py3-none-any.whl#sha256=00" data-requires-python="&gt;=3.7"
   data-upload-time="2024-01-02T03:04:05.678Z">pole-1.0-py3-none-any.whl</a>
<a href="../../files/pole-1.0.tar.gz" data-upload-time="2024-01-01T00:00:00Z">pole-1.0.tar.gz</a>
<a href="pole-1.1-cp311-cp311-manylinux_2_17_x86_64.whl" data-yanked="broken"
   data-upload-time="2025-01-01T00:00:00Z">pole-1.1-cp311-cp311-manylinux_2_17_x86_64.whl</a>
<a href="pole-2.0rc1.tar.gz">pole-2.0rc1.tar.gz</a>
</body></html>"""
POLE = (
    Release(
        version="1.0",
        uploaded="2024-01-01T00:00:00Z",
        yanked=False,
        requires_python=">=3.7",
        wheels=("pole-1.0-py3-none-any.whl",),
        sdist=True,
    ),
    Release(
        version="1.1",
        uploaded="2025-01-01T00:00:00Z",
        yanked=True,
        requires_python=None,
        wheels=("pole-1.1-cp311-cp311-manylinux_2_17_x86_64.whl",),
        sdist=False,
    ),
    Release(version="2.0rc1", uploaded=None, yanked=False, requires_python=None, wheels=(), sdist=True),
)
WHEEL = b"a wheel, as far as this server is concerned"
LOGIN = "Basic dXNlcjpzZWNyZXQ="  # user:secret


class Server:
    """A loopback web server; `pages` maps a path to what answers it, `asked` lists the paths that were asked for."""

    def __init__(self) -> None:
        self.pages: dict[str, Callable[[BaseHTTPRequestHandler], None]] = {}
        self.asked: list[str] = []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                outer.asked.append(self.path)
                outer.pages.get(self.path, answer(404))(self)

            def log_message(self, *_: Any) -> None:
                """Print nothing."""

        self._http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.host = f"127.0.0.1:{self._http.server_port}"
        self.url = f"http://{self.host}"
        self._thread = Thread(target=self._http.serve_forever, args=(0.01,))
        self._thread.start()

    def close(self) -> None:
        self._http.shutdown()
        self._thread.join()
        self._http.server_close()


def answer(
    status: int, body: bytes = b"", kind: str = "text/html", *, login: str | None = None, encoding: str = "identity"
) -> Callable[[BaseHTTPRequestHandler], None]:
    """Return a fixed answer, which needs the right login if one is given."""

    def send(handler: BaseHTTPRequestHandler) -> None:
        refused = login is not None and handler.headers["Authorization"] != login
        handler.send_response(401 if refused else status)
        handler.send_header("Content-Type", kind)
        handler.send_header("Content-Encoding", encoding)
        handler.send_header("Content-Length", "0" if refused else str(len(body)))
        handler.end_headers()
        handler.wfile.write(b"" if refused else body)

    return send


def cut_off(handler: BaseHTTPRequestHandler) -> None:
    """Announce more bytes than are sent, then close the connection."""
    handler.send_response(200)
    handler.send_header("Content-Type", "text/html")
    handler.send_header("Content-Length", "1000000")
    handler.end_headers()
    handler.wfile.write(b"<html>")


def drip(handler: BaseHTTPRequestHandler) -> None:
    """Send a little every now and then, and never end."""
    handler.send_response(200)
    handler.send_header("Content-Type", "text/html")
    handler.end_headers()
    with suppress(OSError):
        for _ in range(100):
            handler.wfile.write(b"<a href='x'>x</a>\n")
            time.sleep(0.1)


def in_turn(*answers: Callable[[BaseHTTPRequestHandler], None]) -> Callable[[BaseHTTPRequestHandler], None]:
    """Return the next answer each time, and the last one from then on."""
    left = list(answers)

    def send(handler: BaseHTTPRequestHandler) -> None:
        (left.pop(0) if len(left) > 1 else left[0])(handler)

    return send


@pytest.fixture
def server() -> Iterator[Server]:
    """Yield a server without any page."""
    running = Server()
    yield running
    running.close()


@pytest.fixture(autouse=True)
def bare_user(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Use a home without any setting of uv or pip."""
    for variable in os.environ:
        if variable.upper().startswith(("UV_", "PIP_", "SSL_CERT", "REQUESTS_", "CURL_", "HTTP", "ALL_PROXY", "NETRC")):
            monkeypatch.delenv(variable)
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("UV_NO_CONFIG", "1")
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    return home


def at(server: Server) -> IndexSettings:
    """Return settings with the server as the only index."""
    return IndexSettings(default=f"{server.url}/simple")


def page(server: Server, *answers: Callable[[BaseHTTPRequestHandler], None]) -> IndexSettings:
    """Let the server answer for the package, one answer after the other."""
    server.pages["/simple/pole/"] = in_turn(*answers)
    return at(server)


JSON = answer(200, json.dumps(JSON_PAGE).encode(), "application/vnd.pypi.simple.v1+json")
HTML = answer(200, HTML_PAGE.encode())


class TestReleases:
    @pytest.mark.parametrize("form", [JSON, HTML], ids=["json", "html"])
    def test_both_forms_of_an_index_say_the_same(self, server: Server, form: Any) -> None:
        """JSON and HTML pages give the same releases: oldest first, with times, yanks and kinds of files."""
        assert releases("Pole", page(server, form)) == POLE

    def test_a_folder_index_answers_like_a_server(self, tmp_path: Path) -> None:
        """A `file:` index is read as a server's would be."""
        (tmp_path / "simple/pole").mkdir(parents=True)
        (tmp_path / "simple/pole/index.html").write_text(HTML_PAGE)

        assert releases("pole", IndexSettings(default=(tmp_path / "simple").as_uri()), offline=True) == POLE

    def test_a_cutoff_leaves_out_later_and_undated_files_but_no_links(self, server: Server, tmp_path: Path) -> None:
        """At an instant only earlier files exist; files of a find-links folder always do."""
        (tmp_path / "pole-3.0-py3-none-any.whl").touch()
        matrix = IndexSettings(default=page(server, JSON).default, find_links=(str(tmp_path),))

        found = releases("pole", matrix, cutoff="2024-01-01T12:00:00Z")

        assert [(one.version, one.wheels) for one in found] == [("1.0", ()), ("3.0", ("pole-3.0-py3-none-any.whl",))]

    def test_a_page_of_links_serves_as_find_links(self, server: Server) -> None:
        """A find-links address is a flat page of files of any package."""
        server.pages["/flat.html"] = answer(
            200, b'<a href="files/pole-1.0-py3-none-any.whl">a</a> <a href="files/other-9.0-py3-none-any.whl">b</a>'
        )

        found = releases("pole", IndexSettings(find_links=(f"{server.url}/flat.html",), no_index=True))

        assert [(one.version, one.wheels) for one in found] == [("1.0", ("pole-1.0-py3-none-any.whl",))]

    def test_the_first_index_that_has_the_package_decides(self, server: Server) -> None:
        """As in uv, an extra index comes before the default one and hides it."""
        server.pages["/extra/pole/"] = answer(200, b'<a href="pole-0.1-py3-none-any.whl">a</a>')
        matrix = IndexSettings(default=page(server, JSON).default, extra=(f"{server.url}/extra",))

        assert [one.version for one in releases("pole", matrix)] == ["0.1"]

    def test_extra_indexes_of_pip_are_merged(self, server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
        """As in pip, the best version of all indexes counts."""
        server.pages["/extra/pole/"] = answer(200, b'<a href="pole-0.1-py3-none-any.whl">a</a>')
        monkeypatch.setenv("PIP_EXTRA_INDEX_URL", f"{server.url}/extra")

        assert [one.version for one in releases("pole", page(server, JSON))] == ["0.1", "1.0", "1.1", "2.0rc1"]

    def test_a_package_that_no_place_has_is_bad_input(self, server: Server) -> None:
        """A package that no index has (404) is bad input: its name is wrong."""
        with pytest.raises(UnknownPackage) as raised:
            releases("pole", at(server))

        assert (
            str(raised.value)
            == "none of the package indexes and find-links places asked has a package 'pole'; check the name"
        )
        assert raised.value.exit_code == 2


class TestTrouble:
    @pytest.mark.parametrize("first", [answer(503), answer(429), cut_off], ids=["503", "429", "cut off"])
    def test_a_passing_trouble_is_tried_again(self, server: Server, first: Any) -> None:
        """A passing trouble is tried again: the third answer is used."""
        assert releases("pole", page(server, first, first, JSON)) == POLE

    @pytest.mark.parametrize(
        ("reply", "attempts", "reason"),
        [
            (answer(500), 3, "it answers HTTP 500; try again later, or set another index"),
            (answer(401), 1, "it answers HTTP 401; put its login into ~/.netrc or into the index setting"),
            (cut_off, 3, "the connection broke; try again later"),
            (
                answer(200, b"{}", "application/vnd.pypi.simple.v1+json"),
                3,
                "the answer is no index page (ValidationError); check the index settings of uv and pip",
            ),
        ],
        ids=["500", "401", "cut off", "nonsense"],
    )
    def test_a_lasting_trouble_is_reported_in_a_sentence(
        self, server: Server, reply: Any, attempts: int, reason: str
    ) -> None:
        """A lasting trouble of an index is reported in a sentence, and never means an absent package."""
        with pytest.raises(IndexUnreachable) as raised:
            releases("pole", page(server, reply))

        assert str(raised.value) == f"{server.url}/simple/pole/ could not be downloaded: {reason}"
        assert raised.value.exit_code == 3
        assert len(server.asked) == attempts

    def test_an_answer_that_does_not_end_is_given_up(self, server: Server) -> None:
        """A page that arrives too slowly is given up at the time limit, after one request."""
        began = time.monotonic()

        with pytest.raises(IndexUnreachable, match="/simple/pole/ could not be downloaded: its answer does not end"):
            releases("pole", page(server, drip), patience=BRIEF)

        assert (time.monotonic() - began < 4, len(server.asked)) == (True, 1)

    def test_a_file_that_drips_is_given_up(self, server: Server, tmp_path: Path) -> None:
        """A file that arrives a few bytes a second is given up too, and nothing of it is kept."""
        server.pages["/pole.whl"] = drip

        with pytest.raises(IndexUnreachable, match="its answer does not end"):
            fetch(wheel(f"{server.url}/pole.whl"), tmp_path, patience=BRIEF)

        assert [path for path in tmp_path.rglob("*") if path.is_file()] == []

    def test_a_page_that_is_too_long_is_none(self, server: Server) -> None:
        """A page that is longer than any real one, unpacked, is not read to its end."""
        bomb = answer(200, gzip.compress(bytes(MOST_PAGE + 1), 1), encoding="gzip")

        with pytest.raises(IndexUnreachable, match="the answer is no index page"):
            releases("pole", page(server, bomb))

    def test_an_interrupted_command_waits_for_no_answer(self, server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
        """After the command has been ended, no thread waits for an index."""
        monkeypatch.setattr(process, "is_stopped", lambda: True)

        with pytest.raises(IndexUnreachable, match="interrupted"):
            releases("pole", page(server, drip))

    def test_a_closed_port_is_reported_without_the_login(self) -> None:
        """A closed port is reported with the address, but without its password."""
        server = Server()
        server.close()
        with pytest.raises(IndexUnreachable) as raised:
            releases("pole", IndexSettings(default=f"http://user:secret@{server.host}/simple"))

        assert str(raised.value) == (
            f"{server.url}/simple/pole/ could not be downloaded: "
            "no connection; check the network and the index settings of uv and pip"
        )

    def test_an_absent_folder_is_reported(self, tmp_path: Path) -> None:
        """An absent find-links folder is a trouble of this machine."""
        with pytest.raises(IndexUnreachable) as raised:
            releases("pole", IndexSettings(find_links=(str(tmp_path / "gone"),)))

        assert str(raised.value) == (
            f"{tmp_path / 'gone'} does not exist; check the index and find-links settings of uv and pip"
        )

    def test_offline_asks_nothing(self, server: Server) -> None:
        """With `offline` the network is not touched."""
        with pytest.raises(IndexUnreachable) as raised:
            releases("pole", page(server, JSON), offline=True)

        assert str(raised.value) == (
            f"{server.url}/simple is on the network, and --offline is set; run without --offline"
        )
        assert server.asked == []


class TestLogins:
    def test_netrc_opens_a_protected_index(self, server: Server, bare_user: Path) -> None:
        """The user's netrc is used as uv and pip use it."""
        (bare_user / ".netrc").write_text("machine 127.0.0.1 login user password secret\n")
        (bare_user / ".netrc").chmod(0o600)
        protected = answer(200, HTML_PAGE.encode(), login=LOGIN)

        assert releases("pole", page(server, protected)) == POLE

    def test_the_login_of_an_index_opens_its_files(self, server: Server, tmp_path: Path) -> None:
        """A file on the host of an index with a login is fetched with that login."""
        server.pages["/pole.whl"] = answer(200, WHEEL, login=LOGIN)
        matrix = IndexSettings(default=f"http://user:secret@{server.host}/simple")

        path = fetch(wheel(f"{server.url}/pole.whl"), tmp_path / "wheels", matrix)

        assert path.read_bytes() == WHEEL

    def test_a_named_index_takes_its_login_from_variables(
        self, server: Server, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """`UV_INDEX_NAME_USERNAME` and `_PASSWORD` belong to the index of that name."""
        page(server, answer(200, HTML_PAGE.encode(), login=LOGIN))
        monkeypatch.setenv("UV_DEFAULT_INDEX", f"our-lab={server.url}/simple")
        monkeypatch.setenv("UV_INDEX_OUR_LAB_USERNAME", "user")
        monkeypatch.setenv("UV_INDEX_OUR_LAB_PASSWORD", "secret")

        assert releases("pole") == POLE


SDIST = b"an sdist, as far as anybody asks"
MARK = hashlib.sha256(SDIST).hexdigest()


class TestFind:
    """Find the address of the file with a given hash."""

    @pytest.mark.parametrize("form", ["json", "html"])
    def test_an_index_tells_the_address(self, server: Server, form: str, tmp_path: Path) -> None:
        """An index's page gives the address of the file with the hash, in either form, and the file can be fetched."""
        entry = {"filename": "pole-1.0.tar.gz", "url": "../../files/pole-1.0.tar.gz", "hashes": {"sha256": MARK}}
        link = f'<html><body><a href="../../files/pole-1.0.tar.gz#sha256={MARK}">pole-1.0.tar.gz</a></body></html>'
        told = answer(200, json.dumps({**JSON_PAGE, "files": [entry]}).encode(), "application/vnd.pypi.simple.v1+json")
        settings = page(server, told if form == "json" else answer(200, link.encode()))
        server.pages["/files/pole-1.0.tar.gz"] = answer(200, SDIST)

        found = index.find("pole", MARK, settings)

        assert (found.filename, found.sha256) == ("pole-1.0.tar.gz", MARK)
        assert fetch(found, tmp_path, settings).read_bytes() == SDIST

    def test_a_file_of_a_folder_tells_its_own(self, server: Server, tmp_path: Path) -> None:
        """A file in a folder is found by its hash; another file of the same name is not taken."""
        (tmp_path / "pole-1.0.tar.gz").write_bytes(SDIST)
        links = IndexSettings(no_index=True, find_links=(str(tmp_path),))

        assert index.find("pole", MARK, links).source == str(tmp_path / "pole-1.0.tar.gz")
        with pytest.raises(IndexUnreachable) as raised:
            index.find("pole", "0" * 64, links)
        assert str(raised.value) == (
            f"no index or find-links place that was asked has the file of pole with the SHA-256 {'0' * 64}"
        )


def wheel(source: str, content: bytes = WHEEL) -> Artifact:
    """Return the file in the form that a lock names it."""
    return Artifact(filename="pole-1.0-py3-none-any.whl", sha256=hashlib.sha256(content).hexdigest(), source=source)


class TestFetch:
    def test_a_file_is_downloaded_once(self, server: Server, tmp_path: Path) -> None:
        """A second fetch takes the file that is there."""
        server.pages["/pole.whl"] = in_turn(cut_off, answer(200, WHEEL))
        first = fetch(wheel(f"{server.url}/pole.whl"), tmp_path)
        second = fetch(wheel(f"{server.url}/pole.whl"), tmp_path)

        assert (first, first.name, first.read_bytes()) == (second, "pole-1.0-py3-none-any.whl", WHEEL)
        assert len(server.asked) == 2

    @pytest.mark.parametrize("as_address", [True, False], ids=["file:", "path"])
    def test_a_local_file_is_copied(self, tmp_path: Path, as_address: bool) -> None:
        """A find-links file is copied, so that it may change later."""
        source = tmp_path / "a wheel"
        source.write_bytes(WHEEL)

        path = fetch(wheel(source.as_uri() if as_address else str(source)), tmp_path / "wheels", offline=True)
        source.write_bytes(b"changed")

        assert path.read_bytes() == WHEEL

    def test_other_content_is_refused_and_nothing_kept(self, server: Server, tmp_path: Path) -> None:
        """A file whose hash is not the lock's is refused and not stored."""
        server.pages["/pole.whl"] = answer(200, b"other")
        artifact = wheel(f"{server.url}/pole.whl")

        with pytest.raises(IndexUnreachable) as raised:
            fetch(artifact, tmp_path)

        assert str(raised.value) == (
            f"pole-1.0-py3-none-any.whl from {server.url}/pole.whl is not the file that the lock names: its SHA-256 is "
            f"{hashlib.sha256(b'other').hexdigest()}, not {artifact.sha256}; try again, or lock again with --upgrade"
        )
        assert [path for path in tmp_path.rglob("*") if path.is_file()] == []

    def test_a_file_that_is_gone_could_not_be_had(self, server: Server, tmp_path: Path) -> None:
        """A locked file that is gone (404) says nothing about packages."""
        with pytest.raises(IndexUnreachable) as raised:
            fetch(wheel(f"{server.url}/pole.whl"), tmp_path)

        assert str(raised.value) == (
            f"{server.url}/pole.whl could not be downloaded: it answers HTTP 404; try again later, or set another index"
        )
