"""Every way in which an environment goes wrong at run time ends in the right verdict, with the line that says why."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import pytest
from commandline import DeskRun, processes_of

SEGFAULT = r"killed by SIGSEGV \(Fatal Python error: Segmentation fault\) in string_at, ctypes/__init__\.py line \d+"
OTHERS = ("import.modules", "single.loop", "vector.sync", "render.rgb_array")
VIOLATION = "ContractViolation: "
XML_ERROR = "ValueError: XML Error: Schema violation: unrecognized attribute: 'springinertia' / Element 'body', line 3"

WORKING = (
    "healthy",
    "pictureless",
    "nondeterministic",
    "reseed",
    "shared",
    "tuple",
    "out-of-space",
    "double-fork",
    "writer",
    "fragile",
    "fragile-hang",
    "late-raise",
    "late-ignored",
    "late-crash",
    "placed",
    "settling",
    "own-vector",
    "own-vector-unseeded",
)
"""Nothing of what is wrong with these stops a user's loop."""

RED = {
    "segfault": ("broken", "single", "crashed", SEGFAULT),
    "abort": (
        "broken",
        "single",
        "crashed",
        r"killed by SIGABRT \(physics\.c:12: advance: Assertion `mass > 0' failed\.\) in step, "
        r"site-packages/fake_abort\.py line \d+",
    ),
    "exit": ("broken", "single", "crashed", "exited with code 3 without a word"),
    "sys-exit": ("broken", "single", "failed", "SystemExit: no licence file"),
    "liar": ("broken", "single", "crashed", "exited with code 0 without a word"),
    "hang": ("broken", "single", "timed_out", r"no end within 3 s, in step, site-packages/fake_hang\.py line \d+"),
    "hang-making": (
        "broken",
        "single",
        "timed_out",
        r"no end within 3 s, in wait, python3\.\d+/threading\.py line \d+",
    ),
    "flood": ("broken", "single", "timed_out", r"no end within 3 s, in step, site-packages/fake_flood\.py line \d+"),
    "wrong-arity": (
        "broken",
        "single",
        "failed",
        VIOLATION + r"step\(\) returned a tuple of 4, not \(observation, reward, terminated, truncated, info\)",
    ),
    "wrong-shape": (
        "broken",
        "single",
        "failed",
        VIOLATION + r"reset\(\) returned an observation that has shape \(2,\), its space \(3,\)",
    ),
    "wrong-dtype": (
        "broken",
        "single",
        "failed",
        VIOLATION + r"reset\(\) returned an observation that has dtype complex(64|128), its space float32",
    ),
    "non-finite": (
        "broken",
        "single",
        "failed",
        VIOLATION + r"step\(\) returned an observation that is not finite \(3 of 3 values\)",
    ),
    "worker-raises": ("partial", "vector", "failed", re.escape(XML_ERROR)),
    "worker-exits": ("partial", "vector", "failed", "worker exited with code 5 without a word"),
    "worker-crashes": ("partial", "vector", "failed", "worker " + SEGFAULT),
    "worker-hangs": (
        "partial",
        "vector",
        "timed_out",
        r"worker hangs in trouble, site-packages/fake_worker\.py line \d+",
    ),
    "blank-frame": ("partial", "render", "failed", VIOLATION + r"blank frame: every pixel is \[0, 0, 0\]"),
    "teardown": ("partial", "vector", "failed", "RuntimeError: the viewer is gone"),
    "late-hang": ("partial", "vector", "timed_out", r"worker hangs in \w+, python3\.\d+/threading\.py line \d+"),
    "nondeterministic-refused": (
        "partial",
        "single",
        "failed",
        r"single\.repeat\.process: the same seed gives another trajectory in another process, from step 0 on",
    ),
    "fragile-refused": ("partial", "single", "failed", r"single\.check_env: " + SEGFAULT),
    "own-vector-constant": (
        "broken",
        "interop",
        "failed",
        VIOLATION + r"the observations of the vector environment stay the same over \d+ steps",
    ),
    "import-error": (
        "import_fails",
        "import",
        "failed",
        re.escape("ImportError: libfake.so.1: cannot open shared object file: No such file or directory"),
    ),
    "undeclared": ("import_fails", "import", "failed", "ModuleNotFoundError: No module named 'packaging'"),
}
"""Defect to verdict, the phase that decided it, how that phase ended, and the decisive line."""

MISLEADING = {
    "misplaced": (
        "single",
        "single.start_pose",
        VIOLATION
        + r"after reset\(\) 2 of 2 joints are not where initial_qpos has them: 'base:1' is at 0, not at 0\.48",
    )
}
"""Defect to the phase and the check that showed what contradicts its own specification, and the decisive line."""

IN_WORKERS = r"the same seed and actions give other values in vector\.async\.fork than in vector\.sync, from step "
A_TUPLE = r"(reset|step)\(\) returned an observation that is a tuple of 3 where an array was promised"
OUTSIDE = r"(reset|step)\(\) returned an observation outside its space .*"
FOUND = {
    "healthy": {},
    "pictureless": {},
    "nondeterministic": {
        "single.repeat.fresh": r"the same seed gives another trajectory in a new environment, from step 0 on .*",
        "single.repeat.same": r"the same environment, reset with the same seed, gives another trajectory, .*",
        "single.repeat.process": r"the same seed gives another trajectory in another process, from step 0 on",
        "vector.repeat": IN_WORKERS + r"0 on .*",
        "single.check_env": r"AssertionError: Using `env.reset\(seed=123\)` is non-deterministic .*",
    },
    "reseed": {
        "single.repeat.same": r"the same environment, reset with the same seed, gives another trajectory, .*",
        "single.check_env": r"AssertionError: Using `env.reset\(seed=123\)` is non-deterministic .*",
    },
    "shared": {
        "vector.repeat": IN_WORKERS + r"1 on .*",
        "vector.autoreset": r"environment 0 of 2 gives another observation than alone with its seed and actions, "
        r"from step 1 on, episodes that begin in mode (NEXT_STEP|SAME_STEP|DISABLED)",
    },
    "tuple": {
        "single.type": A_TUPLE,
        "single.check_env": r"Casting input x to numpy array\.|The obs returned by the `(reset|step)\(\)` method was "
        r"expecting a numpy array, actual type: <class 'tuple'>",
    },
    "out-of-space": {
        "single.space": OUTSIDE,
        "single.check_env": r"AssertionError: The first element returned by `env.reset\(\)` is not within .*",
        "vector.space": OUTSIDE,
    },
    "double-fork": {"import.stray": r"left \d+ process\(es\) behind at its end"},
    "writer": {
        "import.written": r"wrote into its own environment \(kept from other runs\): "
        r"lib/python3\.\d+/site-packages/fake_healthy\.py, lib/python3\.\d+/site-packages/fake_writer_cache\.txt",
    },
    "fragile": {"single.check_env": SEGFAULT},
    "fragile-hang": {
        "single.check_env": r"no end within 1\.5 s, in reset, site-packages/fake_fragile_hang\.py line \d+"
    },
    "late-raise": {"single.teardown": r"exception ignored in .*: RuntimeError: the GL context is gone"},
    "late-ignored": {
        "render.teardown": r"at the end of Python, the environment left open: RuntimeError: the GL context is lost"
    },
    "late-crash": {"render.teardown": "after the last check: " + SEGFAULT},
    "late-hang": {"render.teardown": r"Python did not end within [\d.]+ s of the last check"},
    "worker-hangs": {},
    "own-vector": {},
    "own-vector-unseeded": {
        "interop.gymnasium.make_vec": r"the same seed and actions give other values in a second vector environment, .*"
    },
}
"""Defect to the checks that found something, with a pattern for every text."""


def test_every_defect_is_looked_at(defects: DeskRun) -> None:
    """The tables above and the matrix name the same defects, so that none is measured and not looked at."""
    assert sorted(defects.ran.cells("defect")) == sorted({*WORKING, *RED, *MISLEADING})


@pytest.mark.parametrize("defect", WORKING)
def test_a_defect_that_stops_no_loop_works(defects: DeskRun, defect: str) -> None:
    """A defect that a user's loop does not meet leaves the verdict alone."""
    cell = defects.ran.cells("defect")[defect]
    assert (cell["verdict"], cell["decisive"], cell["unverified"]) == ("works", None, [])


@pytest.mark.parametrize("defect", RED)
def test_a_defect_that_stops_a_loop_is_red(defects: DeskRun, defect: str) -> None:
    """A defect that stops a loop ends in its verdict, with the line that a person would quote."""
    cell = defects.ran.cells("defect")[defect]
    verdict, phase, outcome, decisive = RED[defect]
    assert (cell["verdict"], cell["phase"], cell["phases"][phase]) == (verdict, phase, outcome)
    assert re.fullmatch(decisive, cell["decisive"]), cell["decisive"]


@pytest.mark.parametrize("defect", MISLEADING)
def test_a_contradiction_misleads(defects: DeskRun, defect: str) -> None:
    """A defect that raises nothing but contradicts the environment's claims leaves its phase passed, and misleads."""
    cell = defects.ran.cells("defect")[defect]
    phase, check, decisive = MISLEADING[defect]
    assert (cell["verdict"], cell["phase"], cell["phases"][phase]) == ("misleads", phase, "passed")
    assert [(case["misleads"], case["checks"][check]) for case in cell["cases"]] == [([check], "failed")]
    assert re.fullmatch(decisive, cell["decisive"]), cell["decisive"]
    assert check not in {finding["check"] for finding in cell["findings"]}


@pytest.mark.parametrize(
    ("defect", "outcomes"),
    [
        ("placed", ("passed", "not_reached", "passed", "passed")),
        ("settling", ("skipped", "not_reached", "passed", "passed")),
        ("healthy", ("skipped", "skipped", "skipped", "passed")),
        ("tuple", ("skipped", "skipped", "skipped", "not_reached")),
    ],
)
def test_a_check_without_a_comparison_is_skipped(defects: DeskRun, defect: str, outcomes: tuple[str, ...]) -> None:
    """A check is skipped without a specification, on something other than MuJoCo, or after a fault of our own."""
    (case,) = defects.ran.cells("defect")[defect]["cases"]
    names = ("single.start_pose", "single.contact", "single.solver", "single.arrays")
    assert tuple(case["checks"][name] for name in names) == outcomes
    assert case["misleads"] == []


@pytest.mark.parametrize("defect", FOUND)
def test_findings(defects: DeskRun, defect: str) -> None:
    """Problems that do not stop a loop are warnings of the check that saw them; nothing else is a warning."""
    found = defects.ran.cells("defect")[defect]["findings"]
    assert {finding["check"] for finding in found} == set(FOUND[defect])
    for finding in found:
        assert finding["level"] == "warning"
        assert re.fullmatch(FOUND[defect][finding["check"]], finding["text"]), finding["text"]


def test_a_failed_single_leaves_the_rest_unreached(defects: DeskRun) -> None:
    """Vector and render need an environment that runs: after a failed single nobody tries them."""
    for defect, (_, phase, _, _) in RED.items():
        cell = defects.ran.cells("defect")[defect]
        if phase == "single" and not defect.endswith("-refused"):
            assert (cell["phases"]["vector"], cell["phases"]["render"]) == ("not_reached", "not_reached"), defect
            assert set(cell["cases"][0]["checks"]) == {"import.modules", "single.loop"}, defect


@pytest.mark.parametrize("defect", ["worker-raises", "worker-exits", "worker-crashes", "worker-hangs"])
def test_other_checks_still_report(defects: DeskRun, defect: str) -> None:
    """Checks before and after those with dying workers still report."""
    (case,) = defects.ran.cells("defect")[defect]["cases"]
    outcomes = {check: case["checks"][check] for check in case["checks"] if check in OTHERS}
    assert outcomes == dict.fromkeys(OTHERS, "passed")


@pytest.mark.parametrize("defect", ["worker-raises", "worker-exits", "worker-crashes"])
def test_a_broken_pipe_is_a_mask_and_never_the_cause(defects: DeskRun, defect: str) -> None:
    """The broken pipe of a dead worker is reported as a mask of the cause, never as the cause."""
    (case,) = defects.ran.cells("defect")[defect]["cases"]
    assert re.match("ConnectionResetError|BrokenPipeError|EOFError", case["masked"]["vector.async.fork"])


def test_a_render_without_meaning_is_skipped(defects: DeskRun) -> None:
    """An environment that declares no picture has no render to fail."""
    assert defects.ran.cells("defect")["pictureless"]["phases"]["render"] == "skipped"


def test_a_timeout_is_tried_twice(defects: DeskRun) -> None:
    """A check that overran its limit gets a second try with the doubled limit; the seconds of the try count."""
    cell = defects.ran.cells("defect")["hang"]
    assert cell["attempts"] == 2
    assert cell["seconds"] >= 3


def test_no_process_is_left(defects: DeskRun) -> None:
    """Hangs deaf to SIGTERM, daemons and workers: when the command is back, none of their processes is there."""
    assert processes_of(defects.desk.mark) == []


def test_endless_output_is_bounded(defects: DeskRun) -> None:
    """Endless output is cut: its head and its tail are kept."""
    log = _evidence(defects, "flood") / "log.txt"
    assert log.stat().st_size < 3 << 20
    assert log.read_text().startswith("the solver did not converge\n")


def test_writes_reach_no_other_environment(defects: DeskRun) -> None:
    """A probe's writes into its environment are discarded: the shared environment stays as it was installed."""
    (module,) = defects.desk.cache.glob("environments/*/**/site-packages/fake_writer.py")
    assert not (module.parent / "fake_writer_cache.txt").exists()
    assert "neighbour" not in (module.parent / "fake_healthy.py").read_text()


def test_every_cell_has_its_evidence(defects: DeskRun) -> None:
    """Each verdict names a folder with what the probe wrote, and each phase that did not pass names its own."""
    for cell in defects.ran.document["cells"]:
        assert (defects.desk.folder / cell["evidence"] / "reply.jsonl").stat().st_size > 0
        for case in cell["cases"]:
            tried = {
                name for name, outcome in case["phases"].items() if outcome not in {"passed", "not_reached", "skipped"}
            }
            assert tried <= set(case["evidence"])
            assert all((defects.desk.folder / path).is_dir() for path in case["evidence"].values())


def test_evidence_names_no_place_of_this_machine(defects: DeskRun) -> None:
    """Evidence and reports can be published: the folders of the run are names like $ENV in them."""
    places = [str(defects.desk.folder), str(defects.desk.cache), f"{tempfile.gettempdir()}/simmatrix-"]
    texts = [path for path in defects.desk.state.glob("evidence/*/*") if path.suffix in {".txt", ".jsonl"}]
    reports = list((defects.desk.state / "reports" / "defects").glob("report.*"))
    assert texts
    assert reports
    assert [path.name for path in texts + reports if any(place in path.read_text() for place in places)] == []


def _evidence(measured: DeskRun, defect: str) -> Path:
    return measured.desk.folder / measured.ran.cells("defect")[defect]["evidence"]
