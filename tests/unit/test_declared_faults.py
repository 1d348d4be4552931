"""Declared faults: each has a row of its own, and a promise."""

from __future__ import annotations

import json
from collections import Counter

from benchmarks import faults
from benchmarks.faults import _table


def test_rows_and_names_are_unique() -> None:
    """No two faults share a row of the table or a name."""
    declared = faults.load_faults()
    for names in ([fault.row for fault in declared], [f"{fault.module}.{fault.name}" for fault in declared]):
        assert [name for name, count in Counter(names).items() if count > 1] == []


def test_every_fault_says_what_is_done_and_what_is_promised() -> None:
    """Deed, promise and deadline are there, short enough for a table and a patient reader."""
    for fault in faults.load_faults():
        assert fault.done.strip()
        assert fault.promise.strip()
        assert 0 < fault.limit <= 600, fault.name
        assert max(len(fault.done), len(fault.promise)) <= 300, fault.name


def test_the_committed_table_lists_every_declared_fault_and_none_more() -> None:
    """Each with the section, the words and the promise of its declaration; the page is the document's."""
    document = json.loads((_table.REPORT / "faults.json").read_text(encoding="utf-8"))
    texts = ("row", "section", "done", "promise", "documented")
    listed = {row["fault"]: tuple(row[text] for text in texts) for row in document["faults"]}

    assert listed == {
        f"{fault.module}.{fault.name}": tuple(getattr(fault, text) for text in texts) for fault in faults.load_faults()
    }
    assert (_table.REPORT / "report.md").read_text(encoding="utf-8") == _table.rendered(document)


def test_no_promise_of_the_committed_table_is_broken() -> None:
    """Every fault held its promise when the table was made, or is documented."""
    rows = json.loads((_table.REPORT / "faults.json").read_text(encoding="utf-8"))["faults"]

    assert [row["fault"] for row in rows if not row["held"] and not row["documented"]] == []
