"""`lock` chooses a covering array of combinations that resolve, and commits it; every other verb reads it."""

from __future__ import annotations

import json
from itertools import product

from commandline import Desk

VERSIONS = ("1.0", "2.0", "3.0")
MATRIX = """
snapshot = 2026-01-01
strategy = "pairwise"
index = { no_index = true, find_links = ["@WHEELS@"] }

[axes]
python = ["host"]
fake-plain = ["1.0", "2.0", "3.0"]
first = { good = {}, better = {}, bad = { requirements = ["fake-unresolvable"] } }
second = { a = {}, b = {}, c = {} }

[[cases]]
api = "gymnasium"
imports = ["json"]
"""


def test_chosen_by_lock_and_read_by_every_verb(desk: Desk) -> None:
    """Every pair that resolves is in a cell, one that does not is reported once, and nothing is resolved twice."""
    path = desk.matrix("choice", MATRIX)
    before = desk.run("plan", path)
    locked = desk.run("lock", path, "--json")
    after = desk.run("plan", path, "--json")
    again = desk.run("lock", path, "--offline", "--json")
    expanded = json.loads((desk.folder / "choice.expanded.json").read_text(encoding="utf-8"))

    assert (before.code, before.err) == (
        2,
        f'simmatrix: {path}: strategy: the combinations are not chosen yet; run "simmatrix lock {path}"\n',
    )
    assert (locked.code, after.code, again.code) == (0, 0, 0), locked.err
    assert all(cell["lock"] for cell in locked.document["cells"])
    axes = [cell["axes"] for cell in after.document["cells"]]
    assert [cell["id"] for cell in locked.document["cells"]] == [cell["id"] for cell in after.document["cells"]]
    assert {(each["fake-plain"], each["first"]) for each in axes} == set(product(VERSIONS, ("good", "better")))
    assert {(each["fake-plain"], each["second"]) for each in axes} == set(product(VERSIONS, "abc"))
    assert {(each["first"], each["second"]) for each in axes} == set(product(("good", "better"), "abc"))
    bad, rest = after.document["dropped"]
    assert (bad["id"].partition("_")[2], bad["count"]) == ("*_bad_*", 9)
    assert bad["reason"].startswith("does not resolve: Because only fake-plain>=1.0 is available")
    assert rest["reason"].endswith("but for these, excluded or without a resolution: first bad")
    assert rest["count"] + 9 + len(axes) == 27
    assert expanded["chosen"]["axes"] == ["python", "fake-plain", "first", "second"]
    assert "asking whether" in locked.err
    assert "asking whether" not in again.err


def test_a_changed_strategy_is_chosen_again_on_request(desk: Desk) -> None:
    """A choice of another strategy is refused by name until `lock --upgrade` makes it again."""
    path = desk.matrix("choice", MATRIX)
    first = desk.run("lock", path)
    assert first.code == 0, first.err
    desk.matrix("choice", MATRIX.replace('"pairwise"', "{ ways = 1 }"))
    stale, upgraded, planned = desk.run("lock", path), desk.run("lock", path, "--upgrade"), desk.run("plan", path)

    assert (stale.code, stale.err) == (
        2,
        f"simmatrix: {path}: strategy: the matrix has changed since they were chosen; "
        f'run "simmatrix lock {path} --upgrade"\n',
    )
    assert (upgraded.code, planned.code) == (0, 0), upgraded.err
    assert planned.out.splitlines()[-1] == "3 combinations, 24 left out"
