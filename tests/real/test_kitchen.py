"""Our own kitchen, which MuJoCo refuses since 3.2: the decisive line is the workers', not their parent's."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_adapters import runner  # noqa: F401 - a fixture

from harness.judging.assess import assess
from harness.model import Cell, CellRecord, Outcome, Verdict
from harness.running import open_matrix
from harness.running.scheduler import ControlledRunner
from harness.running.signatures import shipped_signatures

MATRIX = Path(__file__).parents[2] / "matrices" / "kitchen-twin.toml"
WHOLE = "py3.9_gymnasium-absent_gym-0.21.0_dm-control-1.0.20_mujoco-3.2.0_whole"
REFUSED = "py3.11_gymnasium-1.2.3_gym-absent_dm-control-absent_mujoco-3.2.0_alone"
XML = "ValueError: XML Error: top-level default class 'main' cannot be renamed / Element 'default', line 0"
MASKS = {"ConnectionResetError: [Errno 104] Connection reset by peer", "BrokenPipeError: [Errno 32] Broken pipe"}
"""Which of them it is, is a race."""


@pytest.fixture(scope="module")
def cells() -> dict[str, Cell]:
    """Return the cells of the matrix by their labels."""
    return {cell.label: cell for cell in open_matrix.load(str(MATRIX), print).cells}


def checks(record: CellRecord) -> dict[tuple[str, str], tuple[Outcome, str | None, str | None]]:
    """Return the outcome, the decisive line and the mask of each check of each case."""
    return {
        (case.case, check.check): (check.outcome, check.decisive, check.masked_by)
        for case in record.cases
        for phase in case.phases
        for check in phase.checks
        if check.check != "import.modules"
    }


def test_the_workers_error_decides_and_a_known_remedy_cures(
    cells: dict[str, Cell],
    runner: ControlledRunner,  # noqa: F811
    tmp_path: Path,
) -> None:
    """If only workers load the model, their error decides and their parent's is a mask.

    A nested class works, and so does MuJoCo before 3.2.
    """
    record = runner.measure(cells[REFUSED])
    found = checks(record)
    _, why, mask = found["workers", "vector.async.fork"]
    assert (why, mask in MASKS) == (XML, True)
    assert found["single", "single.loop"] == (Outcome.FAILED, XML, None)
    mended = {check: ended[0] for (case, check), ended in found.items() if case == "mended"}
    assert {mended["single.loop"], mended["vector.async.fork"]} == {Outcome.PASSED}
    assert set(mended.values()) <= {Outcome.PASSED, Outcome.SKIPPED}
    judged = assess(record, shipped_signatures.load_knowledge(tmp_path))
    assert (judged.verdict, judged.decisive) == (Verdict.PARTIAL, XML)
    first, *_ = judged.diagnoses
    assert first.signature.id == "mujoco-top-level-default-class"

    changed = runner.measure(cells[f"{REFUSED}_with-mujoco-before-3.2"])
    assert (changed.installed or {})["mujoco"] == "3.1.6"
    ended = checks(changed)
    assert ended["workers", "vector.async.fork"][0] is ended["single", "single.loop"][0] is Outcome.PASSED
    assert {outcome for outcome, _, _ in ended.values()} <= {Outcome.PASSED, Outcome.SKIPPED}


def test_sparing_the_parent_hides_the_error(cells: dict[str, Cell], runner: ControlledRunner) -> None:  # noqa: F811
    """With Diffusion Policy's `dummy_env_fn` the parent sees a mask; without it, the error itself."""
    record = runner.measure(cells[WHOLE])
    if record.unavailable:
        pytest.skip(f"unavailable: {record.unavailable}")
    found = checks(record)
    _, why, mask = found["runner", "vector.async.fork"]

    assert (why, mask in MASKS) == (XML, True)
    assert found["without-dummy", "vector.async.fork"] == (Outcome.FAILED, XML, None)
