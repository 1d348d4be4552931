"""Test that measured results become one plain document."""

import hashlib
import json
from typing import Any

import pytest
import specimens

from harness.reports import document
from harness.reports.answers import digest
from harness.reports.answers.digest import Layer

ONE, TWO = "1" * 64, "2" * 64
NUMPY = f"numpy==2.2.6 \\\n    --hash=sha256:{ONE} \\\n    --hash=sha256:{TWO}\n"
SHORTER = f"numpy==2.2.6 \\\n    --hash=sha256:{TWO}\n"


def sha256(text: str) -> str:
    """Return the hash by which a document names a lock."""
    return hashlib.sha256(text.encode()).hexdigest()


def cell(name: str, measured: str = "2026-11-21T12:00:00Z", machine: str = "here", **more: Any) -> dict[str, Any]:
    """Return a cell as a layer holds it."""
    return {"id": name, "machine": machine, "measured": measured, "lock": None, **more}


def report() -> dict[str, Any]:
    """Return a whole report with a cell of every kind."""
    plain: dict[str, Any] = json.loads(document.encode(specimens.quick_document()))
    return plain


def test_a_cell_that_says_nothing_of_its_packages_is_left_out() -> None:
    """Cells that were not run, not to be had or not told leave nothing; all others keep verdict and phases."""
    plain = report()

    found = {one["id"]: one for one in digest.layer(plain, lambda _: None).cells}

    told = [one for one in plain["cells"] if one["verdict"] not in {"not_run", "unavailable", "inconclusive"}]
    assert 0 < len(told) < len(plain["cells"])
    assert {name: one["verdict"] for name, one in found.items()} == {one["id"]: one["verdict"] for one in told}
    assert all(found[one["id"]]["phases"] == one["phases"] for one in told)


def test_a_cell_keeps_its_lock() -> None:
    """A lock is named by the SHA-256 of its text, and comes out again to the byte."""
    plain = report()

    made = digest.combined([digest.layer(plain, lambda _: NUMPY)])

    (sha,) = made["locks"]
    assert sha == sha256(NUMPY)
    assert {one["lock"] for one in made["cells"]} == {sha, None}
    assert digest.lock_text(made, sha) == NUMPY


@pytest.mark.parametrize("text", [None, "numpy @ file:///a.whl\n"], ids=["gone", "no lock"])
def test_a_lock_that_cannot_be_given_again_is_none(text: str | None) -> None:
    """Nobody is told of a lock that is not there, or that is not pinned by hashes."""
    made = digest.combined([digest.layer(report(), lambda _: text)])

    assert not made["locks"]
    assert {one["lock"] for one in made["cells"]} == {None}


def test_locks_of_two_pythons_keep_their_own_files() -> None:
    """Two locks with one release and other files of it: each gets its own hashes again."""
    locks = {sha256(text): text for text in (NUMPY, SHORTER)}
    cells = [cell(name, lock=name) for name in locks]

    made = digest.combined([Layer(cells=cells, locks=locks)])

    assert made["hashes"] == {"numpy==2.2.6": [ONE, TWO]}
    assert {sha: digest.lock_text(made, sha) for sha in locks} == locks


def test_the_newer_measurement_stands() -> None:
    """Whichever layer comes first, of a cell on one machine the newer measurement stands, with its lock alone."""
    old = Layer(cells=[cell("m/a", "2026-01-01T00:00:00Z", lock=sha256(NUMPY))], locks={sha256(NUMPY): NUMPY})
    new = Layer(cells=[cell("m/a", "2026-02-01T00:00:00Z", lock=sha256(SHORTER))], locks={sha256(SHORTER): SHORTER})

    for layers in ([old, new], [new, old]):
        made = digest.combined(layers)
        assert [one["measured"] for one in made["cells"]] == ["2026-02-01T00:00:00Z"]
        assert [*made["locks"]] == [sha256(SHORTER)]


def test_machines_never_mix() -> None:
    """A cell measured on two machines has a result of each, however old."""
    layers = [
        Layer(cells=[cell("m/a", "2026-01-01T00:00:00Z", "there")], machines={"there": {"os": "another"}}),
        Layer(cells=[cell("m/a", "2026-02-01T00:00:00Z", "here")], machines={"here": {"os": "one"}, "unused": {}}),
    ]

    made = digest.combined(layers)

    assert [(one["machine"], one["measured"][:7]) for one in made["cells"]] == [
        ("here", "2026-02"),
        ("there", "2026-01"),
    ]
    assert made["machines"] == {"here": {"os": "one"}, "there": {"os": "another"}}


def test_a_machine_is_told_by_what_draws_and_by_its_gpu() -> None:
    """The models that `harness.machine.this_machine` found, and the library that draws where one is there."""
    plain = report()
    (facts,) = plain["machines"].values()

    (without,) = digest.layer(plain, lambda _: None).machines.values()
    facts["gpu"] = specimens.GPU
    (made,) = digest.layer(plain, lambda _: None).machines.values()

    assert without == {key: made[key] for key in made if key != "gpu"}
    assert (made["gpu"], made["gl"], made["glibc"]) == ("NVIDIA H200", "Mesa/X.org", "2.36")


def test_what_was_packed_comes_out_equal() -> None:
    """Packed twice it is the same bytes; unpacked, and put under nothing, it is the same document."""
    made = digest.combined([digest.layer(report(), lambda _: NUMPY)])

    content = digest.packed(made)

    assert content == digest.packed(json.loads(json.dumps(made)))
    assert digest.unpacked(content) == made
    assert digest.combined([digest.to_layer(made)]) == made


def test_a_mask_is_a_cause_only_where_it_is_what_the_cell_says() -> None:
    """Causes are the known failures that are no masks, else the mask that is the line itself, as in a report."""
    plain = report()
    red = next(one for one in plain["cells"] if one["decisive"] and one["verdict"] == "partial")
    mask = {"signature": "mask", "masks": True, "seen": "EOFError"}

    def causes(line: str, *found: dict[str, Any]) -> list[str]:
        told = red | {"decisive": line, "cases": [], "diagnoses": list(found)}
        (made,) = digest.layer(plain | {"cells": [told]}, lambda _: None).cells
        return list(made["causes"])

    assert causes("EOFError: ", mask) == ["mask"]
    assert causes("KeyError: 1", mask) == []
    assert causes("EOFError: ", {"signature": "deep", "masks": False, "seen": "x"}, mask) == ["deep"]
