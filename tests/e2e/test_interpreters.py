"""Find Pythons on a real machine, and on small ones made of links, scripts and virtual environments."""

import sys
import venv
from pathlib import Path

import pytest
from packaging.version import Version

from harness.machine.interpreters import active_version, available, find, forget, hint, obtain
from harness.model import Interpreter

BASE = Path(sys.base_prefix, "bin", "python{}.{}".format(*sys.version_info)).resolve()


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the cache folder of these tests, so that the machine's interpreters are examined once."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, answers: Path) -> Path:
    """Use an empty working folder and no active environment."""
    monkeypatch.setenv("HARNESS_CACHE", str(answers))
    for name in ("VIRTUAL_ENV", "CONDA_PREFIX", "UV_PYTHON_DOWNLOADS", "UV_OFFLINE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    forget()
    return tmp_path


def alone(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Simulate a machine with one folder on PATH and no version manager in the home."""
    folder.mkdir(parents=True, exist_ok=True)
    monkeypatch.setenv("PATH", f"{folder}:/nowhere")
    monkeypatch.setenv("HOME", str(folder.parent / "home"))
    for name in ("PYENV_ROOT", "ASDF_DATA_DIR", "UV_PYTHON_INSTALL_DIR", "RYE_PY_ROOT", "XDG_DATA_HOME"):
        monkeypatch.delenv(name, raising=False)
    forget()


def another() -> Interpreter:
    """Return an interpreter of another minor version than the one that runs the tests."""
    minor = "{}.{}".format(*sys.version_info)
    others = [one for one in available() if one.minor != minor and one.implementation == "cpython"]
    if not others:
        pytest.skip("unavailable: a second Python version")
    return others[0]


def script(path: Path, *lines: str) -> Path:
    """Write an executable shell script."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(["#!/bin/sh", *lines, ""]))
    path.chmod(0o755)
    return path


class TestFind:
    @pytest.mark.parametrize("minor", ["3.7", "3.8", "3.9", "3.10", "3.11", "3.12", "3.13", "3.14"])
    def test_a_minor_version_means_its_newest_patch(self, minor: str) -> None:
        """Of all interpreters of a minor version the newest patch is taken; it is no link."""
        patches = [one for one in available() if one.minor == minor and one.implementation == "cpython"]
        if not patches:
            pytest.skip(f"unavailable: python{minor}")

        found = find(minor)

        assert found is not None
        assert Version(found.version) == max(Version(one.version) for one in patches)
        assert find(found.version) == found
        assert Path(found.path).resolve() == Path(found.path)

    def test_host_is_the_base_of_the_running_python(self) -> None:
        """`host` means the Python below the harness's own environment."""
        assert find("host") == find(str(BASE))

    @pytest.mark.parametrize("symlinks", [True, False], ids=["links", "copies"])
    def test_a_virtual_environment_means_its_base(self, fresh: Path, symlinks: bool) -> None:
        """An environment's interpreter, or its folder, stands for the Python below it."""
        venv.create(fresh / "env", symlinks=symlinks)

        assert find(str(fresh / "env/bin/python")) == find(str(fresh / "env")) == find(str(BASE))

    @pytest.mark.parametrize("request_", ["3.6", "3.99", "3.11.99", "pypy2.7", "nonsense", "./gone", "/etc"])
    def test_an_absent_python_is_not_found(self, request_: str) -> None:
        """An old, absent or unreadable request gives nothing, no exception."""
        assert find(request_) is None

    def test_a_program_that_is_no_python_is_not_found(self, fresh: Path) -> None:
        """A script that fails and a file that cannot run at all are no interpreters."""
        script(fresh / "refuses", "echo no >&2", "exit 127")
        (fresh / "python3").write_text("text")

        assert find(str(fresh / "refuses")) is None
        assert find(str(fresh / "python3")) is None

    def test_identities_differ(self) -> None:
        """Two interpreters never share an identity, or a path."""
        found = available()

        assert len({one.identity for one in found}) == len({one.path for one in found}) == len(found)


class TestDiscovery:
    def test_a_name_that_tells_another_minor_is_not_started(self, monkeypatch: pytest.MonkeyPatch, fresh: Path) -> None:
        """A Python whose name gives another minor version is not started: that would be most of a short run."""
        alone(monkeypatch, fresh / "bin")
        script(fresh / "bin" / "python3.99", f": > {fresh}/started", "exit 1")

        assert find("3.98") is None
        assert not (fresh / "started").exists()
        assert find("3.99") is None
        assert (fresh / "started").exists()

    def test_pyenv_versions_behind_refusing_shims(self, monkeypatch: pytest.MonkeyPatch, fresh: Path) -> None:
        """A shim that refuses does not hide the version behind it, and is never started."""
        other = another()
        root = fresh / "pyenv"
        alone(monkeypatch, root / "shims")
        script(root / "shims" / f"python{other.minor}", f": > {fresh}/started", "exit 127")
        (root / "versions/any/bin").mkdir(parents=True)
        (root / "versions/any/bin/python").symlink_to(other.path)
        monkeypatch.setenv("PYENV_ROOT", str(root))

        assert find(other.minor) == other
        assert not (fresh / "started").exists()

    @pytest.mark.parametrize("ours", [True, False], ids=["the cache folder", "uv's folder"])
    def test_pythons_that_uv_manages(self, monkeypatch: pytest.MonkeyPatch, fresh: Path, ours: bool) -> None:
        """uv's interpreters are found, those of the user and those that the harness had downloaded."""
        other = another()
        alone(monkeypatch, fresh / "bin")
        monkeypatch.setenv("HARNESS_CACHE", str(fresh / "cache"))
        folder = fresh / ("cache/pythons" if ours else "home/.local/share/uv/python")
        (folder / "cpython-any/bin").mkdir(parents=True)
        (folder / "cpython-any/bin/python3").symlink_to(other.path)

        assert find(other.minor) == other

    def test_an_interpreter_is_asked_once(self, fresh: Path) -> None:
        """Another process takes the answer from the cache folder, until the file changes."""
        wrapper = script(fresh / "python3", f"echo >> {fresh}/asked", f'exec {BASE} "$@"')
        times = []
        for text in (None, None, "# changed\n"):
            if text is not None:
                wrapper.write_text(wrapper.read_text() + text)
            forget()

            assert find(str(wrapper)) == find(str(BASE))
            times.append((fresh / "asked").read_text().count("\n"))

        assert times == [1, 1, 2]

    def test_a_broken_cache_is_rebuilt(self, monkeypatch: pytest.MonkeyPatch, fresh: Path) -> None:
        """A cache file that cannot be read costs time, nothing else."""
        monkeypatch.setenv("HARNESS_CACHE", str(fresh / "cache"))
        before = find("host")
        (fresh / "cache/interpreters.json").write_text("{")
        forget()

        assert find("host") == before


class TestActiveVersion:
    def test_none_without_an_environment(self) -> None:
        """Without a variable or a `.venv` there is no active version."""
        assert active_version() is None

    @pytest.mark.parametrize("variable", ["VIRTUAL_ENV", "CONDA_PREFIX", None])
    def test_of_the_environment_in_use(
        self, monkeypatch: pytest.MonkeyPatch, fresh: Path, variable: str | None
    ) -> None:
        """The environment that a variable names, else `.venv` in the working folder."""
        venv.create(fresh / (".venv" if variable is None else "env"), symlinks=True)
        if variable is not None:
            monkeypatch.setenv(variable, str(fresh / "env"))

        assert active_version() == "{}.{}.{}".format(*sys.version_info)


@pytest.fixture
def refusing_uv(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Put a uv in place of ours that downloads nothing; return the file in which it notes its calls."""
    calls = fresh / "calls.txt"
    program = script(fresh / "uv", f'echo "$@" >> {calls}', "exit 1")
    monkeypatch.setattr("uv.find_uv_bin", lambda: str(program))
    return calls


def calls_of(calls: Path) -> list[str]:
    """Return the command lines that the uv of the test was called with."""
    return calls.read_text().splitlines() if calls.exists() else []


class TestObtain:
    def test_an_interpreter_that_is_here_is_not_downloaded(self) -> None:
        """`obtain` downloads nothing if `find` finds an interpreter."""
        assert obtain("host") == find("host")

    @pytest.mark.parametrize("forbidden", ["offline", "UV_PYTHON_DOWNLOADS", "UV_OFFLINE"])
    def test_a_forbidden_download_is_not_tried(
        self, monkeypatch: pytest.MonkeyPatch, refusing_uv: Path, forbidden: str
    ) -> None:
        """A download forbidden by `--offline` or by the user's uv settings is not tried."""
        if forbidden != "offline":
            monkeypatch.setenv(forbidden, "never" if forbidden == "UV_PYTHON_DOWNLOADS" else "1")

        assert obtain("3.99", offline=forbidden == "offline") is None
        assert calls_of(refusing_uv) == []

    def test_a_failed_download_is_tried_once(self, refusing_uv: Path) -> None:
        """A failed download is remembered for the process and not tried again, until everything is forgotten."""
        assert (obtain("3.99"), obtain("3.99")) == (None, None)
        assert calls_of(refusing_uv) == ["python install --no-bin 3.99"]

        forget()
        assert obtain("3.99") is None
        assert len(calls_of(refusing_uv)) == 2


@pytest.mark.parametrize(
    ("request_", "sentence"),
    [
        (
            "3.14",
            "python 3.14 is not on this machine and uv could not download it; "
            "install it with `uv python install 3.14` or pyenv, then run again",
        ),
        ("3.6", "python 3.6 is older than 3.7, the oldest that can be tried"),
        ("./python", "there is no Python at ./python; name an executable, or a version such as 3.11"),
        ("eleven", "'eleven' names no Python; write a version such as 3.11 or 3.11.7, host, or a path"),
    ],
)
def test_hints_say_what_to_do(request_: str, sentence: str) -> None:
    """The reason of an unavailable cell is one sentence with the next step."""
    assert hint(request_) == sentence


def test_hints_know_what_uv_may_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the user forbids downloads, the sentence says so."""
    monkeypatch.setenv("UV_PYTHON_DOWNLOADS", "never")

    assert hint("3.14") == (
        "python 3.14 is not on this machine and uv may not download it; "
        "install it with `uv python install 3.14` or pyenv, then run again"
    )
