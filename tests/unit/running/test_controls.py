"""Controls: what a failure is worth beside one, which one speaks for a cell, and what is committed of them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from builders import CHECKS, LETTERS, case, cell, phase, phase_of_checks, record, step, warning
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from harness.judging.assess import Assessed, assess
from harness.judging.runs.check import NEEDS
from harness.model import (
    FAILING,
    CaseRecord,
    CellRecord,
    ControlRecord,
    Outcome,
    Phase,
    PhaseRecord,
    Verdict,
    replace,
)
from harness.model.errors import BadInput
from harness.model.vocabulary import APIS
from harness.packages import locks
from harness.running import controls

COMMITTED = Path(controls.__file__).parents[2] / "matrices" / "controls"
REACHABLE = ("fnnn", "pfnn", "pppp", "ppfp", "pppf", "ppff", "ppfu", "pppi", "ppss", "punn", "unnn", "innn")
"""What a case can come to, in the letters of `specimens`."""
CONTROLS = ("pppp", "fnnn", "pfnn", "ppfp", "pppf", "ppff", "pppu")


def control_record(letters: str) -> ControlRecord:
    """Return the record of a control whose checks ended as these letters say."""
    ended = dict(zip(CHECKS.values(), letters, strict=True))
    return ControlRecord(
        control="control good",
        passed=tuple(check for check, letter in ended.items() if letter == "p"),
        failed={check: f"line of {check}" for check, letter in ended.items() if LETTERS[letter] in FAILING},
    )


def with_control(control: ControlRecord, *cases: CaseRecord, api: str = "gymnasium") -> CellRecord:
    """Return a cell with these cases, beside the control of an adapter."""
    return replace(record(*cases), controls={api: control})


def is_doubted(at: Phase, control: str) -> bool:
    """Return whether a failure of this phase is not to be believed, by the letters of the control."""
    needed: Phase | None = at
    ended = dict(zip(CHECKS, control, strict=True))
    while needed:
        if ended[needed] == "f":
            return True
        needed = NEEDS.get(needed)
    return False


def assessment(found: Assessed) -> tuple[Any, ...]:
    """Return verdict, phases, phase, decisive line and unverified phases of an assessed cell."""
    return found.verdict, found.phases, found.phase, found.decisive, found.unverified


class TestJudging:
    """Assess a cell whose adapter's control is known."""

    @pytest.mark.parametrize(("tried", "control"), list(itertools.product(REACHABLE, CONTROLS)))
    def test_every_failure_beside_every_control(self, tried: str, control: str) -> None:
        """A failed phase is `infra` exactly where the control failed in it or in one that it needs; no other moves."""
        plain, told = assess(record(case(tried))), assess(with_control(control_record(control), case(tried)))
        for at, letter in zip(CHECKS, tried, strict=True):
            expected = Outcome.INFRA if letter == "f" and is_doubted(at, control) else LETTERS[letter]
            assert told.phases[at] is expected
        if "f" not in tried or "f" not in control:
            assert assessment(told) == assessment(plain)
        if told.verdict in {Verdict.WORKS, Verdict.UNAVAILABLE, Verdict.NOT_RUN}:
            assert assessment(told) == assessment(plain)
        if told.verdict not in {plain.verdict, Verdict.INCONCLUSIVE}:
            assert (plain.verdict, told.verdict) == (Verdict.BROKEN, Verdict.PARTIAL)

    def test_all_failures_doubted_is_inconclusive(self) -> None:
        """The line of the control decides, then comes the cell's own."""
        told = assess(with_control(control_record("pfnn"), case("pfnn")))
        line = "control good fails, too, in single.loop: line of single.loop (here: ant single)"
        assert (told.verdict, told.phase, told.decisive) == (Verdict.INCONCLUSIVE, Phase.SINGLE, line)

    def test_one_failure_believed_is_enough(self) -> None:
        """A cell whose vector fails by itself is partial, whatever the control's pictures are like."""
        told = assess(with_control(control_record("pppf"), case("ppff")))
        assert (told.verdict, told.phase, told.decisive) == (Verdict.PARTIAL, Phase.VECTOR, "ant vector")

    def test_an_adapter_answers_for_its_own_cases(self) -> None:
        """Another adapter's control, failed in everything, changes nothing."""
        plain = assess(record(case("fnnn")))
        assert assessment(assess(with_control(control_record("fnnn"), case("fnnn"), api="gym"))) == assessment(plain)

    @pytest.mark.parametrize("at", [Phase.RESOLVE, Phase.INSTALL])
    def test_steps_are_no_adapters(self, at: Phase) -> None:
        """A failed resolve or install is the packages' fault, whatever the control says."""
        failed = step(at, Outcome.FAILED, "no such release")
        steps = {"resolve": failed, "install": None} if at is Phase.RESOLVE else {"install": failed}
        red = replace(record(**steps), controls={"gymnasium": control_record("fnnn")})
        assert assess(red).decisive == "no such release"

    def test_a_control_that_could_not_run_changes_nothing(self) -> None:
        """One that could not be run has neither passed nor failed."""
        untold = ControlRecord(control="control good", untold="no Python 3.11 here")
        assert assessment(assess(with_control(untold, case("pfnn")))) == assessment(assess(record(case("pfnn"))))

    def test_a_finding_that_is_required_not_to_be_there(self) -> None:
        """It is doubted where the control fails in its phase."""
        single = phase(Phase.SINGLE, Outcome.PASSED, findings=(warning("single.space", "outside"),))
        red = case("pppp", required=("single.space",), single=single)
        assert assess(with_control(control_record("pppp"), red)).verdict is Verdict.PARTIAL
        told = assess(with_control(control_record("pfnn"), red))
        assert (told.verdict, told.phase) == (Verdict.INCONCLUSIVE, Phase.SINGLE)


class TestChecks:
    """Of one phase each check has an answer of its own."""

    FORK = ControlRecord(
        control="control good", passed=("single.loop", "vector.sync"), failed={"vector.async.fork": "no fork"}
    )

    @pytest.mark.parametrize(
        ("phase", "outcome", "line"),
        [
            (phase_of_checks(vector_sync=Outcome.FAILED), Outcome.FAILED, "own line of vector.sync"),
            (
                phase_of_checks(vector_async_fork=Outcome.CRASHED, vector_sync=Outcome.FAILED),
                Outcome.FAILED,
                "own line of vector.sync",
            ),
            (
                phase_of_checks(vector_async_fork=Outcome.CRASHED, vector_sync=Outcome.PASSED),
                Outcome.INFRA,
                "control good fails, too, in vector.async.fork: no fork (here: own line of vector.async.fork)",
            ),
            (
                phase_of_checks(vector_async_spawn=Outcome.FAILED),
                Outcome.INFRA,
                "control good fails, too, in vector.async.fork: no fork (here: own line of vector.async.spawn)",
            ),
        ],
        ids=["passed there", "one of two", "the same", "not tried there"],
    )
    def test_to_the_check(self, phase: PhaseRecord, outcome: Outcome, line: str) -> None:
        """A check that passed there is believed; one that failed there, or was not tried beside a failure, is not."""
        told = assess(with_control(self.FORK, case("pppp", vector=phase))).cases[0].phases[2]
        assert (told.outcome, told.decisive) == (outcome, line)


class TestSaid:
    """The conclusions about an adapter from the record of its control."""

    def test_works(self) -> None:
        """Its checks passed, where its lock is the known-good one."""
        assert self.judge("pppp").passed == tuple(CHECKS.values())

    def test_fails(self) -> None:
        """Each check that failed has its line."""
        told = self.judge("pppf")
        assert (told.failed, told.untold) == ({"render.rgb_array": "ant render"}, None)

    @pytest.mark.parametrize(
        ("letters", "why"),
        [
            ("innn", "import infra: ant import"),
            ("punn", "single unavailable: ant single"),
            ("pnnn", "nothing ran: only the import was tried"),
        ],
    )
    def test_untold(self, letters: str, why: str) -> None:
        """Trouble of the machine with the control itself says nothing of the adapter."""
        told = self.judge(letters)
        assert (told.passed, told.failed, told.untold) == ((), {}, f"the control known could not be run: {why}")

    def test_unresolvable(self) -> None:
        """A lock that cannot be had is no fault of the adapter."""
        failed = record(resolve=step(Phase.RESOLVE, Outcome.FAILED, "no versions"), install=None, of=self.cell())
        assert controls.judge(failed, None).untold == "the control known could not be run: resolve failed: no versions"

    def cell(self):
        return cell("known", id="controls/known", matrix="controls")

    def judge(self, letters: str) -> ControlRecord:
        return controls.judge(record(case(letters), of=self.cell()), "")


class TestFolder:
    """`controls.toml` and the locks beside it."""

    TEXT = """
        snapshot = "2026-11-20"
        [[control]]
        id = "new"
        api = "gymnasium"
        covers = "gymnasium>=1.0"
        python = "3.11"
        requirements = ["gymnasium==1.2.3"]
        env = "CartPole-v1"
        reason = "new"
        [[control]]
        id = "old"
        api = "gymnasium"
        python = "3.11"
        requirements = ["gymnasium==0.29.1"]
        env = "CartPole-v1"
        checks = ["single"]
        reason = "old"
    """

    @pytest.fixture
    def place(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        """Return a folder with two controls."""
        for name, version in (("new", "1.2.3"), ("old", "0.29.1")):
            (tmp_path / f"{name}.txt").write_text(f"gymnasium=={version} \\\n    --hash=sha256:{'0' * 64}\n")
        (tmp_path / controls.FILE).write_text(self.TEXT)
        monkeypatch.setenv(controls.VARIABLE, str(tmp_path))
        return tmp_path

    @pytest.mark.parametrize(
        ("installed", "found"),
        [
            ({"gymnasium": "1.4.0"}, "controls/new"),
            ({"gymnasium": "1.0.0a2"}, "controls/old"),
            ({"gymnasium": "0.26.3"}, "controls/old"),
            ({}, "controls/old"),
        ],
    )
    @pytest.mark.usefixtures("place")
    def test_the_first_that_covers_speaks(self, installed: dict[str, str], found: str) -> None:
        """The installed version selects the control; a control that names no version covers all the rest."""
        made = controls.find_control("gymnasium", installed)
        assert not isinstance(made, str)
        assert made.id == found

    @pytest.mark.usefixtures("place")
    def test_nobody_speaks(self) -> None:
        """An adapter without a control has a sentence that says so."""
        assert controls.find_control("gym", {}) == "the adapter gym has no control for these versions"

    @pytest.mark.usefixtures("place")
    def test_only_failures_after_the_install_ask(self) -> None:
        """A cell that works, a cell that was not installed, and a control itself need no control."""
        assert [one.id for one in controls.find_controls(record(case("ppfp"))).values()] == ["controls/new"]
        assert controls.find_controls(record(case("pppu"))) == {}
        assert controls.find_controls(record(case("pfnn"), installed=None)) == {}
        assert controls.find_controls(record(case("pfnn"), of=cell(matrix=controls.MATRIX))) == {}

    @pytest.mark.usefixtures("place")
    def test_the_cell_of_a_control(self) -> None:
        """Its question is the lock, whole; its case has the checks that are asked for."""
        _, old = controls.cells()
        assert (old.question.requirements, old.question.snapshot) == (("gymnasium==0.29.1",), "2026-11-20T23:59:59Z")
        assert old.cases[0].checks == ("import.modules", "single.loop")

    def test_a_wrong_key_is_refused(self, place: Path) -> None:
        """The message names the file and the nearest valid key."""
        other = place / "other"
        other.mkdir()
        (other / controls.FILE).write_text(self.TEXT.replace("reason", "raeson"))
        with pytest.raises(BadInput) as told:
            controls.read(other)
        assert str(told.value) == f'{other}/controls.toml: control[0].raeson: unknown key; did you mean "reason"?'

    def test_a_missing_folder_is_bad_input(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """A missing folder is bad input; the message names the variable that set it."""
        monkeypatch.setenv(controls.VARIABLE, str(tmp_path / "no"))
        with pytest.raises(BadInput) as told:
            controls.find_controls(record(case("pfnn")))
        assert str(told.value) == (
            f"{tmp_path}/no/controls.toml: cannot be read: No such file or directory; "
            "HARNESS_CONTROLS names the folder of the controls"
        )

    def test_none_at_all(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Set to the empty string the variable leaves none."""
        monkeypatch.setenv(controls.VARIABLE, "")
        assert (controls.folder(), controls.cells(), controls.find_controls(record(case("pfnn")))) == (None, (), {})


class TestCommitted:
    """The controls in `matrices/controls/`."""

    TABLES = controls.read(COMMITTED).control

    def names(self) -> Iterator[str]:
        return (table.id for table in self.TABLES)

    @pytest.mark.parametrize("api", APIS)
    def test_every_adapter_has_one_for_the_rest(self, api: str, monkeypatch: pytest.MonkeyPatch) -> None:
        """The last control of an adapter speaks for whatever the others do not; none comes after it.

        An adapter that can have no control says why.
        """
        covers = [table.covers for table in self.TABLES if table.api == api]
        without = controls.read(COMMITTED).without
        assert (api in without) is not bool(covers)
        if api in without:
            monkeypatch.setenv(controls.VARIABLE, str(COMMITTED))
            told = f"the adapter {api} has no control: {without[api]}"
            assert controls.find_control(api, {}) == told
            return
        assert [one is None for one in covers] == [False] * (len(covers) - 1) + [True]

    def test_every_lock_is_of_a_control(self) -> None:
        """No lock is missing and none is left over."""
        assert sorted(path.stem for path in COMMITTED.glob("*.txt")) == sorted(self.names())

    @pytest.mark.parametrize("table", TABLES, ids=lambda table: table.id)
    def test_locks_hold_what_is_asked_for(self, table: controls.ControlTable) -> None:
        """Each requirement is met by what the lock pins, and every pin has a hash."""
        pinned = locks.read_pins((COMMITTED / f"{table.id}.txt").read_text())
        for line in table.requirements:
            wanted = Requirement(line)
            assert wanted.specifier.contains(pinned[canonicalize_name(wanted.name)][0], prereleases=True)
        assert all(hashes for _, hashes in pinned.values())
