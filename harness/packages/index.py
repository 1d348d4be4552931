"""List releases of a package, and fetch the files of a lock, from the places of `index_settings`.

Addresses may be http(s), `file:` or plain paths; an index is a simple index (JSON or HTML), a find-links place is a
folder or a page of links. A trouble of the network is `IndexUnreachable`, never an absent package.
"""

from __future__ import annotations

import json
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar
from urllib.parse import unquote, urlsplit, urlunsplit

from msgspec import Struct
from packaging.utils import (
    InvalidSdistFilename,
    InvalidWheelFilename,
    canonicalize_name,
    parse_sdist_filename,
    parse_wheel_filename,
)
from packaging.version import Version

from harness.machine.store import sha256_of
from harness.model import Artifact, IndexSettings, replace
from harness.model.errors import BadInput, CouldNotTell
from harness.packages.index_settings import NOTHING, UserIndex, combine
from harness.packages.network_bounds import MOST_PAGE, Overdue, Watch, in_time

if TYPE_CHECKING:
    import requests

T = TypeVar("T")
ReadPart = Callable[[str], tuple[bytes, int]]


class Patience(Struct, frozen=True, kw_only=True):
    """The time that a place has: `pauses` before further attempts, `timeout` to connect and between two pieces."""

    pauses: tuple[float, ...] = (0.3, 1.5)
    timeout: tuple[float, float] = (15, 60)


PATIENT = Patience()
HASTY = Patience(pauses=(), timeout=(3, 10))
"""The patience of a question on whose answer nothing depends."""

PAGE_READS = 2
"""A whole page has so many times the seconds that are allowed between two pieces of it."""

PARTIAL_CONTENT = 206

SLOWEST = 2000
"""Bytes of a file that have to come in a second."""


class IndexUnreachable(CouldNotTell):
    """An index, a find-links place or one of its files cannot be reached; this says nothing about packages."""


class UnknownPackage(BadInput):
    """Every place answered, and none has a package of this name."""


class Release(Struct, frozen=True, kw_only=True):
    """A version that an index offers. `uploaded` is the instant of its first file, None where the index tells none.

    `yanked` is whether all its files are; `wheels` are file names, `sdist` is whether there is one.
    """

    version: str
    uploaded: str | None
    yanked: bool
    requires_python: str | None
    wheels: tuple[str, ...]
    sdist: bool


class _File(Struct, frozen=True, kw_only=True):
    name: str
    uploaded: datetime | None = None
    yanked: bool = False
    requires_python: str | None = None
    linked: bool = False
    address: str = ""
    sha256: str | None = None


def releases(
    name: str,
    matrix: IndexSettings = NOTHING,
    *,
    cutoff: str | None = None,
    offline: bool = False,
    patience: Patience = PATIENT,
) -> tuple[Release, ...]:
    """Return all releases of a package, oldest version first, including pre-releases and yanked ones.

    The instant `cutoff` works as in uv: files uploaded later, or at a time that the index does not tell, are left out;
    files of find-links places stay. With `offline` only folders and `file:` indexes answer.
    Raises IndexUnreachable, or UnknownPackage when no place has such a package.
    """
    places = combine(matrix)
    with closing(_Client(places, offline=offline, patience=patience)) as client:
        return _grouped(_listed(client, places, name), name, cutoff)


def find(name: str, sha256: str, matrix: IndexSettings = NOTHING, *, offline: bool = False) -> Artifact:
    """Return the file of a package with this SHA-256. Raises IndexUnreachable if no place lists it."""
    places = combine(matrix)
    with closing(_Client(places, offline=offline)) as client:
        for file in _listed(client, places, name):
            if _version(file.name, name) is not None and _sha256(file) == sha256:
                return Artifact(filename=file.name, sha256=sha256, source=file.address)
    message = f"no index or find-links place that was asked has the file of {name} with the SHA-256 {sha256}"
    raise IndexUnreachable(message)


def artifacts(name: str, matrix: IndexSettings = NOTHING) -> dict[str, tuple[Artifact, ...]]:
    """Return the files of each release of a package, by version. Raises IndexUnreachable, or UnknownPackage."""
    places = combine(matrix)
    files: dict[str, list[Artifact]] = {}
    with closing(_Client(places, offline=False)) as client:
        for file in _listed(client, places, name):
            version, sha = _version(file.name, name), _sha256(file)
            if version is not None and sha is not None:
                files.setdefault(str(version), []).append(Artifact(filename=file.name, sha256=sha, source=file.address))
    return {version: tuple(some) for version, some in files.items()}


def _listed(client: _Client, places: UserIndex, name: str) -> list[_File]:
    """Return all files of a package. Raises UnknownPackage if no place has the package."""
    linked = (file for link in places.find_links for file in client.linked(link))
    files = [replace(file, linked=True) for file in linked if _version(file.name, name) is not None]
    package_exists = bool(files)
    for address in () if places.no_index else (*places.extra, places.default):
        page = client.project(address, name)
        if page is not None:
            package_exists = True
            files += page
            # As in uv: the first index that has the package hides the others.
            if places.strategy == "first-index":
                break
    if not package_exists:
        message = f"none of the package indexes and find-links places asked has a package '{name}'; check the name"
        raise UnknownPackage(message)
    return files


def _sha256(file: _File) -> str | None:
    """Return the hash that the index gives for a file, else the computed hash of a file on this machine."""
    path = _local(file.address)
    return file.sha256 if file.sha256 or path is None else sha256_of(_there(path))


def fetch(
    artifact: Artifact,
    folder: Path,
    matrix: IndexSettings = NOTHING,
    *,
    offline: bool = False,
    patience: Patience = PATIENT,
) -> Path:
    """Return the path of an artifact's file below `folder`, downloaded or copied there if it is missing.

    The file appears only when it is whole and its SHA-256 is right. Raises IndexUnreachable otherwise.
    """
    target = folder / artifact.sha256[:16] / artifact.filename
    if target.exists():
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=target.parent, delete=False) as file:
        temporary = Path(file.name)
    try:
        with closing(_Client(combine(matrix), offline=offline, patience=patience)) as client:
            client.download(artifact.source, temporary)
        _check(temporary, artifact)
        # `tempfile` makes files that only their owner may read; many machines may share a folder of `simmatrix fetch`.
        temporary.chmod(0o644)
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)
    return target


@contextmanager
def parts(artifact: Artifact, matrix: IndexSettings = NOTHING) -> Iterator[ReadPart]:
    """Give a function that reads parts of an artifact's file. It raises IndexUnreachable where none are to be had.

    Its argument is a range as HTTP writes it (`0-99`, `-100` for the last hundred bytes); it returns the bytes and the
    size of the whole file. The SHA-256 of the file is not checked, as nobody has the whole.
    """
    with closing(_Client(combine(matrix), offline=False)) as client:
        yield lambda span: client.part(artifact.source, span)


class _Client:
    """One session with the user's certificates, proxy and logins."""

    def __init__(self, places: UserIndex, *, offline: bool, patience: Patience = PATIENT) -> None:
        self._places = places
        self._offline = offline
        self._patience = patience
        self._opened: requests.Session | None = None

    def project(self, address: str | None, name: str) -> list[_File] | None:
        """Return the files of a package on one index (None: the default one); None if it has no such package."""
        if self._offline and (address is None or _local(address) is None):
            raise IndexUnreachable(_offline_message(_shown(address) if address else "the package index"))
        from pypi_simple import ACCEPT_ANY, PYPI_SIMPLE_ENDPOINT  # noqa: PLC0415  (slow to import)

        page = f"{(address or PYPI_SIMPLE_ENDPOINT).rstrip('/')}/{canonicalize_name(name)}/"
        folder = _local(page)
        if folder is not None:
            # A missing index is a trouble of this machine; an index without this page does not have the package.
            html = _there(folder.parent) and folder / "index.html"
            return _from_html(html.read_bytes(), html.as_uri()) if html.is_file() else None

        def work(watch: Watch) -> list[_File] | None:
            with self._get(page, {"Accept": ACCEPT_ANY}) as response:
                return None if response.status_code == 404 else _from_response(response, _page(watch, response))

        return self._patiently(work, page)

    def linked(self, link: str) -> list[_File]:
        """Return the files of all packages in one find-links place: a folder, or a page of links."""
        path = _local(link)
        if path is not None:
            if _there(path).is_dir():
                return [_File(name=file.name, address=str(file)) for file in path.iterdir()]
            return _from_html(path.read_bytes(), path.absolute().as_uri())

        def work(watch: Watch) -> list[_File]:
            with self._get(link, {}) as response:
                response.raise_for_status()
                return _from_html(_page(watch, response), response.url)

        return self._patiently(work, link)

    def download(self, source: str, target: Path) -> None:
        """Write what the address or path holds to `target`."""
        path = _local(source)
        if path is not None:
            shutil.copyfile(_there(path), target)
            return

        def work(watch: Watch) -> None:
            with self._get(self._with_login(source), {}) as response, target.open("wb") as file:
                response.raise_for_status()
                for chunk in watch.chunks(response):
                    file.write(chunk)

        self._patiently(work, source, slowest=SLOWEST)

    def part(self, source: str, span: str) -> tuple[bytes, int]:
        """Return the bytes in a range of a file, and the size of the whole file."""
        path = _local(source)
        if path is not None:
            content = _there(path).read_bytes()
            first, _, last = span.partition("-")
            return content[int(first) : int(last) + 1] if first else content[-int(last) :], len(content)

        def work(watch: Watch) -> tuple[bytes, int]:
            with self._get(self._with_login(source), {"Range": f"bytes={span}"}) as response:
                response.raise_for_status()
                size = response.headers.get("Content-Range", "").rpartition("/")[2]
                if response.status_code != PARTIAL_CONTENT or not size.isdigit():
                    message = "its server gives no parts of files"
                    raise ValueError(message)
                return b"".join(watch.chunks(response)), int(size)

        return self._patiently(work, source, slowest=SLOWEST)

    def close(self) -> None:
        """End the session."""
        if self._opened is not None:
            self._opened.close()

    def _get(self, address: str, headers: dict[str, str]) -> requests.Response:
        """Return one response, a 404 included; any other error status raises."""
        response = self._session().get(address, headers=headers, timeout=self._patience.timeout, stream=True)
        if not response.ok and response.status_code != 404:
            response.close()
            response.raise_for_status()
        return response

    def _session(self) -> requests.Session:
        import requests  # noqa: PLC0415  (slow to import)

        if self._opened is None:
            self._opened = requests.Session()
            self._opened.headers["User-Agent"] = "simmatrix"
            if self._places.certificates is not None:
                self._opened.verify = self._places.certificates
            if self._places.proxy is not None:
                self._opened.proxies = {"http": self._places.proxy, "https": self._places.proxy}
        return self._opened

    def _with_login(self, address: str) -> str:
        """Return the address with the login of a configured place on the same host, as pip and uv do for files."""
        parts = urlsplit(address)
        for place in (*self._places.extra, self._places.default or "", *self._places.find_links):
            login, at, host = urlsplit(place).netloc.rpartition("@")
            if at and host == parts.netloc:
                return urlunsplit(parts._replace(netloc=f"{login}@{host}"))
        return address

    def _patiently(self, work: Callable[[Watch], T], address: str, slowest: float = float("inf")) -> T:
        """Do the work, in up to three attempts if a retry can help. Raises IndexUnreachable with the reason."""
        if self._offline:
            raise IndexUnreachable(_offline_message(_shown(address)))
        from requests import RequestException  # noqa: PLC0415  (slow to import)

        for pause in (*self._patience.pauses, None):
            try:
                return in_time(work, PAGE_READS * self._patience.timeout[1], slowest=slowest)
            except Overdue as error:
                # No further attempt: this one took all the time that the work may have.
                message = f"{_shown(address)} could not be downloaded: {error}"
                raise IndexUnreachable(message) from None
            except (RequestException, ValueError) as error:
                if pause is None or not _passing(error):
                    message = f"{_shown(address)} could not be downloaded: {_reason(error)}"
                    raise IndexUnreachable(message) from None
                time.sleep(pause)
        raise AssertionError


def _offline_message(place: str) -> str:
    return f"{place} is on the network, and --offline is set; run without --offline"


def _passing(error: Exception) -> bool:
    """Return whether another attempt may do better: no answer, a broken one, an overloaded server."""
    response = getattr(error, "response", None)
    return response is None or response.status_code >= 500 or response.status_code == 429


def _reason(error: Exception) -> str:
    """Say in a few words what happened and what to do."""
    from requests import exceptions  # noqa: PLC0415  (slow to import)

    response = getattr(error, "response", None)
    if response is not None and response.status_code in {401, 403}:
        return f"it answers HTTP {response.status_code}; put its login into ~/.netrc or into the index setting"
    if response is not None and response.status_code >= 400:
        return f"it answers HTTP {response.status_code}; try again later, or set another index"
    # The order counts: proxy and TLS errors, and some timeouts, are ConnectionErrors of requests, too.
    reasons: tuple[tuple[type[Exception], str], ...] = (
        (exceptions.ProxyError, "the proxy refuses; check HTTPS_PROXY"),
        (exceptions.SSLError, "its certificate is not accepted; name your CA bundle in SSL_CERT_FILE"),
        (exceptions.Timeout, "no answer in time; check the network, or try again later"),
        (exceptions.ConnectionError, "no connection; check the network and the index settings of uv and pip"),
        (exceptions.ChunkedEncodingError, "the connection broke; try again later"),
    )
    for kind, text in reasons:
        if isinstance(error, kind):
            return text
    return f"the answer is no index page ({type(error).__name__}); check the index settings of uv and pip"


def _shown(address: str) -> str:
    """Return the address without its login."""
    parts = urlsplit(address)
    return urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))


def _local(address: str) -> Path | None:
    """Return the path that a `file:` address or a plain path means; None for anything on the network."""
    if address.startswith("file:"):
        return Path(unquote(urlsplit(address).path))
    return Path(address) if "://" not in address else None


def _there(path: Path) -> Path:
    if not path.exists():
        message = f"{path} does not exist; check the index and find-links settings of uv and pip"
        raise IndexUnreachable(message)
    return path


def _page(watch: Watch, response: requests.Response) -> bytes:
    return b"".join(watch.chunks(response, MOST_PAGE))


def _from_response(response: requests.Response, content: bytes) -> list[_File]:
    from pypi_simple import ProjectPage  # noqa: PLC0415  (slow to import)

    if "json" not in response.headers.get("Content-Type", ""):
        return _from_html(content, response.url)
    return [
        _File(
            name=package.filename,
            uploaded=package.upload_time,
            yanked=package.is_yanked,
            requires_python=package.requires_python,
            address=package.url,
            sha256=package.digests.get("sha256"),
        )
        for package in ProjectPage.from_json_data(json.loads(content), response.url).packages
    ]


def _from_html(content: bytes, address: str) -> list[_File]:
    """Return the files that a page links to; uv reads the same attribute for upload times, which no standard names."""
    from pypi_simple import RepositoryPage  # noqa: PLC0415  (slow to import)

    return [
        _File(
            name=unquote(urlsplit(link.url).path.rpartition("/")[2]),
            uploaded=datetime.fromisoformat(at) if (at := link.get_str_attrib("data-upload-time")) else None,
            yanked=link.get_str_attrib("data-yanked") is not None,
            requires_python=link.get_str_attrib("data-requires-python"),
            address=link.url.partition("#")[0],
            sha256=next(iter(re.findall(r"#(?:.*&)?sha256=([0-9a-f]{64})", link.url)), None),
        )
        for link in RepositoryPage.from_html(content, base_url=address).links
    ]


def _check(path: Path, artifact: Artifact) -> None:
    sha256 = sha256_of(path)
    if sha256 != artifact.sha256:
        message = (
            f"{artifact.filename} from {_shown(artifact.source)} is not the file that the lock names: "
            f"its SHA-256 is {sha256}, not {artifact.sha256}; try again, or lock again with --upgrade"
        )
        raise IndexUnreachable(message)


def _grouped(files: Iterable[_File], name: str, cutoff: str | None) -> tuple[Release, ...]:
    limit = datetime.fromisoformat(cutoff) if cutoff else None
    versions: dict[Version, list[_File]] = {}
    for file in files:
        version = _version(file.name, name)
        if version is not None and (limit is None or file.linked or (file.uploaded and file.uploaded <= limit)):
            versions.setdefault(version, []).append(file)
    return tuple(_release(version, versions[version]) for version in sorted(versions))


def _release(version: Version, files: list[_File]) -> Release:
    times = [file.uploaded for file in files if file.uploaded is not None]
    return Release(
        version=str(version),
        uploaded=min(times).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ") if times else None,
        yanked=all(file.yanked for file in files),
        requires_python=next((file.requires_python for file in files if file.requires_python), None),
        wheels=tuple(sorted({file.name for file in files if file.name.endswith(".whl")})),
        sdist=any(not file.name.endswith(".whl") for file in files),
    )


def _version(filename: str, name: str) -> Version | None:
    """Return the version of a wheel or an sdist of this package; None for anything else."""
    try:
        if filename.endswith(".whl"):
            project, version = parse_wheel_filename(filename)[:2]
        else:
            project, version = parse_sdist_filename(filename)
    except (InvalidWheelFilename, InvalidSdistFilename):
        return None
    return version if project == canonicalize_name(name) else None
