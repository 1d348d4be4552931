"""Resolutions by the real uv, over fakes in a folder and over little indexes on the loopback."""

import hashlib
from collections.abc import Callable, Iterable
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import pytest
import wheelhouse as fakes
from asking import expect_failure, expect_lock, question, send

from harness.model import IndexSettings, Interpreter, Lock, Outcome, Phase, Question, Step
from harness.model.errors import BadInput
from harness.packages import resolver, uv_command

pytestmark = pytest.mark.usefixtures("workplace")

BROKEN = {
    "error": "HTTP status server error (500 Internal Server Error)",
    "login": "could not be queried due to a lack of valid authentication credentials (401 Unauthorized)",
    "forbidden": "returned a 403 Forbidden error",
    "silent": "connection closed before message completed",
    "short": "end of file before message length reached",
    "portal": "the index answers, but lists no file of fake-plain; check the index settings of uv and pip",
}


@pytest.fixture
def ask(host: Interpreter, offline_index: IndexSettings, tmp_path: Path) -> Callable[..., Lock | Step]:
    """Return a function that resolves with the host's Python over the fakes."""

    def resolve(*requirements: str, python: Interpreter = host, **more: object) -> Lock | Step:
        return resolver.resolve(
            question(*requirements, **{"index": offline_index, **more}), python, tmp_path / "state" / "x"
        )

    return resolve


def breaking(how: str) -> Callable[[BaseHTTPRequestHandler], None]:
    """Return a handler that fails in one way."""
    answers: dict[str, Callable[[BaseHTTPRequestHandler], None]] = {
        "error": lambda handler: send(handler, 500),
        "login": lambda handler: send(handler, 401),
        "forbidden": lambda handler: send(handler, 403),
        "silent": lambda handler: handler.connection.shutdown(2),
        "short": lambda handler: send(handler, 200, b"<html>", announced=1000),
        "portal": lambda handler: send(handler, 200, b"<html><a href='/login'>Sign in to go on</a></html>"),
    }
    return answers[how]


class TestLock:
    def test_text_is_versions_and_hashes(
        self, ask: Callable[..., Lock | Step], wheelhouse: Path, tmp_path: Path
    ) -> None:
        """A lock is sorted, hash-pinned requirements, without a place, a date or a name of this machine."""
        lock = expect_lock(ask("fake-needs-plain"))
        needing, plain = (
            hashlib.sha256((wheelhouse / name).read_bytes()).hexdigest()
            for name in ("fake_needs_plain-1.0-py3-none-any.whl", "fake_plain-3.0-py3-none-any.whl")
        )

        assert lock.requirements == (
            f"fake-needs-plain==1.0 \\\n    --hash=sha256:{needing}\nfake-plain==3.0 \\\n    --hash=sha256:{plain}\n"
        )
        assert lock.sha256 == hashlib.sha256(lock.requirements.encode()).hexdigest()
        assert lock.instant == "2026-01-01T00:00:00Z"
        assert (tmp_path / "state" / "x" / "pylock.toml").exists()

    def test_same_question_same_bytes(
        self, ask: Callable[..., Lock | Step], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The same snapshot locks to the same bytes again: with an empty cache, the files in another folder."""
        first = expect_lock(ask("fake-needs-plain", "fake-build-dependent"))
        monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "other"))
        moved = fakes.make(tmp_path / "moved", "needs-plain", "plain", "build-dependent", "build-tool")
        second = expect_lock(
            ask(
                "fake-needs-plain", "fake-build-dependent", index=IndexSettings(no_index=True, find_links=(str(moved),))
            )
        )

        assert first.requirements == second.requirements

    def test_identical_resolutions_are_one(self, ask: Callable[..., Lock | Step], other: Interpreter) -> None:
        """Another question, on another Python, with the same answer has the same lock."""
        one = expect_lock(ask("fake-needs-plain"))
        same = expect_lock(ask("fake-plain==3.0", "fake-needs-plain", python=other))

        assert one.sha256 == same.sha256

    def test_settings_of_the_user_that_are_no_index_do_not_count(
        self, ask: Callable[..., Lock | Step], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """`UV_RESOLUTION`, a constraint of the user's, a `uv.toml` in the working folder change no lock."""
        (tmp_path / "constraints.txt").write_text("fake-plain==1.0\n")
        (tmp_path / "uv.toml").write_text('[pip]\nresolution = "lowest"\n')
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("UV_RESOLUTION", "lowest")
        monkeypatch.setenv("UV_CONSTRAINT", str(tmp_path / "constraints.txt"))
        monkeypatch.setenv("UV_NO_BINARY", "1")

        assert expect_lock(ask("fake-plain")).versions == {"fake-plain": "3.0"}

    def test_question_counts(self, ask: Callable[..., Lock | Step]) -> None:
        """Constraints, overrides and the resolution are those of the question."""
        constrained = expect_lock(ask("fake-plain", constraints=("fake-plain<3",)))
        overridden = expect_lock(ask("fake-needs-plain", overrides=("fake-plain==1.0",)))
        lowest = expect_lock(ask("fake-plain", resolution="lowest-direct"))

        assert constrained.versions["fake-plain"] == "2.0"
        assert overridden.versions["fake-plain"] == "1.0"
        assert lowest.versions["fake-plain"] == "1.0"

    def test_own_address(self, ask: Callable[..., Lock | Step], wheelhouse: Path) -> None:
        """A requirement that names a file is pinned by the file's hash."""
        path = wheelhouse / "fake_plain-1.0-py3-none-any.whl"
        pin = expect_lock(ask(f"fake-plain @ {path.as_uri()}")).pins[0]

        assert (pin.version, pin.artifact.filename) == ("1.0", path.name)
        assert pin.hashes == (hashlib.sha256(path.read_bytes()).hexdigest(),)


class TestMetadataOfSdists:
    def test_cache_of_metadata_is_not_shared(self, ask: Callable[..., Lock | Step], other: Interpreter) -> None:
        """One sdist under two build constraints, in both orders, has the requirements of its own build each time."""
        found = [
            expect_lock(ask("fake-build-dependent", build_constraints=(f"fake-build-tool=={tool}",), python=python))
            for python in (other,)
            for tool in ("1.0", "2.0", "1.0")
        ]

        assert [lock.versions["fake-plain"] for lock in found] == ["1.0", "2.0", "1.0"]

    def test_failing_metadata(self, ask: Callable[..., Lock | Step]) -> None:
        """A build that fails while uv resolves is a failed install, with the backend's own line."""
        assert expect_failure(ask("fake-metadata-failure")) == (
            Phase.INSTALL,
            Outcome.FAILED,
            "RuntimeError: this setup knows no such Python",
        )

    def test_invalid_metadata(self, ask: Callable[..., Lock | Step]) -> None:
        """Metadata that no tool can read is a failed install that quotes the line."""
        phase, outcome, decisive = expect_failure(ask("fake-metadata-invalid"))

        assert (phase, outcome) == (Phase.INSTALL, Outcome.FAILED)
        assert decisive is not None
        assert decisive.startswith("Metadata for `fake-metadata-invalid` (v1.0) could not be parsed: ")
        assert decisive.endswith("fake-plain (>=3.)")


class TestNoSolution:
    @pytest.mark.parametrize(
        ("requirements", "decisive"),
        [
            pytest.param(
                ("fake-unresolvable", "fake-plain"),
                "Because all versions of fake-unresolvable depend on fake-plain<1 and only fake-plain>=1.0 is available"
                ", we can conclude that all versions of fake-unresolvable cannot be used. "
                "And because you require fake-unresolvable",
                id="conflict",
            ),
            pytest.param(
                ("fake-nowhere",),
                "Because fake-nowhere was not found in the provided package locations and you require fake-nowhere",
                id="unknown",
            ),
            pytest.param(
                ("fake-plain==9",),
                "Because there is no version of fake-plain==9 and you require fake-plain==9",
                id="version",
            ),
            pytest.param(
                ("fake-new-python",),
                "Because fake-new-python==1.0 requires Python >=3.99 and only fake-new-python==1.0 is available, "
                "we can conclude that all versions of fake-new-python cannot be used. "
                "And because you require fake-new-python",
                id="python",
            ),
        ],
    )
    def test_resolver_explains(
        self, ask: Callable[..., Lock | Step], requirements: tuple[str, ...], decisive: str
    ) -> None:
        """No solution is a failed resolution; uv's explanation is the decisive line."""
        assert expect_failure(ask(*requirements)) == (Phase.RESOLVE, Outcome.FAILED, decisive)

    def test_no_wheel_for_this_python(self, ask: Callable[..., Lock | Step]) -> None:
        """A release with wheels for other Pythons only, and no sdist, cannot be resolved."""
        phase, outcome, decisive = expect_failure(ask("fake-no-wheel"))

        assert (phase, outcome) == (Phase.RESOLVE, Outcome.FAILED)
        assert decisive is not None
        assert "has no wheels with a matching Python implementation tag" in decisive

    def test_only_binary(self, ask: Callable[..., Lock | Step]) -> None:
        """If only wheels are allowed, a release with nothing but an sdist cannot be resolved."""
        assert expect_failure(ask("fake-build-dependent==1.0", only_binary=("fake-build-dependent",))) == (
            Phase.RESOLVE,
            Outcome.FAILED,
            "Because fake-build-dependent==1.0 has no usable wheels and you require fake-build-dependent==1.0",
        )

    def test_absent(self, ask: Callable[..., Lock | Step]) -> None:
        """If a package must be absent, the packages that require it are named."""
        by_another = ask("fake-needs-plain", absent=("fake_plain",))
        by_us = ask("fake-needs-plain", "fake-plain>=2", absent=("fake-plain",))

        assert expect_failure(by_another)[2] == "fake-plain is to be absent, but fake-needs-plain requires it"
        assert expect_failure(by_us)[2] == "fake-plain is to be absent, but the requirements name it"
        assert expect_lock(ask("fake-plain", absent=("fake-needs-plain",))).versions == {"fake-plain": "3.0"}


class TestIndexTrouble:
    @pytest.mark.parametrize("how", BROKEN)
    def test_broken_index(self, ask: Callable[..., Lock | Step], serve: Callable[..., str], how: str) -> None:
        """An index that fails is infra, never a verdict about packages."""
        phase, outcome, decisive = expect_failure(ask("fake-plain", index=IndexSettings(default=serve(breaking(how)))))

        assert (phase, outcome) == (Phase.RESOLVE, Outcome.INFRA)
        assert decisive is not None
        assert BROKEN[how] in decisive

    def test_file_cut_short(self, ask: Callable[..., Lock | Step], serve: Callable[..., str], wheelhouse: Path) -> None:
        """A truncated wheel is infra, and no reason to take an older version silently."""

        def answer(handler: BaseHTTPRequestHandler) -> None:
            name = handler.path.rpartition("/")[2]
            if handler.command == "HEAD":  # as an index that serves no parts of files, so that uv takes the whole wheel
                send(handler, 405)
                return
            if name.endswith(".whl"):
                content = (wheelhouse / name).read_bytes()
                send(handler, 200, content[:99] if "-2.0-" in name else content)
                return
            names = [f"fake_plain-{version}-py3-none-any.whl" for version in ("1.0", "2.0")]
            mark = "0" * 64  # with which uv reads no more of a wheel than its metadata
            links = (f'<a href="/files/{name}#sha256={mark}">{name}</a>' for name in names)
            send(handler, 200, "".join(links).encode())

        answered = ask("fake-plain", index=IndexSettings(default=serve(answer)), snapshot=None)

        told = "fake-plain==2.0 came broken from its index: Failed to read from zip file; try again"
        assert expect_failure(answered) == (Phase.RESOLVE, Outcome.INFRA, told)

    def test_unreachable_index(self, ask: Callable[..., Lock | Step]) -> None:
        """An index that nobody serves is infra."""
        phase, outcome, decisive = expect_failure(
            ask("fake-plain", index=IndexSettings(default="http://127.0.0.1:9/simple"))
        )

        assert (phase, outcome) == (Phase.RESOLVE, Outcome.INFRA)
        assert decisive is not None
        assert "Connection refused" in decisive

    def test_build_requirements_from_a_broken_index(
        self, ask: Callable[..., Lock | Step], serve: Callable[..., str], tmp_path: Path
    ) -> None:
        """An index that fails while the build requirements of an sdist are sought is infra too."""
        alone = fakes.make(tmp_path / "alone", "build-dependent")
        index = IndexSettings(default=serve(breaking("error")), find_links=(str(alone),))

        assert expect_failure(ask("fake-build-dependent", index=index))[:2] == (Phase.RESOLVE, Outcome.INFRA)

    def test_offline(self, host: Interpreter, tmp_path: Path) -> None:
        """A package that is not in the cache cannot be resolved without the network: infra, no verdict."""
        asked = question("fake-plain", index=IndexSettings(default="http://127.0.0.1:9/simple"))

        assert expect_failure(resolver.resolve(asked, host, tmp_path / "state" / "x", offline=True)) == (
            Phase.RESOLVE,
            Outcome.INFRA,
            "Packages were unavailable because the network was disabled. "
            "When the network is disabled, registry packages may only be read from the cache.",
        )

    def test_offline_before_a_cutoff(self, host: Interpreter, tmp_path: Path) -> None:
        """With a cutoff uv reports packages missing from the cache as filtered; that is no verdict either."""
        places = IndexSettings(default="http://127.0.0.1:9/simple")
        asked = question("fake-plain", index=places, snapshot="2026-11-20T23:59:59Z")

        phase, outcome, decisive = expect_failure(resolver.resolve(asked, host, tmp_path / "state" / "x", offline=True))
        assert (phase, outcome) == (Phase.RESOLVE, Outcome.INFRA)
        assert decisive

    def test_bad_requirement(self, ask: Callable[..., Lock | Step]) -> None:
        """A malformed requirement is bad input of the user."""
        with pytest.raises(BadInput) as raised:
            ask("fake-plain===")

        assert str(raised.value) == (
            "uv cannot use its input: Couldn't parse requirement in `requirements.in` at position 0: "
            "Unexpected end of version specifier, expected version: fake-plain===; correct the requirement or setting"
        )


class TestCutoff:
    def index(self, serve: Callable[..., str], wheelhouse: Path) -> IndexSettings:
        """Return an index with two releases of a package with upload times, and one without."""
        times = {"1.0": "2024-01-01T00:00:00Z", "2.0": "2025-01-01T00:00:00Z", "3.0": None}

        def answer(handler: BaseHTTPRequestHandler) -> None:
            name = handler.path.rpartition("/")[2]
            if name.endswith(".whl"):
                send(handler, 200, (wheelhouse / name).read_bytes())
                return
            lines = []
            for version, time in times.items():
                path = wheelhouse / f"fake_plain-{version}-py3-none-any.whl"
                digest = hashlib.sha256(path.read_bytes()).hexdigest()
                date = f' data-upload-time="{time}"' if time else ""
                lines.append(f'<a href="/files/{path.name}#sha256={digest}"{date}>{path.name}</a>')
            send(handler, 200, f"<html><body>{''.join(lines)}</body></html>".encode())

        return IndexSettings(default=serve(answer))

    @pytest.mark.parametrize(
        ("snapshot", "version"), [("2024-06-01T00:00:00Z", "1.0"), ("2025-06-01T00:00:00Z", "2.0")]
    )
    def test_snapshot(
        self,
        ask: Callable[..., Lock | Step],
        serve: Callable[..., str],
        wheelhouse: Path,
        snapshot: str,
        version: str,
    ) -> None:
        """A snapshot shuts out what was uploaded later, and what an index gives no upload time of."""
        lock = expect_lock(ask("fake-plain", index=self.index(serve, wheelhouse), snapshot=snapshot))

        assert lock.versions == {"fake-plain": version}
        assert lock.escaped == ()
        assert lock.instant == snapshot

    def test_find_links_escape(self, ask: Callable[..., Lock | Step]) -> None:
        """Files of a find-links folder have no upload time; the lock says that they escaped the cutoff."""
        assert expect_lock(ask("fake-needs-plain", snapshot="2001-01-01T00:00:00Z")).escaped == (
            "fake-needs-plain",
            "fake-plain",
        )


class TestTorch:
    @pytest.fixture
    def gpu(self, tmp_path: Path) -> Path:
        """Return a folder with the GPU builds."""
        return fakes.make(tmp_path / "gpu", "torch")

    def torch(
        self, ask: Callable[..., Lock | Step], *links: Path, requirement: str = "torch", **more: object
    ) -> object:
        """Return the version of torch, or phase, outcome and decisive line of the failed step."""
        index = IndexSettings(no_index=True, find_links=tuple(map(str, links)))
        answer = ask(requirement, index=index, **more)
        return answer.versions["torch"] if isinstance(answer, Lock) else expect_failure(answer)

    def test_cpu_build_is_found(self, ask: Callable[..., Lock | Step], gpu: Path, tmp_path: Path) -> None:
        """The newest CPU build of a find-links folder is taken, though a newer GPU build is there."""
        cpu = fakes.make(tmp_path / "cpu", "torch-cpu")

        assert self.torch(ask, gpu, cpu) == "2.5+cpu"
        assert self.torch(ask, gpu, cpu, requirement="torch<2.5") == "2.4+cpu"

    def test_user_settings_name_the_folder(
        self, ask: Callable[..., Lock | Step], gpu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The folder may be the user's own, set for pip or for uv."""
        monkeypatch.setenv("PIP_FIND_LINKS", str(fakes.make(tmp_path / "cpu", "torch-cpu")))

        assert self.torch(ask, gpu) == "2.5+cpu"

    def test_no_cpu_build(self, ask: Callable[..., Lock | Step], gpu: Path) -> None:
        """If no CPU build can be reached, the index's own build is taken, which runs without a GPU, too."""
        assert self.torch(ask, gpu) == "2.6"

    def test_backend_that_cannot_be_reached(
        self, ask: Callable[..., Lock | Step], gpu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """If uv fails to ask its backend, the lock and the file beside its log are those of the index's own build."""
        compile_lock = uv_command.compile_lock

        def refuse(
            call: uv_command.Call, interpreter: Interpreter, arguments: Iterable[str], output: Path
        ) -> uv_command.Result:
            if "--torch-backend" in (asked := tuple(arguments)):
                return uv_command.Result(ok=False, text="error: Failed to fetch the index")
            return compile_lock(call, interpreter, asked, output)

        monkeypatch.setattr(uv_command, "compile_lock", refuse)

        assert self.torch(ask, gpu) == "2.6"
        assert 'version = "2.6"' in (tmp_path / "state" / "x" / "pylock.toml").read_text()

    def test_gpu_build_where_asked_for(self, ask: Callable[..., Lock | Step], gpu: Path) -> None:
        """A GPU build is taken where the question asks for any."""
        assert self.torch(ask, gpu, torch_backend="any") == "2.6"


class TestRestore:
    def restored(self, lock: str, host: Interpreter, index: IndexSettings, tmp_path: Path) -> Lock | Step:
        """Find the files of a lock again."""
        asked: Question = question("anything", index=index)
        return resolver.restore(lock, asked, host, tmp_path / "state" / "x")

    def test_same_lock(
        self,
        ask: Callable[..., Lock | Step],
        host: Interpreter,
        offline_index: IndexSettings,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        """A committed lock, in a fresh clone with an empty cache, has the same packages, versions and hashes."""
        before = expect_lock(ask("fake-needs-plain", "fake-build-dependent", constraints=("fake-plain==2.0",)))
        monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "empty"))
        after = expect_lock(self.restored(before.requirements, host, offline_index, tmp_path))

        assert after.requirements == before.requirements
        assert [pin.artifact.sha256 for pin in after.pins] == [pin.artifact.sha256 for pin in before.pins]

    def test_another_file(
        self, ask: Callable[..., Lock | Step], host: Interpreter, offline_index: IndexSettings, tmp_path: Path
    ) -> None:
        """An index that has the version with another file cannot tell anything about the lock."""
        lock = expect_lock(ask("fake-plain==1.0"))
        text = lock.requirements.replace(lock.pins[0].artifact.sha256, "0" * 64)

        assert expect_failure(self.restored(text, host, offline_index, tmp_path)) == (
            Phase.RESOLVE,
            Outcome.INFRA,
            "no index or find-links place that was asked has fake-plain 1.0 with a hash of the lock; lock again",
        )
