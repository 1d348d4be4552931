"""A sample of the combinations that were measured by hand, run through the harness."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from harness.machine import interpreters, store, this_machine

sys.path.insert(0, str(Path(__file__).parent))
import agreement

SAMPLE = [(number, entry) for number, entry in enumerate(agreement.entries(), 1) if entry.get("sample")]


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> store.Store:
    """Use a store and a cache of this run alone."""
    folder = tmp_path_factory.mktemp("agreement")
    patch = pytest.MonkeyPatch()
    patch.setenv("HARNESS_STATE", str(folder / "state"))
    patch.setenv("HARNESS_CACHE", str(folder / "cache"))
    yield store.open_store()
    patch.undo()


def test_sample_holds_every_phase() -> None:
    """Each phase in which a case can fail first is in the sample, and cases that work."""
    assert {case["first_failure"] for _, entry in SAMPLE for case in entry["cases"]} >= {
        "resolve", "install", "import", "single", "vector", "render", agreement.NONE,
    }  # fmt: skip


@pytest.mark.parametrize(("number", "entry"), SAMPLE, ids=[f"{n}-{e['requirements'][0]}" for n, e in SAMPLE])
def test_first_failing_phase(number: int, entry: dict, opened: store.Store) -> None:
    """The harness finds the failure that was met by hand, in the same phase and with the same words."""
    if not interpreters.find(entry["python"]):
        pytest.skip(f"unavailable: python{entry['python']}")
    if "egl" not in this_machine.facts().capabilities:
        pytest.skip("missing library: libEGL")
    (record,) = agreement.run([agreement.cell_of(number, entry)], opened)

    for one in agreement.compare(entry, record):
        assert (one.env, one.by_harness) == (one.env, one.by_hand)
        assert one.line_agrees, (one.fragments, one.decisive)


def test_every_entry_is_a_cell() -> None:
    """All entries can be planned, under ids of their own."""
    ids = [agreement.cell_of(number, entry).id for number, entry in enumerate(agreement.entries(), 1)]

    assert len(ids) == len(set(ids)) >= 80
