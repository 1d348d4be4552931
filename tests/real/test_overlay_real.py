"""gym 0.21, which can no longer be installed, from the real index: unchanged, and repaired."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.machine import interpreters, process
from harness.model import Lock, Outcome, Phase, Question, Step
from harness.packages.environments import environments
from harness.packages.sources import overlays
from harness.running import open_matrix

SNAPSHOT = "2026-11-20T23:59:59Z"


@pytest.fixture(autouse=True)
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use an empty cache and state; the user's own index settings stay."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))


def test_gym_021_is_what_its_recipe_says(tmp_path: Path) -> None:
    """Without the overlay setuptools refuses its metadata; with it the promised wheel comes out and is imported."""
    python = interpreters.find("3.9")
    if python is None:
        pytest.skip("unavailable: python3.9")
    bare = Question(requirements=("gym==0.21.0",), constraints=("numpy<2",), snapshot=SNAPSHOT)
    step = overlays.resolve(bare, python, tmp_path / "state" / "bare")
    assert isinstance(step, Step)
    if step.outcome is Outcome.INFRA:
        pytest.skip("unavailable: package index")
    assert (step.phase, step.outcome, step.decisive) == (
        Phase.INSTALL,
        Outcome.FAILED,
        "error in gym setup command: 'extras_require' must be a dictionary whose values are strings or lists of "
        "strings containing valid project/version requirement specifiers.",
    )

    (recipe,) = [one for one in open_matrix.recipes(tmp_path)["gym"] if one.version == "0.21.0"]
    asked = Question(requirements=bare.requirements, constraints=bare.constraints, snapshot=SNAPSHOT, overlay=(recipe,))
    lock = overlays.resolve(asked, python, tmp_path / "state" / "repaired")
    assert isinstance(lock, Lock), lock.decisive
    assert (lock.versions["gym"], lock.escaped) == ("0.21.0", ())
    assert recipe.wheel in lock.requirements

    made = environments.ensure(lock, python, asked)
    assert isinstance(made, environments.Environment), made.decisive
    told = process.run(
        process.Command(
            argv=(str(made.python), "-c", "import gym; print(gym.make('CartPole-v1').reset().shape)"),
            cwd=tmp_path,
            env={},
            limits=process.Limits(seconds=60),
            log=tmp_path / "log",
            profile=process.Profile.HOST,
        )
    )
    assert (told.exit_code, told.log.read_text().splitlines()[-1]) == (0, "(4,)")
