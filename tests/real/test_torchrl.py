"""TorchRL's wrappers around environments of torch tensors: their conversions, corruptions and failures."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from harness.machine import interpreters, store
from harness.model import CaseRecord, CellRecord, Outcome
from harness.running import open_matrix
from harness.running.scheduler import ControlledRunner, QuietObserver, Runner, Settings

MODULES = Path(__file__).parents[2] / "matrices" / "modules"
GYM, GYM_TENSOR, ISAACLAB = WRAPPERS = tuple(f"interop.torchrl.{name}" for name in ("gym", "gym_tensor", "isaaclab"))
MATRIX = f"""
snapshot = "2026-11-20"
python_path = ["lib"]
files = {{ "lib/tensor_env.py" = {{ source = "modules/tensor_env.py" }} }}
axes = {{ python = ["3.11"], torchrl = ["0.14.1"], gymnasium = ["1.2.3"], torch = ["2.13.0"] }}

[[cases]]
id = "fresh"
env = "tensor:tensor_env:make"
kwargs = {{ observations = "dict" }}
checks = {list(WRAPPERS)}

[[cases]]
id = "reused"
env = "tensor:tensor_env:make"
kwargs = {{ observations = "dict", reuse = true }}
checks = {list(WRAPPERS)}

[[cases]]
id = "last"
env = "tensor:tensor_env:make"
kwargs = {{ kind = "vector", observations = "dict", apart = true }}
checks = {[GYM_TENSOR]}

[[cases]]
id = "apart"
env = "tensor:tensor_env:make"
kwargs = {{ apart = true }}
checks = {[GYM_TENSOR]}
"""


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> CellRecord:
    """Return the record of one cell with three environments."""
    folder = tmp_path_factory.mktemp("torchrl")
    if interpreters.find("3.11") is None:
        pytest.skip("unavailable: python3.11")
    (folder / "modules").symlink_to(MODULES)
    (folder / "m.toml").write_text(MATRIX, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HARNESS_STATE", str(folder / "state"))
        patch.setenv("HARNESS_CACHE", os.environ.get("HARNESS_CACHE") or str(folder / "cache"))
        (cell,) = open_matrix.load(str(folder / "m.toml"), print).cells
        found = ControlledRunner(Runner(store.open_store(), Settings(), QuietObserver())).measure(cell)
    assert found.resolve
    if found.resolve.outcome is Outcome.UNAVAILABLE and "build of torch" in (found.resolve.decisive or ""):
        pytest.skip("unavailable: torch")
    return found


def case(record: CellRecord, name: str) -> CaseRecord:
    """Return one case of the cell."""
    return next(one for one in record.cases if one.case == name)


def recorded_facts(record: CellRecord, name: str) -> dict[str, dict[str, Any]]:
    """Return the recorded facts of each check of a case."""
    checks = [check for phase in case(record, name).phases for check in phase.checks]
    return {check.check: dict(check.facts["told"]) for check in checks if "told" in check.facts}


def findings(record: CellRecord, name: str) -> list[str]:
    """Return the warnings of a case about TorchRL."""
    found = [finding for phase in case(record, name).phases for finding in phase.findings]
    return [f"{one.check}: {one.text}" for one in found if one.check.startswith("interop.") and one.level == "warning"]


def test_conversions_and_copies_are_counted(record: CellRecord) -> None:
    """Conversions and copies per step are counted.

    GymWrapper converts to numpy and back once, or never without its conversion. IsaacLabWrapper makes three copies.
    """
    counted = {name: one["per_step"] for name, one in recorded_facts(record, "fresh").items()}
    assert counted == {
        GYM: {"wrapper": {"cpu()": 1, "to numpy": 1}, "environment": {"from numpy": 1, "clone": 5}},
        GYM_TENSOR: {"environment": {"clone": 5}},
        ISAACLAB: {"wrapper": {"clone": 3}, "environment": {"clone": 5}},
    }


def test_arrays_and_their_memory_are_recorded(record: CellRecord) -> None:
    """The types of inputs and outputs are recorded, and which of them share memory."""
    seen = recorded_facts(record, "fresh")
    tensor = "torch.Tensor float32 [4, 2] cpu"
    assert [seen[name]["takes"] for name in WRAPPERS] == ["numpy.ndarray float32 [4, 2] cpu", tensor, tensor]
    assert seen[GYM]["gives"]["policy"] == seen[GYM]["stored"]["policy"] == tensor
    assert (seen[GYM]["gives"]["reward"], seen[GYM]["stored"]["reward"]) == (
        "torch.Tensor float32 [4] cpu",
        "torch.Tensor float32 [4, 1] cpu",
    )
    passed_on = {"action": True, "policy": True, "age": True, "reward": False, "terminated": True, "truncated": True}
    assert seen[GYM]["same_memory"] == seen[GYM_TENSOR]["same_memory"] == passed_on
    assert seen[ISAACLAB]["same_memory"] == {**passed_on, "terminated": False, "truncated": False}
    assert all(
        one["keys"] == {"environment": ["policy", "age"], "stored": ["policy", "age"], "renamed": {}}
        for one in seen.values()
    )
    assert all(one["aliased"] == [] and one["rollout"]["wrong"] == {} for one in seen.values())
    assert findings(record, "fresh") == []


def test_a_corrupted_rollout_is_reported(record: CellRecord) -> None:
    """A stored rollout of an environment that reuses its memory holds last values, except where a wrapper copies."""
    seen = recorded_facts(record, "reused")
    assert {name: one["rollout"]["wrong"] for name, one in seen.items()} == {
        GYM: {"policy": 95, "age": 95, "truncated": 95},
        GYM_TENSOR: {"policy": 95, "age": 95, "truncated": 95},
        ISAACLAB: {"policy": 95, "age": 95},
    }
    assert seen[GYM]["aliased"] == ["policy", "age", "terminated", "truncated"]
    assert seen[ISAACLAB]["aliased"] == ["policy", "age"]
    assert findings(record, "reused") == [
        f"interop.torchrl.alias: {wrapper}: a stored rollout of 100 steps holds other values than the steps returned: "
        f"{where}; the environment gives the same memory at every step"
        for wrapper, where in (
            ("GymWrapper", "age in 95, policy in 95, truncated in 95"),
            ("IsaacLabWrapper", "age in 95, policy in 95"),
        )
    ]


def test_zeros_for_a_last_observation_are_reported(record: CellRecord) -> None:
    """TorchRL does not find the last observations in a dict, and stores zeros for them."""
    assert recorded_facts(record, "last")[GYM_TENSOR]["rollout"]["wrong"] == {}
    assert findings(record, "last") == [
        "interop.torchrl.last: GymWrapper: where an episode ended, zeros are stored for its last observation"
    ]


def test_worlds_that_end_apart_end_the_rollout(record: CellRecord) -> None:
    """Worlds that end apart end the rollout with the library's own error; earlier facts are kept."""
    (phase,) = [one for one in case(record, "apart").phases if one.outcome is Outcome.FAILED]
    assert (phase.decisive, phase.checks[0].check) == (
        "RuntimeError: Partial resets are not handled at this level.",
        GYM_TENSOR,
    )
    assert recorded_facts(record, "apart")[GYM_TENSOR]["takes"] == "torch.Tensor float32 [4, 2] cpu"
