"""Locks, builds and environments of packages from the index."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from harness.machine import interpreters, process
from harness.model import Interpreter, Lock, Outcome, Phase, Question, Step
from harness.packages import locks, resolver, uv_command
from harness.packages.environments import environments
from harness.packages.environments.environments import Environment
from harness.packages.step_failed import StepFailed

SNAPSHOT = "2026-11-15T00:00:00Z"


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Use a cache and a state of the module's own."""
    folder = tmp_path_factory.mktemp("real")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HARNESS_CACHE", str(folder / "cache"))
        patch.setenv("HARNESS_STATE", str(folder / "state"))
        yield folder


def find(version: str) -> Interpreter:
    """Return an interpreter, or skip the test."""
    found = interpreters.find(version)
    if found is None:
        pytest.skip(f"unavailable: python{version}")
    return found


@pytest.fixture
def ask(places: Path) -> Callable[..., tuple[Question, Lock | Step]]:
    """Return a function that resolves requirements under the cutoff, and returns question and answer."""

    def resolve(python: Interpreter, *requirements: str, **more: object) -> tuple[Question, Lock | Step]:
        question = Question(requirements=requirements, **{"snapshot": SNAPSHOT, **more})  # type: ignore[arg-type]
        return question, resolver.resolve(question, python, places / "state" / "x")

    return resolve


@pytest.fixture
def make(ask: Callable[..., tuple[Question, Lock | Step]]) -> Callable[..., Environment]:
    """Return a function that locks and installs requirements."""

    def ensure(python: Interpreter, *requirements: str, **more: object) -> Environment:
        question, lock = ask(python, *requirements, **more)
        assert isinstance(lock, Lock), lock
        environment = environments.ensure(lock, python, question)
        assert environment.installed == lock.versions
        return environment

    return ensure


def output_of(environment: Environment, code: str, folder: Path) -> str:
    """Return the output of a line of Python in an environment."""
    command = process.Command(
        argv=(str(environment.python), "-c", code),
        cwd=folder,
        env={},
        limits=process.Limits(seconds=120),
        log=folder / "said.log",
        profile=process.Profile.CELL,
        home=folder,
        sealed=(environment.path,),
    )
    process.run(command)
    return command.log.read_text().strip()


def marks(site: Path) -> dict[str, str]:
    """Return the WHEEL file of each package, which distinguishes the wheels of a release."""
    return {path.parent.name: path.read_text() for path in site.glob("lib/python*/site-packages/*.dist-info/WHEEL")}


@pytest.mark.parametrize("version", ["3.7", "3.8", "3.9", "3.10", "3.11", "3.12", "3.13"])
def test_chosen_files_are_those_that_uv_takes(
    version: str, ask: Callable[..., tuple[Question, Lock | Step]], places: Path, tmp_path: Path
) -> None:
    """Of all wheels of a release, the one that a lock names is the one that uv installs by itself."""
    python = find(version)
    names = ("numpy", "pillow", "glfw<2.11", "charset-normalizer", "protobuf", "absl-py", "mujoco")
    question, lock = ask(python, *names, only_binary=("mujoco",))
    assert isinstance(lock, Lock)
    ours = environments.ensure(lock, python, question)
    assert isinstance(ours, Environment)
    folder = tmp_path / "work"
    folder.mkdir()
    call = uv_command.Call(index=question.index, folder=folder)
    assert uv_command.create(call, tmp_path / "theirs", python).ok
    whole = places / "state" / "x" / "pylock.toml"
    settings = folder / "uv.toml"
    settings.touch()
    installed = uv_command.install(call, tmp_path / "theirs" / "bin" / "python", whole, settings, "copy")

    assert installed.ok, installed.text
    assert marks(tmp_path / "theirs") == marks(ours.path)
    assert len(marks(ours.path)) == len(lock.pins)


def test_split_package_in_turn(make: Callable[..., Environment], tmp_path: Path) -> None:
    """mujoco 4.0, split into three packages, and 3.17 in turn: each environment imports what its lock says."""
    python = find("3.11")
    seen = [
        output_of(make(python, f"mujoco=={version}"), "import mujoco; print(mujoco.__version__)", tmp_path)
        for version in ("4.0.0", "3.17.0", "4.0.0")
    ]

    assert seen == ["4.0.0", "3.17.0", "4.0.0"]


def test_same_snapshot_same_bytes(
    ask: Callable[..., tuple[Question, Lock | Step]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same snapshot locks to the same bytes, with an empty cache too; nothing in them names a place."""
    python = find("3.11")
    _, first = ask(python, "gymnasium[mujoco]==1.2.3", "mujoco==3.3.7")
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))
    _, second = ask(python, "gymnasium[mujoco]==1.2.3", "mujoco==3.3.7")
    assert isinstance(first, Lock)
    assert isinstance(second, Lock)

    assert first.requirements == second.requirements
    assert "//" not in first.requirements
    assert locks.read_pins(first.requirements).keys() == first.versions.keys()


def test_reinstall_from_a_committed_lock(
    ask: Callable[..., tuple[Question, Lock | Step]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A committed lock, in a fresh clone with an empty cache, gives the same packages, files and environment."""
    python = find("3.11")
    question, before = ask(python, "gymnasium==1.2.3", "numpy<2.3")
    assert isinstance(before, Lock)
    first = environments.ensure(before, python, question)
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    after = resolver.restore(before.requirements, question, python, tmp_path / "state" / "x")
    assert isinstance(after, Lock), after
    second = environments.ensure(after, python, question)
    assert isinstance(first, Environment)
    assert isinstance(second, Environment)

    assert after.requirements == before.requirements
    assert [pin.artifact.sha256 for pin in after.pins] == [pin.artifact.sha256 for pin in before.pins]
    assert (second.key, second.installed) == (first.key, first.installed)
    assert not second.reused


def test_old_sdist_is_built(make: Callable[..., Environment], tmp_path: Path) -> None:
    """An old sdist is built: gym 0.26 has no wheel, and imports afterwards."""
    environment = make(find("3.9"), "gym==0.26.2", "numpy<2")

    assert output_of(environment, "import gym; print(gym.__version__)", tmp_path).splitlines()[-1] == "0.26.2"


@pytest.mark.parametrize(
    ("requirements", "constraints", "decisive"),
    [
        pytest.param(
            ("mujoco==3.5.0",),
            (),
            "RuntimeError: MUJOCO_PATH environment variable is not set",
            id="sdist-without-its-library",
        ),
        pytest.param(
            ("gym==0.21.0",),
            (),
            "error in gym setup command: 'extras_require' must be a dictionary whose values are strings or lists of "
            "strings containing valid project/version requirement specifiers.",
            id="new-setuptools",
        ),
        pytest.param(
            ("gym==0.21.0",),
            ("setuptools<67", "wheel<0.39"),
            "Metadata for `gym` (v0.21.0) could not be parsed: / after parsing `3`, found `.`, which is not part of a "
            "valid version / opencv-python (>=3.) ; extra == 'all'",
            id="invalid-metadata",
        ),
    ],
)
def test_known_failing_builds(
    ask: Callable[..., tuple[Question, Lock | Step]],
    requirements: tuple[str, ...],
    constraints: tuple[str, ...],
    decisive: str,
) -> None:
    """Builds that fail for everyone are failed installs with a reason, during resolution or installation."""
    python = find("3.9")
    question, answer = ask(python, *requirements, build_constraints=constraints)
    if isinstance(answer, Lock):
        with pytest.raises(StepFailed) as failed:
            environments.ensure(answer, python, question)
        answer = failed.value.step

    assert (answer.phase, answer.outcome, answer.decisive) == (Phase.INSTALL, Outcome.FAILED, decisive)
