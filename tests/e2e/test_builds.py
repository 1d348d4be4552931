"""Wheels made from the sdists of fakes, in real build environments under the supervisor."""

import json
import sys
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import pytest
import wheelhouse as fakes
from asking import expect_failure, expect_lock, install, question

from harness.machine import process
from harness.model import IndexSettings, Interpreter, Lock, Outcome, Phase, Step, replace
from harness.packages import resolver
from harness.packages.environments.environments import Environment
from harness.packages.sources import builds

pytestmark = pytest.mark.usefixtures("workplace")

Make = Callable[..., Environment | Step]


@pytest.fixture
def make(host: Interpreter, offline_index: IndexSettings, tmp_path: Path) -> Make:
    """Return a function that locks and installs fakes with the host's Python."""

    def ensure(*requirements: str, python: Interpreter = host, **more: object) -> Environment | Step:
        asked = question(*requirements, **{"index": offline_index, **more})
        return install(expect_lock(resolver.resolve(asked, python, tmp_path / "state" / "x")), python, asked)

    return ensure


def expect_environment(answer: Environment | Step) -> Environment:
    """Return the answer, which must be an environment."""
    assert isinstance(answer, Environment), answer
    return answer


def values(environment: Environment, module: str, folder: Path) -> dict[str, str]:
    """Return the capitals of a module, as the environment's own Python sees them."""
    code = f"import json, {module} as m; print(json.dumps({{k: v for k, v in vars(m).items() if k.isupper()}}))"
    command = process.Command(
        argv=(str(environment.python), "-c", code),
        cwd=folder,
        env={},
        limits=process.Limits(seconds=60),
        log=folder / "values.log",
        profile=process.Profile.HOST,
    )
    assert process.run(command).exit_code == 0, command.log.read_text()
    found: dict[str, str] = json.loads(command.log.read_text())
    return found


@pytest.mark.parametrize("order", [("1.0", "2.0"), ("2.0", "1.0")], ids=["old-first", "new-first"])
def test_one_sdist_four_wheels(
    make: Make, host: Interpreter, other: Interpreter, order: tuple[str, str], tmp_path: Path
) -> None:
    """One sdist under two build constraints, in both orders and on two Pythons, gives four right wheels."""
    found = {}
    for python in (host, other):
        for tool in order:
            environment = expect_environment(
                make("fake-build-dependent", python=python, build_constraints=(f"fake-build-tool=={tool}",))
            )
            seen = values(environment, "fake_build_dependent", tmp_path)
            found[python.minor, tool] = seen["BUILT_ON"], seen["BUILT_WITH"]
            assert environment.installed == {"fake-build-dependent": "1.0", "fake-plain": tool}

    assert found == {key: key for key in found}
    assert len(found) == 4
    assert len({path.read_bytes() for path in (tmp_path / "cache" / "wheels").glob("*/*.whl")}) == 4


def test_build_variables_make_another_wheel(make: Make, tmp_path: Path) -> None:
    """A build variable is seen by the build, and belongs to the key of its wheel."""
    plain = expect_environment(make("fake-build-dependent"))
    sweet = expect_environment(make("fake-build-dependent", build_variables={"FAKE_FLAVOUR": "sweet"}))

    assert values(plain, "fake_build_dependent", tmp_path)["FLAVOUR"] == "none"
    assert values(sweet, "fake_build_dependent", tmp_path)["FLAVOUR"] == "sweet"
    assert plain.key != sweet.key


def test_host_variables_stay_outside(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A variable of the user's shell reaches neither the metadata of an sdist nor its build."""
    monkeypatch.setenv("FAKE_FLAVOUR", "bitter")

    assert (
        values(expect_environment(make("fake-build-dependent")), "fake_build_dependent", tmp_path)["FLAVOUR"] == "none"
    )


def test_built_once(make: Make, host: Interpreter, offline_index: IndexSettings, tmp_path: Path) -> None:
    """A second request takes the wheel from the store, without a build environment."""
    expect_environment(make("fake-build-dependent"))
    asked = question("fake-build-dependent", "fake-needs-plain", index=offline_index)
    lock = expect_lock(resolver.resolve(asked, host, tmp_path / "state" / "x"))
    pin = next(pin for pin in lock.pins if not pin.artifact.is_wheel)

    def provide(*_: object, **__: object) -> Environment:
        raise AssertionError

    assert isinstance(builds.build(pin, host, asked, provide), builds.Built)


def test_backend_asks_for_more(make: Make, tmp_path: Path) -> None:
    """A package that only `get_requires_for_build_wheel` names is in the build environment, within its bounds."""
    environment = expect_environment(make("fake-build-asks-more"))

    assert values(environment, "fake_build_asks_more", tmp_path) == {"BUILT_WITH": "1.0"}
    assert environment.installed == {"fake-build-asks-more": "1.0"}


def test_a_built_wheel_has_a_note(make: Make) -> None:
    """A wheel that was built here has a note that says so."""
    assert [finding.text for finding in expect_environment(make("fake-build-asks-more")).findings] == [
        "fake-build-asks-more 1.0 has no wheel for this Python and was built from its sdist"
    ]


@pytest.mark.parametrize(
    ("requirement", "outcome", "decisive"),
    [
        pytest.param(
            "fake-build-failure",
            Outcome.FAILED,
            "RuntimeError: FAKE_PATH environment variable is not set",
            id="backend-raises",
        ),
        pytest.param(
            "fake-build-circle",
            Outcome.FAILED,
            "fake-build-circle 1.0: its build requirements: build requirements go in a circle: "
            "fake-build-circle -> fake-build-circle",
            id="circle",
        ),
        pytest.param(
            "fake-metadata-changing",
            Outcome.FAILED,
            "fake-metadata-changing 1.0, once built, requires fake-plain>=2, which the lock does not hold",
            id="other-requirements",
        ),
        pytest.param(
            "fake-build-offline",
            Outcome.INFRA,
            "urllib.error.URLError: <urlopen error [Errno -2] Name or service not known>",
            id="vendor-unreachable",
        ),
    ],
)
def test_failing_build(make: Make, requirement: str, outcome: Outcome, decisive: str) -> None:
    """A failed build is a failed install with the backend's last word; a host that cannot be found is infra."""
    assert expect_failure(make(requirement)) == (Phase.INSTALL, outcome, decisive)


def test_log_names_no_folder_of_this_machine(make: Make, tmp_path: Path) -> None:
    """The log of a failed build is kept below the state folder, without this machine's paths."""
    step = make("fake-build-failure")
    assert isinstance(step, Step)
    assert step.log is not None
    text = (tmp_path / "state" / step.log).read_text()

    assert "RuntimeError: FAKE_PATH environment variable is not set" in text
    assert not [folder for folder in (str(tmp_path), sys.prefix) if folder in text]
    assert "$BUILD" in text


def test_no_sdist_without_its_file(make: Make, host: Interpreter, tmp_path: Path) -> None:
    """An sdist that is gone from its place, or is another file now, is infra."""
    alone = fakes.make(tmp_path / "alone", "build-asks-more", "build-tool")
    asked = question("fake-build-asks-more", index=IndexSettings(no_index=True, find_links=(str(alone),)))
    lock = resolver.resolve(asked, host, tmp_path / "state" / "x")
    assert isinstance(lock, Lock)
    next(alone.glob("*.tar.gz")).write_bytes(b"another file")
    phase, outcome, decisive = expect_failure(install(lock, host, asked))

    assert (phase, outcome) == (Phase.INSTALL, Outcome.INFRA)
    assert decisive is not None
    assert "is not the file that the lock names" in decisive


def test_no_sdist_at_all(host: Interpreter, tmp_path: Path) -> None:
    """A file that is no archive is a failed install that says so."""
    folder = tmp_path / "alone"
    fakes.make(folder, "build-circle")
    asked = question("fake-build-circle", index=IndexSettings(no_index=True, find_links=(str(folder),)))
    lock = expect_lock(resolver.resolve(asked, host, tmp_path / "state" / "x"))
    path = next(folder.glob("*.tar.gz"))
    path.write_bytes(b"no archive")
    pin = lock.pins[0]
    artifact = replace(pin.artifact, sha256=sha256(b"no archive").hexdigest())
    answer = install(replace(lock, pins=(replace(pin, artifact=artifact),)), host, asked)

    assert expect_failure(answer) == (
        Phase.INSTALL,
        Outcome.FAILED,
        "fake-build-circle 1.0: fake_build_circle-1.0.tar.gz cannot be unpacked: file could not be opened successfully",
    )
