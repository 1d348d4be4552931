"""Test the texts kept of a cell's failures, the known failures in them, and their use in documents and expectations."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest
from builders import case, cell, entry, make_knowledge, phase, record, step, warning
from specimens import RESET, XML

from harness.judging.assess import assess
from harness.judging.known_failures import Knowledge, select_counting
from harness.matrix import signatures
from harness.matrix.signatures import Sighting
from harness.model import (
    CellRecord,
    CheckRecord,
    Expectation,
    Observation,
    Outcome,
    Phase,
    Step,
    Subject,
    Suite,
    Verdict,
    replace,
)
from harness.model.errors import BadInput
from harness.model.report_types import DiagnosisEntry
from harness.running import own_suites
from harness.running.signatures import shipped_signatures, signature_files

KNOWN = signatures.read(
    {
        "known.toml": """
[[signature]]
id = "mask"
phases = ["vector"]
pattern = "ConnectionResetError"
masks = true
cause = "a worker is gone"
examples = ["ConnectionResetError", "builtins.ConnectionResetError", "again: ConnectionResetError"]
remedy = { text = "look at the worker" }
[[signature]]
id = "xml"
phases = ["vector"]
pattern = "XML Error"
packages = ["gymnasium<2"]
cause = "the model is wrong"
examples = ["XML Error", "ValueError: XML Error", "again: XML Error"]
references = ["https://example.org/1"]
remedy = { requirements = ["mujoco<3"], text = "or mend it" }
[[signature]]
id = "crash"
signal = "SIGSEGV"
cause = "something broke"
examples = ["killed by SIGSEGV", "worker killed by SIGSEGV", "again: killed by SIGSEGV"]
remedy = { text = "who knows" }
"""
    }
)
HUNG = {"code": "raised", "at": None, "got": None, "promised": None, "data": {"raised": "KeyError: 'x'"}}
VECTOR = phase(Phase.VECTOR, Outcome.FAILED, XML, masked_by=RESET, evidence="evidence/v")
MASKED = record(case("ppfp", vector=VECTOR))


def knowledge(**logs: dict[str, str]) -> Knowledge:
    """Return the signatures above, with texts kept at `evidence/NAME`."""
    return make_knowledge(*KNOWN, **logs)


def test_texts_of_a_failure() -> None:
    """Its lines first, what hid them last of these; findings and what was kept of its phase are beside."""
    reply = [
        {"check": "vector.sync", "outcome": "failed", "raised": {"type": "E", "traceback": "File a\nE: deep"}},
        {
            "kind": "check",
            "check": "vector.sync",
            "outcome": "skipped",
            "workers": [{"stacks": "File b"}],
            "observed": HUNG,
        },
        {"check": "single.loop", "outcome": "failed", "raised": {"traceback": "of another phase"}},
        {"check": "vector.async.fork", "outcome": "passed", "raised": {"traceback": "of what passed"}},
        {"kind": "raised", "raised": {"traceback": "of a worker"}},
    ]
    lines = "\n".join(map(json.dumps, reply)) + '\n{"cut'
    logs = {"v": {"log.txt": "libEGL warning", "reply.jsonl": lines}}
    found = (warning("vector.repeat", "another trajectory"),)
    failed = replace(VECTOR, findings=found)
    (told,) = assess(record(case("ppfp", vector=failed)), knowledge(**logs)).failures
    assert (told.phase, told.reasons, told.signal) == (Phase.VECTOR, (XML, RESET), None)
    assert told.logs == (
        "another trajectory", "libEGL warning", "File a\nE: deep", "File b", "KeyError: 'x'", "of a worker",
    )  # fmt: skip


def test_observations_of_a_failure_come_with_their_lines() -> None:
    """Each observation comes with its line: the line that says why, or that of a finding beside it."""
    said, beside = (Observation(check="vector.sync", code=code) for code in ("vector.rewards", "vector.repeat"))
    check = CheckRecord(check="vector.sync", outcome=Outcome.FAILED, decisive=XML, observed=said)
    finding = replace(warning("vector.repeat", "another trajectory"), observed=beside)
    failed = replace(VECTOR, checks=(check,), findings=(finding, warning("vector.x", "of a library")))
    (told,) = assess(record(case("ppfp", vector=failed))).failures
    assert told.observed == (
        Sighting(observed=said, line=XML, is_reason=True),
        Sighting(observed=beside, line="another trajectory", is_reason=False),
    )


def test_a_step_of_the_host_and_a_signal() -> None:
    """The log of a build is read; what killed a process is told from its line."""
    failed = replace(step(Phase.INSTALL, Outcome.FAILED, "worker killed by SIGSEGV in f"), log="evidence/build.log")
    made = record(install=failed, installed=None)
    (told,) = assess(made, Knowledge(logs=lambda path: {path: "gcc: no"})).failures
    assert (told.phase, told.reasons, told.logs, told.signal) == (
        Phase.INSTALL, ("worker killed by SIGSEGV in f",), ("gcc: no",), "SIGSEGV",
    )  # fmt: skip


@pytest.mark.parametrize(("locked", "found"), [(("gymnasium==1.2.3",), ["xml"]), (("gymnasium==2.0",), []), ((), [])])
def test_packages_of_the_lock_take_part(locked: tuple[str, ...], found: list[str]) -> None:
    """After a failed install, packages that nobody named are those of the lock."""
    (one,) = (each for each in KNOWN if each.id == "xml")
    generic = msgspec.structs.replace(one, generic=True, phases=(Phase.INSTALL,))
    failed = step(Phase.INSTALL, Outcome.FAILED, "XML Error")
    made = replace(record(install=failed, installed=None), lock="locks/one.txt")
    made = replace(made, cell=replace(made.cell, question=replace(made.cell.question, requirements=("tool",))))
    knowing = Knowledge(signatures=lambda: (generic,), locked={"locks/one.txt": locked}.__getitem__)
    assert [each.signature.id for each in assess(made, knowing).diagnoses] == found


@pytest.mark.parametrize("letters", ["pppp", "ppip", "pppu", "ssss"])
def test_only_red_cells_are_diagnosed(letters: str) -> None:
    """Of what works, or says nothing about packages, no cause is sought."""
    made = record(case(letters, single=phase(Phase.SINGLE, Outcome.PASSED, findings=(warning("x", "XML Error"),))))
    assert assess(made, knowledge()).diagnoses == ()


def test_the_document_has_the_cause_before_its_mask() -> None:
    """The cause has all that a reader needs; a missing package rules a signature out."""
    red = entry(MASKED, knowledge())
    first = DiagnosisEntry(
        signature="xml",
        cause="the model is wrong",
        remedy={"requirements": ["mujoco<3"], "text": "or mend it"},
        proven=False,
        masks=False,
        references=("https://example.org/1",),
        phase=Phase.VECTOR,
        seen=XML,
    )
    assert red.diagnoses[0] == first
    assert [each.signature for each in red.diagnoses] == ["xml", "mask"]
    other = replace(MASKED, installed={"gymnasium": "2.0"})
    assert [each.signature for each in entry(other, knowledge()).diagnoses] == ["mask"]
    assert entry(MASKED, Knowledge()).diagnoses == ()


def test_a_mask_that_was_seen_through_is_no_cause() -> None:
    """It is among the diagnoses, and nobody is told that it is the reason; where nothing was found behind it, it is."""
    through = replace(VECTOR, decisive="worker killed by SIGKILL", checks=())
    check = CheckRecord(check="vector.sync", outcome=Outcome.FAILED, decisive=through.decisive, masked_by=RESET)
    seen = entry(record(case("ppfp", vector=replace(through, checks=(check,)))), knowledge())
    assert [each.signature for each in seen.diagnoses] == ["mask"]
    assert select_counting(seen) == ()
    bare = entry(record(case("ppfp", vector=replace(VECTOR, decisive=RESET, checks=()))), knowledge())
    assert [each.signature for each in select_counting(bare)] == ["mask"]


def expecting(signature: str) -> CellRecord:
    """Return the masked failure, in a cell that is expected to fail in this way."""
    expect = Expectation(verdict=Verdict.PARTIAL, reason="known", signature=signature)
    return replace(MASKED, cell=replace(MASKED.cell, expect=expect))


@pytest.mark.parametrize(("signature", "fits"), [("xml", True), ("mask", False), ("crash", False)])
def test_a_cell_can_be_expected_to_fail_in_a_known_way(signature: str, fits: bool) -> None:
    """An expected failure is recognised by its cause, never by its mask."""
    assert entry(expecting(signature), knowledge()).as_expected is fits


def test_a_mask_counts_where_nothing_else_is_known() -> None:
    """So a cell can be expected to fail by one."""
    bare = replace(VECTOR, decisive=RESET, checks=())
    made = replace(expecting("mask"), cases=(case("ppfp", vector=bare),))
    assert entry(made, knowledge()).as_expected is True


def test_kept_texts_are_read_to_a_bound(tmp_path: Path) -> None:
    """Files of a folder by name, of a long one both ends; no pictures; nothing where nothing is."""
    (tmp_path / "e").mkdir()
    (tmp_path / "e" / "log.txt").write_text("begin" + "x" * 100_000 + "end")
    (tmp_path / "e" / "first.png").write_bytes(b"\x89")
    (tmp_path / "uv.log").write_text("short")
    read = shipped_signatures.texts(tmp_path / "e")["log.txt"]
    assert (read[:5], read[-3:], len(read) < 65_000) == ("begin", "end", True)
    assert list(shipped_signatures.texts(tmp_path / "e")) == ["log.txt"]
    assert shipped_signatures.texts(tmp_path / "uv.log") == {"uv.log": "short"}
    assert shipped_signatures.texts(tmp_path / "gone") == {}


def test_signatures_come_from_the_named_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A variable names another folder of signatures, or none if it is empty; a wrong folder is refused."""
    monkeypatch.setenv(signature_files.VARIABLE, "")
    assert shipped_signatures.load_all() == ()
    monkeypatch.setenv(signature_files.VARIABLE, str(tmp_path / "gone"))
    with pytest.raises(BadInput, match="is not a folder; HARNESS_SIGNATURES names the folder of the signatures"):
        shipped_signatures.load_all()


def test_an_expectation_without_a_signature_reads_no_log(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Pytest items and `--only-failed` read no log for a cell whose expectation names no signature."""
    monkeypatch.setenv(signature_files.VARIABLE, str(tmp_path / "gone"))
    assert assess(MASKED, shipped_signatures.load_knowledge(tmp_path)).as_expected is False
    monkeypatch.delenv(signature_files.VARIABLE)
    reset = replace(VECTOR, decisive=RESET, checks=())
    made = replace(expecting("worker-connection-reset"), cases=(case("ppfp", vector=reset),))
    assert assess(made, shipped_signatures.load_knowledge(tmp_path)).as_expected is True


def test_the_cause_of_a_suite_without_an_environment() -> None:
    """The log of the failed build is compared with known failures; those of the cell stay its own."""
    swig = """
[[signature]]
id = "no-swig"
phases = ["install"]
pattern = "command 'swig' failed"
cause = "SWIG is missing"
examples = ["command 'swig' failed", "error: command 'swig' failed", "again: command 'swig' failed"]
remedy = { requirements = ["box2d"] }
"""
    refused = Step(phase=Phase.INSTALL, outcome=Outcome.FAILED, decisive="exit code 1", log="evidence/build")
    made = record(
        case("pppp"),
        of=cell(cases=["ant"], subject=Subject(source=".", suite=Suite())),
        suite=own_suites.not_run("the environment of the tests cannot be made: exit code 1", refused),
    )
    logs = {"build.txt": "running build_ext\nerror: command 'swig' failed: No such file or directory"}
    knowing = Knowledge(signatures=lambda: signatures.read({"k.toml": swig}), logs=lambda _: logs)

    found = entry(made, knowing)

    assert (found.verdict, found.diagnoses) == (Verdict.WORKS, ())
    assert found.suite
    assert [one.signature for one in found.suite.diagnoses or ()] == ["no-swig"]
    assert found.unverified == ("suite",)
