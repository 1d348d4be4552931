"""The verdicts before anything runs, and those that say nothing about packages.

With the defects, these are all verdicts.
"""

from __future__ import annotations

import re
import shutil

import pytest
from commandline import Desk, DeskRun

from harness.judging.assess import assess
from harness.machine import interpreters, process, this_machine
from harness.model import Case, Cell, CellRecord, IndexSettings, Outcome, Phase, Question, Step, Verdict
from harness.packages import resolver
from harness.packages.environments import environments
from harness.probes import launch
from harness.probes.evidence import Host
from harness.probes.measure import Laboratory
from harness.probes.vault import Vault
from harness.running import case_run

EARLY = {
    "works": ("works", None, None, None),
    "builds": ("works", None, None, None),
    "flaky": ("broken", "single", "flaky", "passed 2 of 3 runs; else: OSError: the device is busy"),
    "unresolvable": (
        "unresolvable",
        "resolve",
        "failed",
        "Because only fake-plain>=1.0 is available and all versions of fake-unresolvable depend on fake-plain<1, "
        "we can conclude that all versions of fake-unresolvable cannot be used. And because you require "
        "fake-unresolvable",
    ),
    "no-wheel": (
        "unresolvable",
        "resolve",
        "failed",
        r"Because fake-no-wheel==1\.0 has no wheels with a matching Python implementation tag \(e\.g\., `cp\d+`\).*",
    ),
    "build-failure": (
        "uninstallable",
        "install",
        "failed",
        "RuntimeError: FAKE_PATH environment variable is not set",
    ),
    "left-out": ("not_run", None, None, None),
}
"""Cell to verdict, the phase that decided it, how that ended, and the decisive line."""


@pytest.mark.parametrize("what", EARLY)
def test_verdicts_about_packages(verdicts: DeskRun, what: str) -> None:
    """Each failure of packages has its own verdict: no solution, no wheel, a failed build, a flaky failure."""
    cell = verdicts.ran.cells("what")[what]
    wanted, phase, outcome, decisive = EARLY[what]
    assert (cell["verdict"], cell["phase"], cell["phases"].get(phase)) == (wanted, phase, outcome)
    assert cell["decisive"] is None if decisive is None else re.fullmatch(decisive, cell["decisive"])


def test_a_python_that_nobody_has_is_unavailable(verdicts: DeskRun) -> None:
    """A cell whose interpreter cannot be had says what to do, and blames no package."""
    cell = _cell(verdicts, "verdict-python")
    assert (cell["verdict"], cell["as_expected"], cell["python"]) == ("unavailable", None, None)
    assert cell["decisive"] == (
        "python 3.99 is not on this machine and uv could not download it; "
        "install it with `uv python install 3.99` or pyenv, then run again"
    )


def test_an_index_that_does_not_answer_is_inconclusive(verdicts: DeskRun) -> None:
    """An index failure is infra: never a verdict about packages."""
    cell = _cell(verdicts, "verdict-index")
    assert (cell["verdict"], cell["as_expected"], cell["phases"]["resolve"]) == ("inconclusive", None, "infra")
    assert re.search("Network is unreachable|Connection refused", cell["decisive"])


def test_a_capability_that_is_missing_is_unavailable(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cell that needs what this machine lacks is not tried."""
    monkeypatch.setenv("HARNESS_CACHE", str(desk.cache))
    missing = sorted({"gpu", "display", "osmesa", "egl"} - this_machine.facts().capabilities)
    if not missing:
        pytest.skip("unavailable: a capability that is missing")
    text = f'needs = ["{missing[0]}"]\ncases = [{{ imports = ["fake_plain"] }}]\n[axes]\npython = ["host"]\n'
    ran = desk.run("run", desk.matrix("needs", text), "--json")
    (cell,) = ran.document["cells"]
    assert (ran.code, cell["verdict"]) == (0, "unavailable")
    assert cell["decisive"].startswith("no " + this_machine.HINTS[missing[0]][0])


@pytest.mark.skipif(not shutil.which("dpkg-query"), reason="unavailable: dpkg")
def test_a_package_of_the_system_that_is_missing_is_unavailable(desk: Desk) -> None:
    """A missing system package makes a cell unavailable before anything is built.

    The message says how to install the package.
    """
    text = 'system = ["dpkg", "no-such-dev"]\ncases = [{ imports = ["fake_plain"] }]\n[axes]\npython = ["host"]\n'
    ran = desk.run("run", desk.matrix("system", text), "--json")
    (cell,) = ran.document["cells"]
    assert (ran.code, cell["verdict"], cell["lock"]) == (0, "unavailable", None)
    assert cell["decisive"] == "no no-such-dev here: run `apt install no-such-dev`"


def test_more_memory_than_allowed_is_inconclusive(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process above our memory limit is killed and counts as infra, whatever the package."""
    record = _probed(desk, monkeypatch, "fake_memory_hog:MemoryHog-v0", memory_mb=300)
    judged = assess(record)
    assert (judged.verdict, judged.phases[Phase.SINGLE]) == (Verdict.INCONCLUSIVE, Outcome.INFRA)
    assert judged.decisive == "needs more than the 300 MB that its case allows; `memory_mb` of the case raises that"


def test_another_python_than_the_lock_s_is_inconclusive(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment whose Python was changed under it says nothing about packages."""
    other = interpreters.find("3.9")
    if other is None:
        pytest.skip("unavailable: python3.9")
    record = _probed(desk, monkeypatch, "fake_healthy:Healthy-v0", python=other.path)
    judged = assess(record)
    assert (judged.verdict, judged.phases[Phase.IMPORT]) == (Verdict.INCONCLUSIVE, Outcome.INFRA)
    assert judged.decisive == f"the environment's Python is {other.version}, not {record.python}"


@pytest.mark.parametrize("sandbox", ["pid+readonly", "subreaper"])
def test_a_write_is_seen_where_nothing_can_be_laid_over(
    sandbox: str, desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without an overlay a probe writes into a copy: it works as for its user, and the write is a finding."""
    monkeypatch.setenv("HARNESS_CACHE", str(desk.cache))
    if process.sandbox_mode() != "pid+overlay":
        pytest.skip("unavailable: namespaces")
    text = 'requirements = [@FAKES@]\nindex = { no_index = true, find_links = ["@WHEELS@"] }\n'
    text += 'cases = [{ env = "fake_writer:Writer-v0", api = "gymnasium" }]\n[axes]\npython = ["host"]\n'
    own = str(desk.folder / "cache")  # unsealed, environments are copies: those of other tests need not be
    ran = desk.run("run", desk.matrix("m", text), "--json", HARNESS_SANDBOX=sandbox, HARNESS_CACHE=own)
    (cell,) = ran.document["cells"]
    assert (ran.code, cell["verdict"], cell["phases"]["import"]) == (0, "works", "passed")
    assert [found["check"] for found in cell["findings"] if "fake_writer_cache.txt" in found["text"]] == [
        "import.written"
    ]


def test_every_verdict_and_outcome_is_reached(defects: DeskRun, verdicts: DeskRun) -> None:
    """The two runs together show every verdict and outcome of the harness."""
    cells = [*defects.ran.document["cells"], *verdicts.ran.document["cells"]]
    assert {cell["verdict"] for cell in cells} == set(Verdict)
    assert {outcome for cell in cells for outcome in cell["phases"].values()} == set(Outcome)


def _cell(measured: DeskRun, matrix: str) -> dict[str, object]:
    (cell,) = (cell for cell in measured.ran.document["cells"] if cell["matrix"] == matrix)
    return dict(cell)


def _probed(
    desk: Desk, monkeypatch: pytest.MonkeyPatch, env: str, *, memory_mb: int = 6000, python: str | None = None
) -> CellRecord:
    """Return the record of an environment that is run in a way that no command line offers."""
    monkeypatch.setenv("HARNESS_CACHE", str(desk.cache))
    monkeypatch.setenv("HARNESS_STATE", str(desk.state))
    host = interpreters.find("host")
    assert host
    index = IndexSettings(no_index=True, find_links=(str(desk.wheels),))
    question = Question(requirements=("fake-memory-hog",), index=index)
    lock = resolver.resolve(question, host, desk.folder / "lock")
    assert not isinstance(lock, Step)
    made = environments.ensure(lock, host, question)
    folder = shutil.copytree(made.path, desk.folder / "environment", symlinks=True)
    if python:
        (folder / "bin" / "python").unlink()
        (folder / "bin" / "python").symlink_to(python)
    case = Case(id="c", env=env, api="gymnasium", checks=("import.modules", "single.loop"), memory_mb=memory_mb)
    cell = Cell(id="m/c", matrix="m", axes={}, python="host", question=question, environment={}, cases=(case,))
    context = case_run.Context(
        laboratory=Laboratory(
            vault=Vault(desk.state),
            site=lambda: launch.Site(
                folder=folder,
                python=folder / "bin" / "python",
                pycache=desk.folder / "pycache",
                variables=this_machine.base_environment(),
                files={},
            ),
            host=Host(python=host.version),
            places={},
        ),
        identity=(),
    )
    passed = Step(phase=Phase.RESOLVE, outcome=Outcome.PASSED)
    install = Step(phase=Phase.INSTALL, outcome=Outcome.PASSED)
    cases = (case_run.run_case(context, case),)
    return CellRecord(cell=cell, machine="m", python=host.version, resolve=passed, install=install, cases=cases)
