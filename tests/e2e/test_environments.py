"""Environments made of the fakes by the real uv: their keys, stamps, contents."""

import shutil
import subprocess
import sys
import zipfile
from base64 import b64encode
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import pytest
import wheelhouse as fakes
from asking import expect_failure, expect_lock, install, question, send

from harness.machine.files import file_locks
from harness.model import Artifact, IndexSettings, Interpreter, Level, Lock, Outcome, Phase, Step, replace
from harness.packages import download_notice, resolver, uv_command
from harness.packages.environments import environment_damage, environments
from harness.packages.environments.environments import Environment, Wheel, environment_key

pytestmark = pytest.mark.usefixtures("workplace")

Make = Callable[..., Environment]


@pytest.fixture
def lock(host: Interpreter, offline_index: IndexSettings, tmp_path: Path) -> Callable[..., Lock]:
    """Return a function that locks fakes with the host's Python."""

    def resolve(*requirements: str, python: Interpreter = host) -> Lock:
        return expect_lock(
            resolver.resolve(question(*requirements, index=offline_index), python, tmp_path / "state" / "x")
        )

    return resolve


@pytest.fixture
def ensure(host: Interpreter, offline_index: IndexSettings) -> Callable[..., Environment | Step]:
    """Return a function that makes the environment of a lock."""

    def make(lock: Lock, *, python: Interpreter = host, index: IndexSettings = offline_index) -> Environment | Step:
        return install(lock, python, question("anything", index=index))

    return make


def expect_environment(answer: Environment | Step) -> Environment:
    """Return the answer, which must be an environment."""
    assert isinstance(answer, Environment), answer
    return answer


def site(environment: Environment) -> Path:
    """Return the folder of an environment's packages."""
    return next(environment.path.glob("lib/python*/site-packages"))


@contextmanager
def use_elsewhere(environment: Environment) -> Iterator[None]:
    """Let another process use the environment during the block."""
    code = "import sys, pathlib; from harness.machine.files import file_locks\n"
    code += "file_locks.mark_used(pathlib.Path(sys.argv[1])); print('used', flush=True); sys.stdin.read()"
    argv = [sys.executable, "-c", code, str(environment.path)]
    with subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert process.stdout.readline() == "used\n"
        yield
        process.communicate(timeout=60)


class TestContent:
    def test_lock_and_nothing_else(self, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step]) -> None:
        """An environment holds the versions of its lock and no package more: no pip, no setuptools."""
        environment = expect_environment(ensure(lock("fake-needs-plain")))

        assert environment.installed == {"fake-needs-plain": "1.0", "fake-plain": "3.0"}
        assert sorted(path.name for path in site(environment).iterdir() if not path.name.startswith("_virtualenv")) == [
            "fake_needs_plain-1.0.dist-info",
            "fake_needs_plain.py",
            "fake_plain-3.0.dist-info",
            "fake_plain.py",
        ]

    @pytest.mark.parametrize("version", ["3.7", "3.8", "3.9", "3.10", "3.11", "3.12", "3.13", "3.14"])
    def test_every_python(
        self, version: str, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step]
    ) -> None:
        """An environment can be made for every Python that is supported."""
        from harness.machine import interpreters

        python = interpreters.find(version)
        if python is None:
            pytest.skip(f"unavailable: python{version}")
        environment = expect_environment(ensure(lock("fake-plain", python=python), python=python))

        assert site(environment).parent.name == f"python{version}"
        assert environment.installed == {"fake-plain": "3.0"}

    def test_without_packages(self, ensure: Callable[..., Environment | Step], lock: Callable[..., Lock]) -> None:
        """A lock without packages has an environment without packages."""
        empty = replace(lock("fake-plain"), pins=())

        assert expect_environment(ensure(empty)).installed == {}

    def test_bound_on_python_is_a_finding(
        self, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step], host: Interpreter
    ) -> None:
        """An upper bound on the Python version, which uv ignores, is a finding."""
        assert [finding.text for finding in expect_environment(ensure(lock("fake-old-python"))).findings] == [
            f"fake-old-python 1.0 requires Python <3.7: uv installs it on {host.version}, pip refuses"
        ]


class TestKey:
    def wheel(self, name: str, mark: str, version: str = "1.0") -> Wheel:
        """Describe a wheel."""
        return Wheel(name=name, version=version, mark=mark, artifact=Artifact(filename="x", sha256="", source=""))

    def test_function_of_interpreter_and_wheels(self, host: Interpreter) -> None:
        """The key depends on the interpreter's identity and on name, version and mark of each wheel."""
        a, b = self.wheel("a", "1"), self.wheel("b", "2")
        key = environment_key(host, [a, b])

        assert key == environment_key(host, [b, a])
        others = [
            environment_key(replace(host, identity="another"), [a, b]),
            environment_key(host, [a]),
            environment_key(host, [a, self.wheel("b", "3")]),
            environment_key(host, [a, self.wheel("b", "2", version="2.0")]),
        ]
        assert len({key, *others}) == 5

    def test_rebuilt_wheel_same_key(
        self, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step], tmp_path: Path
    ) -> None:
        """An sdist that is built again, after the cache was emptied, leads to the same key."""
        pinned = lock("fake-build-dependent")
        first = expect_environment(ensure(pinned)).key
        shutil.rmtree(tmp_path / "cache")

        assert expect_environment(ensure(pinned)).key == first


class TestReuse:
    def test_second_time(self, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step]) -> None:
        """An environment is made once and reused afterwards."""
        pinned = lock("fake-needs-plain")
        first, second = expect_environment(ensure(pinned)), expect_environment(ensure(pinned))

        assert (first.reused, second.reused) == (False, True)
        assert (first.path, first.installed) == (second.path, second.installed)

    @pytest.mark.parametrize("defect", ["no-stamp", "another-key", "broken-stamp", "another-package", "no-python"])
    def test_a_damaged_environment_is_rebuilt(
        self, defect: str, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step]
    ) -> None:
        """An environment without the right stamp, or changed since, is removed and made anew, never synced over."""
        pinned = lock("fake-needs-plain")
        environment = expect_environment(ensure(pinned))
        (site(environment) / "left_over.py").touch()
        stamp = environment.path / "stamp.json"
        match defect:
            case "no-stamp":
                stamp.unlink()
            case "another-key":
                stamp.write_text(stamp.read_text().replace(environment.key, "0" * 32))
            case "broken-stamp":
                stamp.write_text(stamp.read_text()[:-5])
            case "another-package":
                shutil.copytree(
                    site(environment) / "fake_plain-3.0.dist-info", site(environment) / "fake_more-1.0.dist-info"
                )
                text = (site(environment) / "fake_more-1.0.dist-info" / "METADATA").read_text()
                (site(environment) / "fake_more-1.0.dist-info" / "METADATA").unlink()
                (site(environment) / "fake_more-1.0.dist-info" / "METADATA").write_text(
                    text.replace("fake-plain", "fake-more")
                )
            case "no-python":
                environment.python.unlink()
        again = expect_environment(ensure(pinned))

        assert not again.reused
        assert again.path == environment.path
        assert not (site(again) / "left_over.py").exists()
        assert again.installed == environment.installed

    def test_linked_files_are_not_kept_unsealed(
        self,
        lock: Callable[..., Lock],
        ensure: Callable[..., Environment | Step],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        """If environments cannot be sealed, their files are copies: one with hard links is made again."""
        pinned = lock("fake-plain")
        linked = expect_environment(ensure(pinned))
        shared = (site(linked) / "fake_plain.py").stat().st_nlink
        monkeypatch.setenv("HARNESS_SANDBOX", "subreaper")
        copied = expect_environment(ensure(pinned))

        assert shared > 1
        assert not copied.reused
        assert (site(copied) / "fake_plain.py").stat().st_nlink == 1

    def test_an_environment_in_use_stays(
        self,
        lock: Callable[..., Lock],
        ensure: Callable[..., Environment | Step],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        """An environment that another process uses is never deleted: its replacement is made beside it."""
        pinned = lock("fake-plain")
        linked = expect_environment(ensure(pinned))
        with use_elsewhere(linked):
            monkeypatch.setenv("HARNESS_SANDBOX", "subreaper")
            copied, again = expect_environment(ensure(pinned)), expect_environment(ensure(pinned))
            environments.discard(linked)
            monkeypatch.delenv("HARNESS_SANDBOX")
            anew = expect_environment(ensure(pinned))
            assert (site(linked) / "fake_plain.py").stat().st_nlink > 1

        assert not environments.is_intact(linked)
        assert (copied.key, copied.path.name) == (linked.key, f"{linked.key}-1")
        assert (copied.reused, again.reused, again.path) == (False, True, copied.path)
        assert (site(copied) / "fake_plain.py").stat().st_nlink == 1
        assert (anew.path, anew.reused) == (copied.path, True)
        assert (expect_environment(ensure(pinned)).path, expect_environment(ensure(pinned)).path) == (
            linked.path,
            linked.path,
        )

    def test_two_at_once(
        self, lock: Callable[..., Lock], host: Interpreter, offline_index: IndexSettings, tmp_path: Path
    ) -> None:
        """Of two processes that want one environment at once, one makes it and the other waits for it."""
        code = (
            "import sys, msgspec; from harness.packages.environments import environments; from harness.model import *\n"
            "lock, python, question = msgspec.json.decode(sys.argv[1], type=tuple[Lock, Interpreter, Question])\n"
            "print(environments.ensure(lock, python, question).reused)"
        )
        import msgspec

        wanted = (lock("fake-needs-plain"), host, question("anything", index=offline_index))
        argv = [sys.executable, "-c", code, msgspec.json.encode(wanted).decode()]
        running = [subprocess.Popen(argv, stdout=subprocess.PIPE, text=True) for _ in range(2)]
        said = sorted(process.communicate(timeout=60)[0].strip() for process in running)

        assert said == ["False", "True"]


class TestReinstall:
    def test_empty_cache(
        self,
        lock: Callable[..., Lock],
        ensure: Callable[..., Environment | Step],
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        """The same lock with an empty cache gives the same packages, file by file."""
        pinned = lock("fake-needs-plain", "fake-build-dependent")
        first = expect_environment(ensure(pinned))
        monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "elsewhere"))
        second = expect_environment(ensure(pinned))

        def content(environment: Environment) -> dict[str, bytes]:
            names = [path for path in site(environment).rglob("*") if path.is_file() and path.name != "uv_cache.json"]
            return {
                path.relative_to(site(environment)).as_posix(): path.read_bytes()
                for path in names
                if path.name != "RECORD"
            }

        assert not second.reused
        assert second.path != first.path
        assert second.installed == first.installed
        assert content(second) == content(first)


def link(path: Path) -> str:
    """Return a file's link as an index writes it."""
    digest = sha256(path.read_bytes()).hexdigest()
    return f'<a href="/files/{path.name}#sha256={digest}" data-upload-time="2024-01-01T00:00:00Z">{path.name}</a>'


class TestLogin:
    def test_files_of_a_private_index(
        self,
        host: Interpreter,
        ensure: Callable[..., Environment | Step],
        serve: Callable[..., str],
        wheelhouse: Path,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        """The login of an index is used for its files too, and is written down nowhere."""
        login = "Basic " + b64encode(b"me:secret").decode()

        def answer(handler: BaseHTTPRequestHandler) -> None:
            if handler.headers.get("Authorization") != login:
                send(handler, 401)
                return
            name = handler.path.rpartition("/")[2]
            path = wheelhouse / "fake_plain-1.0-py3-none-any.whl"
            send(handler, 200, path.read_bytes() if name == path.name else link(path).encode())

        monkeypatch.setenv("UV_DEFAULT_INDEX", serve(answer).replace("//", "//me:secret@"))
        pinned = expect_lock(
            resolver.resolve(question("fake-plain", index=IndexSettings()), host, tmp_path / "state" / "x")
        )
        environment = expect_environment(ensure(pinned, index=IndexSettings()))

        assert environment.installed == {"fake-plain": "1.0"}
        kept = [path.read_text() for path in (tmp_path / "state").rglob("*") if path.is_file()]
        assert not any("secret" in text for text in kept)


class TestDownloads:
    def test_an_index_that_says_nothing_of_keeping(
        self,
        host: Interpreter,
        ensure: Callable[..., Environment | Step],
        serve: Callable[..., str],
        wheelhouse: Path,
        tmp_path: Path,
    ) -> None:
        """A file that was fetched for one environment is not fetched again for the next one."""
        asked: list[str] = []

        def answer(handler: BaseHTTPRequestHandler) -> None:
            name = handler.path.rpartition("/")[2]
            path = wheelhouse / name
            asked.append(name)
            if path.is_file():
                send(handler, 200, path.read_bytes())
                return
            project = handler.path.rstrip("/").rpartition("/")[2].replace("-", "_")
            send(handler, 200, "".join(map(link, wheelhouse.glob(f"{project}-*.whl"))).encode())

        index = IndexSettings(default=serve(answer))
        pins = [
            expect_lock(resolver.resolve(question(name, index=index), host, tmp_path / "state" / name))
            for name in ("fake-plain", "fake-needs-plain")
        ]
        first = expect_environment(ensure(pins[0], index=index))
        asked.clear()
        second = expect_environment(ensure(pins[1], index=index))

        assert (first.installed.keys(), second.installed.keys()) == ({"fake-plain"}, {"fake-plain", "fake-needs-plain"})
        assert [name for name in asked if name.endswith(".whl")] == ["fake_needs_plain-1.0-py3-none-any.whl"]


class TestDamage:
    def test_changed_files(self, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step]) -> None:
        """Files that a cell wrote over, or removed, are found by the hashes of RECORD, each with its package."""
        environment = expect_environment(ensure(lock("fake-needs-plain")))
        assert environments.is_intact(environment, thorough=True)
        changed, gone = site(environment) / "fake_plain.py", site(environment) / "fake_needs_plain.py"
        text = changed.read_text()
        changed.unlink()
        changed.write_text(text[:-2] + "#\n")  # of the same size
        gone.unlink()
        folder = site(environment).relative_to(environment.path).as_posix()

        assert environment_damage.find_damage(environment.path, thorough=False) == {
            f"{folder}/fake_needs_plain.py": "fake-needs-plain",
            f"{folder}/fake_plain.py": "fake-plain",
        }
        assert not environments.is_intact(environment)

    def test_files_that_are_no_code_are_compared_by_hash_only_thoroughly(
        self, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step]
    ) -> None:
        """A quick check compares sizes of files that are no code; a thorough one compares their hashes."""
        environment = expect_environment(ensure(lock("fake-plain")))
        metadata = next(site(environment).glob("*.dist-info/WHEEL"))
        content = metadata.read_bytes()
        metadata.unlink()
        metadata.write_bytes(content[:-1] + b" ")

        assert environments.is_intact(environment)
        assert not environments.is_intact(environment, thorough=True)

    @pytest.mark.parametrize("how", ["garbage", "gone", "folder", "link"])
    def test_an_environment_without_its_configuration_is_rebuilt(
        self, how: str, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step]
    ) -> None:
        """An environment without its pyvenv.cfg is made again: its Python finds nothing, and no package is at fault."""
        first = expect_environment(ensure(lock("fake-plain")))
        config = first.path / "pyvenv.cfg"
        config.unlink()
        match how:
            case "garbage":
                config.write_bytes(b"\xff" * 90)
            case "folder":
                config.mkdir()
            case "link":
                config.symlink_to(config)

        assert not environments.is_intact(first)
        again = expect_environment(ensure(lock("fake-plain")))
        assert (again.reused, config.is_file(), environments.is_intact(again)) == (False, True, True)

    def test_uv_s_cache_is_doubted(self, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step]) -> None:
        """A wheel damaged in uv's cache is unpacked again and checked again."""
        first = expect_environment(ensure(lock("fake-plain")))
        good = (site(first) / "fake_plain.py").read_bytes()
        for kept in (uv_command.shared_cache() / "archive-v0").glob("*/fake_plain.py"):
            kept.unlink()
            kept.write_bytes(b"#" * len(good))
        environments.discard(first)

        again = expect_environment(ensure(lock("fake-plain")))
        assert (again.reused, again.findings) == (False, ())
        assert (site(again) / "fake_plain.py").read_bytes() == good
        assert environments.is_intact(again, thorough=True)

    def test_a_file_that_uv_s_cache_lost_is_no_package_s_fault(
        self, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step]
    ) -> None:
        """An install that fails is tried once more from fresh downloads."""
        first = expect_environment(ensure(lock("fake-plain")))
        for kept in (uv_command.shared_cache() / "archive-v0").glob("*/*.dist-info/WHEEL"):
            kept.unlink()
        environments.discard(first)

        assert expect_environment(ensure(lock("fake-plain"))).findings == ()

    def test_one_that_is_used_is_left_where_it_is(
        self, lock: Callable[..., Lock], ensure: Callable[..., Environment | Step]
    ) -> None:
        """A damaged environment in use is kept for its user: the next one is made beside it."""
        first = expect_environment(ensure(lock("fake-plain")))
        environments.discard(first, used=True)

        again = expect_environment(ensure(lock("fake-plain")))
        assert (again.path.name, first.path.is_dir()) == (f"{first.key}-1", True)

    def test_a_wheel_whose_record_is_wrong_is_no_damage(
        self, host: Interpreter, ensure: Callable[..., Environment | Step], tmp_path: Path
    ) -> None:
        """A file that differs from RECORD in a fresh download, too, is a note, and the environment is used."""
        wheel = fakes.wheel(tmp_path, "1.0", {"odd.py": "A = 1\n"}, {"name": "odd"})
        content = wheel.read_bytes()
        other = tmp_path / "other.whl"
        with zipfile.ZipFile(wheel) as read, zipfile.ZipFile(other, "w") as write:
            for name in read.namelist():
                write.writestr(name, "A = 2\n" if name == "odd.py" else read.read(name))
        other.replace(wheel)
        assert wheel.read_bytes() != content
        asked = question(f"odd @ {wheel.as_uri()}", index=IndexSettings(no_index=True))
        environment = expect_environment(ensure(expect_lock(resolver.resolve(asked, host, tmp_path / "state" / "x"))))

        assert [(found.check, found.level) for found in environment.findings] == [("install.record", Level.NOTE)]
        assert environments.is_intact(environment, thorough=True)

    def test_a_wheel_that_replaces_python_is_uninstallable(
        self, host: Interpreter, ensure: Callable[..., Environment | Step], tmp_path: Path
    ) -> None:
        """A wheel that replaces Python is uninstallable: a cell must hold exactly its lock."""
        text = "include-system-site-packages = true\n"
        wheel = fakes.wheel(tmp_path, "1.0", {"odd-1.0.data/data/pyvenv.cfg": text}, {"name": "odd"})
        asked = question(f"odd @ {wheel.as_uri()}", index=IndexSettings(no_index=True))
        step = ensure(expect_lock(resolver.resolve(asked, host, tmp_path / "state" / "x")))

        assert isinstance(step, Step)
        assert (step.phase, step.outcome) == (Phase.INSTALL, Outcome.FAILED)
        assert step.decisive == (
            "odd 1.0 replaces pyvenv.cfg or bin/python, by which the environment is kept apart from others"
        )


class TestTrouble:
    def test_another_file(self, host: Interpreter, ensure: Callable[..., Environment | Step], tmp_path: Path) -> None:
        """A wheel that is another file than the one locked is infra: no verdict about the package."""
        folder = fakes.make(tmp_path / "wheels", "undeclared")
        index = IndexSettings(no_index=True, find_links=(str(folder),))
        pinned = expect_lock(resolver.resolve(question("fake-undeclared", index=index), host, tmp_path / "state" / "x"))
        about = {"name": "fake-undeclared"}
        fakes.wheel(folder, "1.0", {"fake_undeclared.py": "another = 1\n"}, about)
        shutil.rmtree(tmp_path / "cache")
        phase, outcome, decisive = expect_failure(ensure(pinned, index=index))

        assert (phase, outcome) == (Phase.INSTALL, Outcome.INFRA)
        assert decisive is not None
        assert "Hash mismatch for `fake-undeclared==1.0`" in decisive

    def test_gone_file(self, host: Interpreter, ensure: Callable[..., Environment | Step], tmp_path: Path) -> None:
        """A wheel that is not in its place any more is infra, and leaves no environment behind."""
        folder = fakes.make(tmp_path / "wheels", "undeclared")
        index = IndexSettings(no_index=True, find_links=(str(folder),))
        pinned = expect_lock(resolver.resolve(question("fake-undeclared", index=index), host, tmp_path / "state" / "x"))
        shutil.rmtree(folder)
        shutil.rmtree(tmp_path / "cache")

        assert expect_failure(ensure(pinned, index=index))[:2] == (Phase.INSTALL, Outcome.INFRA)
        assert not list((tmp_path / "cache" / "environments").glob("*/"))

    def test_wheel_of_another_version(
        self, host: Interpreter, ensure: Callable[..., Environment | Step], tmp_path: Path
    ) -> None:
        """A wheel whose metadata contradict its name is the package's own fault."""
        folder = tmp_path / "wheels"
        folder.mkdir()
        path = fakes.wheel(folder, "1.0", {"fake_odd.py": ""}, {"name": "fake-odd"})
        index = IndexSettings(no_index=True, find_links=(str(folder),))
        pinned = expect_lock(resolver.resolve(question("fake-odd", index=index), host, tmp_path / "state" / "x"))
        odd = path.rename(folder / "fake_odd-2.0-py3-none-any.whl")
        artifact = replace(pinned.pins[0].artifact, filename=odd.name, source=odd.as_uri())
        phase, outcome, decisive = expect_failure(
            ensure(replace(pinned, pins=(replace(pinned.pins[0], version="2.0", artifact=artifact),)), index=index)
        )

        assert (phase, outcome) == (Phase.INSTALL, Outcome.FAILED)
        assert decisive is not None
        assert "Wheel version does not match filename (1.0 != 2.0)" in decisive

    def test_wheel_that_brings_another_package(
        self, host: Interpreter, ensure: Callable[..., Environment | Step], tmp_path: Path
    ) -> None:
        """A wheel that adds another package is at fault: an environment holds exactly the packages of its lock."""
        folder = tmp_path / "wheels"
        folder.mkdir()
        stowaway = "fake_sneaky-1.0.data/purelib/fake_plain-9.9.dist-info/METADATA"
        metadata = "Metadata-Version: 2.1\nName: fake-plain\nVersion: 9.9\n"
        fakes.wheel(folder, "1.0", {"fake_sneaky.py": "", stowaway: metadata}, {"name": "fake-sneaky"})
        index = IndexSettings(no_index=True, find_links=(str(folder),))
        pinned = expect_lock(resolver.resolve(question("fake-sneaky", index=index), host, tmp_path / "state" / "x"))

        assert expect_failure(ensure(pinned, index=index)) == (
            Phase.INSTALL,
            Outcome.FAILED,
            "after the install these packages are not those of the lock: fake-plain 9.9",
        )

    def test_install_that_leaves_something_out(
        self,
        lock: Callable[..., Lock],
        ensure: Callable[..., Environment | Step],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        """A package of the lock that is missing after a successful install says nothing about packages."""
        only_one = environments.locks.format_pylock
        monkeypatch.setattr(environments.locks, "format_pylock", lambda wheels: only_one(list(wheels)[:1]))

        assert expect_failure(ensure(lock("fake-needs-plain"))) == (
            Phase.INSTALL,
            Outcome.INFRA,
            "after the install these packages of the lock are not there: fake-plain 3.0",
        )


class TestAnnouncement:
    def test_large_download(self, caplog: pytest.LogCaptureFixture) -> None:
        """Downloads above 500 MB are announced first; files in the cache do not count."""

        def artifact(name: str, size: int) -> Artifact:
            return Artifact(filename=f"{name}.whl", sha256=name, source=f"http://127.0.0.1:9/{name}.whl", size=size)

        files = [artifact("big", 900_000_000), artifact("small", 100_000_000), artifact("known", 900_000_000)]
        download_notice.announce(files[1:], frozenset({"known"}))
        quiet = caplog.messages.copy()
        download_notice.announce(files, frozenset({"known"}))

        assert quiet == []
        assert caplog.messages == ["about to download 1.0 GB (big.whl alone 0.9 GB)"]


class TestLocksBetweenProcesses:
    def test_without_flock(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        """If the file system refuses flock, a lock file is used, with one warning."""
        import errno
        import fcntl

        def refuse(*_: object) -> None:
            raise OSError(errno.ENOLCK, "No locks available")

        monkeypatch.setattr(fcntl, "flock", refuse)
        for _ in range(2):
            with file_locks.exclusive(tmp_path / "one.lock"):
                assert (tmp_path / "one.lock-soft").exists()

        assert not (tmp_path / "one.lock-soft").exists()
        assert caplog.messages == [
            f"{tmp_path} is on a file system without flock: lock files are used; "
            "after a crash remove those that end in -soft"
        ]
