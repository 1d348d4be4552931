"""Test how the outcome of a check is judged, and which findings the end of a probe adds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import pytest
from builders import warning

from harness.judging.runs.check import Ending, check_record, reachable, side_findings, was_killed
from harness.model import CheckReply, Finding, Observation, Outcome, Phase, ProbeReply, Raised, WorkerRecord, replace
from harness.model.machine_trouble import SHOT, machine_trouble
from harness.model.words import sentence
from harness.probes import wire

PASSED = Outcome.PASSED
NOT_REACHED = "not looked at: the process ended before"
DRAWN = {"render.rgb_array": PASSED, "render.camera": PASSED, "render.unclosed": PASSED}
NO_GL = {"": "no EGL here: install it"}
NO_DISPLAY = {"pyglet": "no X display here: install it"}


def reply(checks: Mapping[str, Outcome | None], *, complete: bool = False) -> ProbeReply:
    """Return a reply with these checks and outcomes; `complete` says whether its last line is there."""
    told = tuple(CheckReply(check=name, outcome=outcome) for name, outcome in checks.items())
    return ProbeReply(checks=told, findings=(), frames=(), facts={}, modules=(), complete=complete)


def findings_at_end(told: ProbeReply, ending: Ending) -> Iterator[Finding]:
    """Yield the findings from a probe's end, where every check that follows another one was asked for."""
    return side_findings(told, ending, wire.followers_of(wire.FOLLOWERS))


def raised(
    text: str,
    *,
    check: str = "render.rgb_array",
    file: str = "x.py",
    type: str = "RuntimeError",
    blame: str = "library",
    modules: Sequence[str] = ("OpenGL",),
) -> CheckReply:
    """Return a check that failed with an exception from a library file; for rendering, OpenGL is loaded."""
    error = Raised(type=type, message=text, traceback=f'  File "$ENV/site-packages/{file}"', blame=blame)
    facts = {"loaded": list(modules)} if check.startswith("render") else {}
    return CheckReply(check=check, outcome=Outcome.FAILED, raised=error, facts=facts)


@pytest.mark.parametrize(
    ("ending", "outcome", "decisive"),
    [
        (Ending(exit_code=3), Outcome.CRASHED, "exited with code 3 without a word"),
        (Ending(signal=11), Outcome.CRASHED, "killed by SIGSEGV"),
        (Ending(signal=9, overran=2.0), Outcome.TIMED_OUT, "no end within 2 s"),
        (
            Ending(exit_code=1, full=True),
            Outcome.INFRA,
            "no room left on the disk of TMPDIR: exited with code 1 without a word",
        ),
        (
            Ending(exit_code=1, stacks="BlockingIOError: [Errno 11] Resource temporarily unavailable"),
            Outcome.INFRA,
            "Resource temporarily unavailable: exited with code 1 without a word",
        ),
        (Ending(signal=11, stacks="OSError: [Errno 24] Too many open files"), Outcome.CRASHED, "killed by SIGSEGV"),
        (Ending(signal=9), Outcome.INFRA, SHOT),
        (Ending(signal=9, stacks="Fatal Python error: x"), Outcome.INFRA, SHOT),
        (Ending(signal=9, trouble="interrupted"), Outcome.INFRA, "interrupted"),
        (Ending(signal=9, overran=2.0, trouble="interrupted"), Outcome.INFRA, "interrupted"),
    ],
)
def test_a_check_that_never_ended(ending: Ending, outcome: Outcome, decisive: str) -> None:
    """Its process died, hung, or was ended by us: the last says nothing about packages."""
    record = check_record(CheckReply(check="single.loop", outcome=None), ending, NO_GL)
    assert (record.outcome, record.decisive) == (outcome, decisive)


def observation(code: str, check: str = "single.contact", **data: str) -> Observation:
    """Return an observation of a check."""
    return Observation(check=check, code=code, data=data)


def violation(observed: Observation) -> Raised:
    """Return an observation as the exception that it stands for."""
    return Raised(type="ContractViolation", message=sentence(observed), traceback="", blame="library")


@pytest.mark.parametrize(
    ("check", "outcome", "decisive"),
    [
        (
            CheckReply(
                check="single.contact", outcome=Outcome.SKIPPED, reason="x", observed=observation("unmeasured.contact")
            ),
            Outcome.NOT_REACHED,
            "x",
        ),
        (
            CheckReply(
                check="single.contact", outcome=Outcome.SKIPPED, reason="x", observed=observation("contact.nothing")
            ),
            Outcome.SKIPPED,
            "x",
        ),
        (
            CheckReply(check="single.state", outcome=Outcome.SKIPPED, reason="could not be measured: x"),
            Outcome.SKIPPED,
            "could not be measured: x",
        ),
        (
            CheckReply(
                check="single.contact",
                outcome=Outcome.FAILED,
                raised=violation(observation("camera.behind")),
                observed=observation("camera.behind"),
            ),
            Outcome.FAILED,
            "ContractViolation: the body that the camera follows is behind it",
        ),
        (
            raised("too old", check="single.contact", type="ContractViolation"),
            Outcome.NOT_REACHED,
            "could not be measured: ContractViolation: too old",
        ),
    ],
)
def test_the_observation_of_a_misleading_check_decides(check: CheckReply, outcome: Outcome, decisive: str) -> None:
    """Its code, not its words: what could not be measured shows nothing, whatever name an exception has."""
    record = check_record(check, Ending(), {})
    assert (record.outcome, record.decisive, record.observed) == (outcome, decisive, check.observed)


@pytest.mark.parametrize(("code", "drew"), [("render.blank", True), ("render.blank_at_first", False)])
def test_a_blank_frame_is_a_failure_of_drawing(code: str, drew: bool) -> None:
    """Known by its code, whatever its words."""
    observed = observation(code, check="render.rgb_array")
    failed = CheckReply(check="render.rgb_array", outcome=Outcome.FAILED, raised=violation(observed), observed=observed)
    assert check_record(failed, Ending(), {}).facts == ({"drawing": True} if drew else {})


def test_a_workers_observation_goes_with_its_line() -> None:
    """The line of a worker comes before its parent's, and so does what it observed; an exception is no observation."""
    own, parents = observation("tensor.not_callable"), observation("value.kind")
    check = CheckReply(check="vector.async.fork", outcome=Outcome.FAILED, raised=violation(parents), observed=parents)
    alone = check_record(check, Ending(), {})
    assert alone.observed == parents
    told = check_record(
        replace(check, workers=(WorkerRecord(pid=1, raised=violation(own), observed=own),)), Ending(), {}
    )
    assert (told.observed, told.decisive) == (own, f"ContractViolation: {sentence(own)}")
    error = Raised(type="KeyError", message="'x'", traceback="", blame="library")
    other = check_record(replace(check, workers=(WorkerRecord(pid=1, raised=error),)), Ending(), {})
    assert (other.observed, other.decisive) == (None, "KeyError: 'x'")


@pytest.mark.parametrize(
    ("check", "undrawable", "outcome"),
    [
        (raised("[Errno 28] No space left on device"), {}, Outcome.INFRA),
        (raised("[Errno 30] Read-only file system: 'cache.txt'"), {}, Outcome.INFRA),
        (raised("marshal data too short", type="EOFError"), {}, Outcome.INFRA),
        (raised("Ran out of input", type="EOFError"), {}, Outcome.FAILED),
        (raised("list index out of range", blame="harness"), {}, Outcome.INFRA),
        (raised("no context"), {}, Outcome.FAILED),
        (raised("no context"), NO_GL, Outcome.UNAVAILABLE),
        (raised("no context", check="single.loop"), NO_GL, Outcome.FAILED),
        (raised("no context", check="single.loop", file="mujoco/osmesa/__init__.py"), NO_GL, Outcome.UNAVAILABLE),
        (raised("no context", check="single.loop", file="OpenGL/GL/__init__.py"), NO_GL, Outcome.UNAVAILABLE),
        (raised("no context", check="single.loop", file="pyglet/canvas/xlib.py"), NO_DISPLAY, Outcome.UNAVAILABLE),
        (raised("no context", check="single.loop", file="pyglet/canvas/xlib.py"), NO_GL, Outcome.FAILED),
        (raised("no context", modules=["pyglet"]), NO_DISPLAY, Outcome.UNAVAILABLE),
        (raised("no context", modules=["mujoco", "pyglet"]), NO_DISPLAY, Outcome.FAILED),
    ],
)
def test_an_exception_is_blamed_on_its_origin(
    check: CheckReply, undrawable: Mapping[str, str], outcome: Outcome
) -> None:
    """A full disk, a fault of ours and a machine that cannot draw are none of the packages'."""
    assert check_record(check, Ending(), undrawable).outcome is outcome


@pytest.mark.parametrize("check", [raised("BadWindow"), CheckReply(check="render.rgb_array", outcome=None)])
def test_a_display_that_died(check: CheckReply) -> None:
    """A check that failed while our own display died says nothing about packages: its outcome is infra."""
    lost = "the virtual display crashed with signal 11"
    record = check_record(check, Ending(signal=6, lost=lost), {})

    assert (record.outcome, record.decisive) == (Outcome.INFRA, lost)


def test_a_follower_that_ends_the_process_is_reported() -> None:
    """The check that died is a warning of its own, and those it kept from running are named."""
    ended = reply({"single.loop": PASSED, "single.repeat.fresh": None})
    assert list(findings_at_end(ended, Ending(signal=11))) == [
        warning("single.repeat.fresh", "killed by SIGSEGV"),
        warning("single.repeat.same", NOT_REACHED),
        warning("single.state", NOT_REACHED),
        warning("single.check_env", NOT_REACHED),
    ]


def test_followers_of_a_failed_check_are_not_missed() -> None:
    """After a failed loop nobody expects a comparison."""
    assert list(findings_at_end(reply({"single.loop": Outcome.FAILED}, complete=True), Ending(exit_code=0))) == []


@pytest.mark.parametrize(
    ("ending", "text"),
    [
        (Ending(exit_code=120), "after the last check: exited with code 120 without a word"),
        (Ending(signal=6), "after the last check: killed by SIGABRT"),
        (Ending(signal=9, overran=5.0), "Python did not end within 5 s of the last check"),
        (Ending(exit_code=0), "Python ended before its exit handlers had run"),
    ],
)
def test_a_crash_at_the_end_of_python_is_reported(ending: Ending, text: str) -> None:
    """A crash or a hang after the last check stops no loop, and is not passed over."""
    assert list(findings_at_end(reply(DRAWN), ending)) == [warning("render.teardown", text)]


@pytest.mark.parametrize("ending", [Ending(exit_code=0), Ending(signal=9, trouble="interrupted")])
def test_good_and_interrupted_ends_are_not_reported(ending: Ending) -> None:
    """Nothing is said of a probe that ended well, nor of one that was interrupted."""
    assert list(findings_at_end(reply(DRAWN, complete=True), ending)) == []


def test_phases_wait_for_those_that_they_need() -> None:
    """Vector and render need single, which needs the import; what is not known yet keeps nothing back."""
    assert reachable(Phase.RENDER, {})
    assert not reachable(Phase.RENDER, {Phase.IMPORT: Outcome.FAILED})
    assert reachable(Phase.RENDER, {Phase.VECTOR: Outcome.FAILED})


def test_an_ignored_exception_at_the_end_is_reported() -> None:
    """A traceback after the last words is of an exception that Python ignored; one before them was told elsewhere."""
    ignored = "Exception ignored in: <function Context.__del__>\nTraceback (most recent call last):\n"
    trace = ignored + '  File "gl.py", line 3, in __del__\n    free()\nEGLError: not initialized\n'
    text = "at the end of Python, the environment left open: EGLError: not initialized"

    def told(printed: str) -> list[Finding]:
        return list(findings_at_end(reply(DRAWN, complete=True), Ending(exit_code=0, stacks=printed)))

    assert told(f"{wire.LAST_WORDS}\n{trace}") == [warning("render.teardown", text)]
    assert told(f"{trace}{wire.LAST_WORDS}\nfreed 3 buffers\n") == []


class TestKilledFromOutside:
    def test_a_worker(self) -> None:
        """A worker that somebody killed is nobody's failure, whatever its parent made of that."""
        worker = WorkerRecord(pid=2, exit_code=-9)
        lost = Raised(type="BrokenPipeError", message="[Errno 32] Broken pipe", traceback="", blame="library")
        record = check_record(
            CheckReply(check="vector.async", outcome=Outcome.FAILED, raised=lost, workers=(worker,)), Ending(), {}
        )

        assert (record.outcome, record.decisive) == (Outcome.INFRA, f"worker {SHOT}")
        assert was_killed(record)

    def test_a_worker_that_its_parent_killed(self) -> None:
        """After an exception of its own a parent may kill what it started: that exception is the reason."""
        worker = WorkerRecord(pid=2, exit_code=-9)
        own = Raised(type="ValueError", message="no mass", traceback="", blame="library")
        record = check_record(
            CheckReply(check="vector.async", outcome=Outcome.FAILED, raised=own, workers=(worker,)), Ending(), {}
        )

        assert (record.outcome, record.decisive) == (Outcome.FAILED, "ValueError: no mass")


class TestDisks:
    @pytest.mark.parametrize(
        ("type", "message", "room", "outcome"),
        [
            ("RuntimeError", "No space left on device in the buffer", 50_000, Outcome.FAILED),
            ("RuntimeError", "No space left on device in the buffer", 3, Outcome.INFRA),
            ("RuntimeError", "No space left on device in the buffer", None, Outcome.INFRA),
            ("OSError", "[Errno 28] No space left on device", 50_000, Outcome.INFRA),
            ("RuntimeError", "cannot write (errno 28): No space left on device", 50_000, Outcome.INFRA),
            ("RuntimeError", "Read-only file system", 50_000, Outcome.INFRA),
        ],
    )
    def test_a_package_that_says_that_one_is_full(
        self, type: str, message: str, room: int | None, outcome: Outcome
    ) -> None:
        """A package's own words excuse nothing where every disk had room and no call of the system failed."""
        told = raised(message, check="single.loop", type=type)

        assert check_record(told, Ending(exit_code=0, least_room_mb=room), {}).outcome is outcome

    @pytest.mark.parametrize(
        ("text", "decisive", "room", "trouble"),
        [
            ("warning: Read-only file system, no cache", "error: no such header", None, False),
            ("warning: No space left on device", "error: no such header", 50_000, False),
            ("cc1: No space left on device\nerror: cc failed", "error: cc failed", 20, True),
            ("", "OSError: [Errno 30] Read-only file system: 'build'", 50_000, True),
            ("cc1: Cannot allocate memory", "error: cc failed", 50_000, True),
        ],
    )
    def test_messages_of_a_build_that_only_mention_a_disk(
        self, text: str, decisive: str, room: int | None, trouble: bool
    ) -> None:
        """A full or read-only disk that is only mentioned is no reason for a failure."""
        assert machine_trouble(text, decisive, room) is trouble


@pytest.mark.parametrize(("shares", "outcome"), [(True, Outcome.FAILED), (False, Outcome.INFRA)])
def test_no_shared_memory(shares: bool, outcome: Outcome) -> None:
    """No package is blamed for a machine without /dev/shm."""
    told = raised("[Errno 2] No such file or directory: '/dev/shm'", check="vector.async", type="FileNotFoundError")

    record = check_record(told, Ending(exit_code=0, shares_memory=shares), {})

    assert record.outcome is outcome
