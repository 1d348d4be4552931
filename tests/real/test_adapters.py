"""Adapters on real releases: every check passes, and an adapter returns the same values as a user's own loop.

The releases are those of `adapters.toml`, which says how to add one. With ENDURANCE in the environment the heavy ones
are run, too.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest

from harness.machine import interpreters, store
from harness.model import Cell, CellRecord, Level, Outcome, Phase, replace, words
from harness.model.vocabulary import APIS, MISLEADING
from harness.probes import launch
from harness.running import open_matrix
from harness.running.scheduler import ControlledRunner, QuietObserver, Runner, Settings
from harness.smoke.tried import CellUnderTest

HERE = Path(__file__).parent
DATA = tomllib.loads((HERE / "adapters.toml").read_text(encoding="utf-8"))
RELEASES = [one for one in DATA["release"] if os.environ.get("ENDURANCE") or not one.get("endurance")]
SEED, STEPS = 7, 20


def name(release: dict[str, Any]) -> str:
    """Return the name of a release in a test's id."""
    return f"{release['api']}-{release['requirements'][0]}-py{release['python']}-{release['env']}"


@pytest.fixture(scope="module")
def runner(tmp_path_factory: pytest.TempPathFactory) -> ControlledRunner:
    """Return a runner with a state and a cache of these tests alone."""
    folder = tmp_path_factory.mktemp("adapters")
    patch = pytest.MonkeyPatch()
    patch.setenv("HARNESS_STATE", str(folder / "state"))
    patch.setenv("HARNESS_CACHE", os.environ.get("HARNESS_CACHE") or str(folder / "cache"))
    yield ControlledRunner(Runner(store.open_store(), Settings(), QuietObserver()))
    patch.undo()


@pytest.mark.parametrize("api", APIS)
def test_every_adapter_is_held_to_two_releases(api: str) -> None:
    """Every adapter has two releases in `adapters.toml`, or says why it cannot."""
    versions = {one["requirements"][0] for one in DATA["release"] if one["api"] == api}
    assert (len(versions) >= 2) is not (api in DATA["fewer"])


CASE = ("api", "env", "kwargs", "imports", "checks", "timeouts", "memory_mb")
OWN = ("python", "skipped", "observation", "by_hand", "findings", "endurance")


def cell(release: dict[str, Any], folder: Path) -> Cell:
    """Return the cell of a release, as a matrix of one cell has it."""
    if interpreters.find(release["python"]) is None:
        pytest.skip(f"unavailable: python{release['python']}")
    case = {key: release[key] for key in CASE if key in release}
    table = {
        "snapshot": DATA["snapshot"],
        "axes": {"python": [release["python"]]},
        "cases": [{"id": "c", "steps": 30, **case}],
        **{key: value for key, value in release.items() if key not in (*CASE, *OWN)},
    }
    path = folder / "adapters.toml"
    (folder / "modules").symlink_to(HERE.parents[1] / "matrices" / "modules")
    path.write_text("".join(f"{key} = {toml(value)}\n" for key, value in table.items()), encoding="utf-8")
    (found,) = open_matrix.load(str(path), print).cells
    return found


def toml(value: Any) -> str:
    """Return a value in TOML."""
    match value:
        case dict():
            return "{" + ", ".join(f"{json.dumps(key)} = {toml(one)}" for key, one in value.items()) + "}"
        case list():
            return f"[{', '.join(map(toml, value))}]"
        case _:
            return json.dumps(value)


@pytest.mark.parametrize("release", RELEASES, ids=name)
def test_a_release_is_driven_as_a_user_drives_it(
    release: dict[str, Any], runner: ControlledRunner, tmp_path: Path
) -> None:
    """Every check passes with known findings only, and each value equals that of a loop by hand."""
    asked = cell(release, tmp_path)
    record = runner.measure(asked)
    ended = outcomes_of(record)
    assert {check: how for check, how in ended.items() if check not in MISLEADING} == {
        check: expected_outcome(check, release) for check in asked.cases[0].checks if check not in MISLEADING
    }
    assert {how for check, (how, _) in ended.items() if check in MISLEADING} <= {"passed", "skipped"}
    assert surprising(record, release) == []
    told = results_both_ways(runner, asked, release)
    assert unknown([words_of(*one) for one in told["complaints"]], release) == []
    assert len(told["adapter"]) > 1
    assert told["adapter"] == told["by_hand"]
    assert described(told["adapter"][0][0]) == release.get("observation", described(told["by_hand"][0][0]))


def expected_outcome(check: str, release: dict[str, Any]) -> tuple[str, str | None]:
    """Return the expected outcome of a check."""
    return ("skipped" if check in release.get("skipped", ()) else "passed"), None


def outcomes_of(record: CellRecord) -> dict[str, tuple[str, str | None]]:
    """Return the outcome of each check, with its decisive line if it went wrong."""
    steps = [step for step in (record.resolve, record.install) if step and step.outcome is not Outcome.PASSED]
    if steps and steps[0].outcome is Outcome.UNAVAILABLE and "build of torch" in (steps[0].decisive or ""):
        pytest.skip("unavailable: torch")
    assert not steps, steps[0].decisive
    assert not record.unavailable, record.unavailable
    checks = [check for case in record.cases for phase in case.phases for check in phase.checks]
    fine = {Outcome.PASSED, Outcome.SKIPPED}
    return {one.check: (one.outcome.value, None if one.outcome in fine else one.decisive) for one in checks}


def surprising(record: CellRecord, release: dict[str, Any]) -> list[str]:
    """Return the warnings that the data file does not list."""
    found = [finding for case in record.cases for phase in case.phases for finding in phase.findings]
    return unknown([f"{one.check}: {one.text}" for one in found if one.level is Level.WARNING], release)


def unknown(texts: list[str], release: dict[str, Any]) -> list[str]:
    """Return the texts that match no pattern of the data file."""
    return [text for text in texts if not any(re.search(one, text) for one in release.get("findings", ()))]


def words_of(code: str, data: dict[str, Any]) -> str:
    """Return an observation of an adapter in words."""
    named = {name: value for name, value in data.items() if name not in {"got", "promised", "at", "level"}}
    plain = {"code": code, "got": data.get("got"), "promised": data.get("promised"), "data": named}
    return words.in_words(plain) or code


def results_both_ways(runner: ControlledRunner, asked: Cell, release: dict[str, Any]) -> dict[str, Any]:
    """Return the results of the adapter and of a loop by hand, both run inside the cell."""
    installing = replace(runner.runner, settings=Settings(until=Phase.INSTALL))
    ready = installing.prepare(replace(asked, cases=()))
    assert ready.site
    inside = CellUnderTest(
        id=asked.id, axes={}, version="", installed=ready.record.installed or {}, expect=None, site=ready.site
    )
    question = {
        "incell": str(launch.INCELL),
        "case": msgspec.to_builtins(asked.cases[0]),
        "by_hand": DATA["by_hand"][release["by_hand"]],
        "seed": SEED,
        "steps": STEPS,
    }
    source = (HERE / "witness.py").read_text(encoding="utf-8")
    ran = inside.run(f"import json\nASKED = json.loads({json.dumps(question)!r})\n{source}", timeout=300)
    line = next(line for line in ran.output.splitlines() if line.startswith("WITNESS "))
    return dict(json.loads(line.removeprefix("WITNESS ")))


def described(observation: Any) -> str:
    """Return shape and dtype, of each part for a dict."""
    if isinstance(observation, dict):
        return ", ".join(f"{key}: {described(part)}" for key, part in observation.items())
    return str(observation[0])
