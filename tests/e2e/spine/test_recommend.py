"""`recommend` answers from local runs and from the results that come with the package."""

from __future__ import annotations

import hashlib

from commandline import SMALL, Desk


def test_results_of_a_run_here_are_known(desk: Desk) -> None:
    """`recommend` knows nothing of a package before a run; afterwards it has the green cell's lock and the red cell."""
    before = desk.run("recommend", "fake-healthy", "--json")
    desk.run("run", desk.matrix("small", SMALL.read_text()))

    after = desk.run("recommend", "fake-healthy", "--needs", "render", "--json")
    plain = desk.run("recommend", "fake-healthy", "--lock-out", "lock.txt")

    assert (before.code, before.document["measured"], before.document["unknown"]) == (1, [], ["fake-healthy"])
    assert before.err == "note: the package index could not be asked whether this exists: fake-healthy\n"
    (one,) = after.document["measured"]
    assert (after.code, len(one["cells"])) == (0, 1)
    assert one["cell"].endswith("_good")
    assert one["phases"]["render"] == "passed"
    (lock,) = (desk.state / "reports/small/locks").glob("*.txt")
    header, _, text = (desk.folder / "lock.txt").read_text().partition("lock.txt\n")
    assert text == lock.read_text() == one["lock"]
    assert header.startswith("# simmatrix: small/")
    assert hashlib.sha256(lock.read_bytes()).hexdigest() == one["lock_sha256"]
    assert "fake-healthy==1.0" in plain.out.splitlines()[0]


def test_files_are_checked_against_results_of_a_run_here(desk: Desk) -> None:
    """`check` says of a file what was measured here: good, bad with the line that says why, never measured."""
    desk.run("run", desk.matrix("small", SMALL.read_text()))
    for name, text in (
        ("good", "fake-healthy==1.0\n"),
        ("bad", "fake-blank-frame\nfake-healthy\n"),
        ("new", "fake-healthy==2.0\n"),
    ):
        (desk.folder / f"{name}.txt").write_text(text)

    good, bad, new = (desk.run("check", "-r", f"{name}.txt", "--json") for name in ("good", "bad", "new"))

    assert (good.code, [each["kind"] for each in good.document["findings"]]) == (0, ["good"])
    assert (bad.code, new.code) == (1, 3)
    assert new.document["findings"][0]["text"].startswith("fake-healthy 2.0: never measured; nearest that works: ")


def test_results_of_others_are_layered(desk: Desk) -> None:
    """A report folder named by HARNESS_RESULTS gives answers on a machine that ran nothing."""
    desk.run("run", desk.matrix("small", SMALL.read_text()), "--out", "theirs")
    elsewhere = {"HARNESS_STATE": str(desk.folder / "empty")}

    without = desk.run("recommend", "fake-healthy", **elsewhere)
    layered = desk.run("recommend", "fake-healthy", "--json", HARNESS_RESULTS="theirs", **elsewhere)
    wrong = desk.run("recommend", "fake-healthy", HARNESS_RESULTS="nowhere", **elsewhere)

    assert (without.code, layered.code, wrong.code) == (1, 0, 2)
    assert [one["cell"].endswith("_good") for one in layered.document["measured"]] == [True]
    assert wrong.err.startswith("simmatrix: nowhere: has no report.json")
