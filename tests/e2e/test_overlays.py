"""Repaired releases: built from the index's sdist or wheel, resolved, locked by hash, restored elsewhere."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import pytest
import recipes

from harness.machine import interpreters
from harness.matrix import overlay_recipes
from harness.model import IndexSettings, Interpreter, Lock, Outcome, Phase, Question, Step, replace
from harness.packages.environments import environments
from harness.packages.sources import overlays, wheel_patch

INVALID, NARROW, NEW = recipes.WHEELS


@pytest.fixture
def repairing_question(workplace: Path, wheelhouse: Path, offline_index: IndexSettings) -> Question:
    """Return a question that repairs the fakes with a recipe."""
    overlay = [overlay_recipes.read(recipes.recipe(name, wheelhouse), "x.toml")[0] for name in recipes.WHEELS]
    return Question(requirements=tuple(recipes.WHEELS), index=offline_index, overlay=tuple(overlay))


def resolved(question: Question, python: Interpreter, folder: Path) -> Lock:
    """Return the lock of a question."""
    lock = overlays.resolve(question, python, folder)
    assert isinstance(lock, Lock), lock.decisive
    return lock


def test_a_repaired_release_is_found_locked_and_installed(
    repairing_question: Question, host: Interpreter, tmp_path: Path
) -> None:
    """The lock names the repaired wheels by the hashes that the recipes promise; what they require comes along."""
    lock = resolved(repairing_question, host, tmp_path / "state" / "x")

    assert {pin.name: pin.artifact.sha256 for pin in lock.pins if pin.name in recipes.WHEELS} == recipes.WHEELS
    assert lock.versions == {
        "fake-metadata-invalid": "1.0",
        "fake-new-python": "1.0",
        "fake-plain": "3.0",
        "fake-too-narrow": "1.0",
    }
    assert all(mark in lock.requirements for mark in recipes.WHEELS.values())

    made = environments.ensure(lock, host, repairing_question)

    assert (environments.is_intact(made, thorough=True), made.findings) == (True, ())


def test_the_wheel_is_the_same_by_whatever_python(
    repairing_question: Question, host: Interpreter, other: Interpreter, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Built by another Python, on a machine with an empty cache, it has the hash that the recipe promises."""
    monkeypatch.setattr(interpreters, "available", lambda minor=None: (other,))

    assert resolved(repairing_question, host, tmp_path / "state" / "x").versions[INVALID] == "1.0"
    requests = {path.name for path in (tmp_path / "cache" / "wheels" / "requests").glob("*.txt")}
    assert len(requests) == 2


def test_a_lock_is_restored_where_the_wheel_was_never_made(
    repairing_question: Question, host: Interpreter, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A committed lock and the recipe are enough for another machine; without the recipe it says what is missing."""
    lock = resolved(repairing_question, host, tmp_path / "state" / "x")
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "elsewhere"))

    restored = overlays.restore(lock.requirements, repairing_question, host, tmp_path / "state" / "y")
    assert isinstance(restored, Lock)
    assert restored.requirements == lock.requirements
    sources = [Path(pin.artifact.source) for pin in restored.pins if pin.name in recipes.WHEELS]
    assert all((tmp_path / "elsewhere") in source.parents for source in sources)

    bare = overlays.restore(lock.requirements, replace(repairing_question, overlay=()), host, tmp_path / "state" / "z")
    assert isinstance(bare, Step)
    assert (bare.outcome, bare.decisive) == (
        Outcome.INFRA,
        "no index or find-links place that was asked has fake-metadata-invalid 1.0 with a hash of the lock; lock again",
    )


def test_a_missing_wheel_is_built_again(repairing_question: Question, host: Interpreter, tmp_path: Path) -> None:
    """A deleted wheel of an earlier lock is built again; an existing wheel is not."""
    lock = resolved(repairing_question, host, tmp_path / "state" / "x")
    sources = {pin.name: Path(pin.artifact.source) for pin in lock.pins}
    before = sources[NARROW].stat().st_mtime_ns
    sources[INVALID].unlink()

    supplied = overlays.provide_wheels(lock, repairing_question)

    assert {pin.name: Path(pin.artifact.source) for pin in supplied.pins} == sources
    assert sources[INVALID].is_file()
    assert sources[NARROW].stat().st_mtime_ns == before


def test_nothing_is_repaired_before_it_was_released(
    repairing_question: Question, host: Interpreter, tmp_path: Path
) -> None:
    """A repaired wheel has the upload time of its sdist: a cutoff excludes it before, and allows it afterwards."""
    early = replace(repairing_question, requirements=(NARROW, NEW), snapshot="2021-10-06T22:04:24Z")
    step = overlays.resolve(early, host, tmp_path / "state" / "x")
    assert isinstance(step, Step)
    assert (step.phase, step.outcome) == (Phase.RESOLVE, Outcome.FAILED)
    assert not list((tmp_path / "cache").glob("wheels/*/*.whl"))

    late = replace(repairing_question, requirements=(NARROW, NEW), snapshot=recipes.UPLOADED)
    lock = resolved(late, host, tmp_path / "state" / "y")
    assert lock.escaped == ()
    assert [pin.artifact.uploaded for pin in lock.pins] == [recipes.UPLOADED] * 2


def test_a_wheel_that_is_not_the_promised_one_is_refused(
    repairing_question: Question, host: Interpreter, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A built wheel with another hash than promised is infra; both hashes and the building Python are shown."""
    monkeypatch.setattr(interpreters, "available", lambda minor=None: (host,))
    wrong = replace(
        repairing_question, overlay=(replace(repairing_question.overlay[1], wheel="f" * 64),), requirements=(NARROW,)
    )

    step = overlays.resolve(wrong, host, tmp_path / "state" / "x")

    assert isinstance(step, Step)
    assert (step.outcome, step.decisive) == (
        Outcome.INFRA,
        f"fake-too-narrow 1.0 could not be repaired: the SHA-256 is {recipes.WHEELS[NARROW]} "
        f"(built by Python {host.version}), and the recipe says {'f' * 64}",
    )


def test_the_indexs_own_wheel_is_no_choice_beside_the_repaired_one(
    repairing_question: Question, host: Interpreter, wheelhouse: Path, tmp_path: Path
) -> None:
    """The lock has the hash of the repaired wheel, not of the index's wheel of the same name; nothing is built."""
    lock = resolved(
        replace(repairing_question, requirements=(NEW,), overlay=repairing_question.overlay[2:]),
        host,
        tmp_path / "state" / "x",
    )

    (pin,) = lock.pins
    (own,) = wheelhouse.glob("fake_new_python-1.0-*.whl")
    assert pin.hashes == (recipes.WHEELS[NEW],)
    assert Path(pin.artifact.source).name == own.name
    assert wheel_patch.sha256(Path(pin.artifact.source).read_bytes()) == recipes.WHEELS[NEW]
    assert wheel_patch.sha256(own.read_bytes()) == repairing_question.overlay[2].origin != recipes.WHEELS[NEW]
    assert not list((tmp_path / "cache" / "wheels" / "requests").glob("*.txt"))


def test_a_wheel_that_is_patched_otherwise_is_refused(
    repairing_question: Question, host: Interpreter, tmp_path: Path
) -> None:
    """A patched wheel with another hash than promised is infra; both hashes are shown, without a building Python."""
    wrong = replace(
        repairing_question, overlay=(replace(repairing_question.overlay[2], wheel="f" * 64),), requirements=(NEW,)
    )

    step = overlays.resolve(wrong, host, tmp_path / "state" / "x")

    assert isinstance(step, Step)
    assert (step.outcome, step.decisive) == (
        Outcome.INFRA,
        f"fake-new-python 1.0 could not be repaired: the SHA-256 is {recipes.WHEELS[NEW]}, "
        f"and the recipe says {'f' * 64}",
    )


@pytest.mark.parametrize(
    ("more", "ended"),
    [
        ({"origin": "e" * 64},
         (Outcome.INFRA, "no index or find-links place that was asked has the file of fake-too-narrow "
                         f"with the SHA-256 {'e' * 64}")),
        ({"python": ">=4"},
         (Outcome.UNAVAILABLE, "its repaired wheel is built by a Python >=4, and there is none here")),
    ],
)  # fmt: skip
def test_a_missing_source_of_a_patched_wheel_is_named(
    more: dict[str, Any], ended: tuple[Outcome, str], repairing_question: Question, host: Interpreter, tmp_path: Path
) -> None:
    """If the recipe's sdist or a Python to build it is missing, that says nothing about packages."""
    wrong = replace(
        repairing_question, overlay=(replace(repairing_question.overlay[1], **more),), requirements=(NARROW,)
    )

    step = overlays.resolve(wrong, host, tmp_path / "state" / "x")

    assert isinstance(step, Step)
    assert (step.outcome, step.decisive) == (ended[0], f"fake-too-narrow 1.0 could not be repaired: {ended[1]}")


def test_only_the_named_lines_change(repairing_question: Question, host: Interpreter, tmp_path: Path) -> None:
    """The metadata of the repaired wheel is that of the sdist but for the line of the recipe."""
    lock = resolved(repairing_question, host, tmp_path / "state" / "x")
    path = next(pin.artifact.source for pin in lock.pins if pin.name == INVALID)

    with zipfile.ZipFile(path) as wheel:
        metadata = wheel.read("fake_metadata_invalid-1.0.dist-info/METADATA").decode()

    assert metadata == (
        "Metadata-Version: 2.1\nName: fake-metadata-invalid\nVersion: 1.0\nRequires-Dist: fake-plain (>=3)\n"
    )
