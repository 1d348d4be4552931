"""Well-known boundaries, found with the packages from the real index."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from harness.__main__ import main
from harness.machine import interpreters

ASKED = ["try", "gym==0.26.2", "--python", "3.10", "--as-of", "2026-11-20", "--env", "gym:CartPole-v1"]


@pytest.fixture(autouse=True)
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use an empty state in an empty folder; the user's own index settings and cache stay."""
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)


def test_numpy_that_gym_cannot_stand(capsys: pytest.CaptureFixture[str]) -> None:
    """gym 0.26.2 works up to NumPy 1.26.4, and no further than to its first step with 2.0.0."""
    if interpreters.find("3.10") is None:
        pytest.skip("unavailable: python3.10")
    if main(ASKED) == 3:
        pytest.skip("unavailable: package index")
    capsys.readouterr()
    cell = "try/py3.10_gym-0.26.2*"

    code = main(["bisect", cell, "--axis", "numpy", "--good", "1.26.3", "--bad", "2.0.1", "--json"])

    made = json.loads(capsys.readouterr().out)
    assert (code, made["status"]) == (0, "found")
    assert (made["good"]["candidate"], made["bad"]["candidate"]) == ("1.26.4", "2.0.0")
    assert made["predicate"]["phase"] == "single"
    assert made["moved"] == [{"name": "numpy", "good": "1.26.4", "bad": "2.0.0"}]


def test_range_of_three_releases(capsys: pytest.CaptureFixture[str]) -> None:
    """dm_control 1.0.28 works with MuJoCo 3.3.0 to 3.3.2 only, and the newest of them is found without a good end."""
    if interpreters.find("3.11") is None:
        pytest.skip("unavailable: python3.11")
    env = ["--env", "dm_control:cartpole/swingup", "--as-of", "2026-11-20", "--python", "3.11"]
    if main(["try", "dm-control==1.0.28", "mujoco==3.3.7", *env]) == 3:
        pytest.skip("unavailable: package index")
    capsys.readouterr()

    code = main(["bisect", "try/py3.11_dm-control-1.0.28_mujoco-3.3.7*", "--axis", "mujoco", "--json"])

    made = json.loads(capsys.readouterr().out)
    assert (code, made["status"]) == (0, "found")
    assert (made["good"]["candidate"], made["bad"]["candidate"]) == ("3.3.2", "3.3.3")
    assert any("only a range works" in told for told in made["told"])
