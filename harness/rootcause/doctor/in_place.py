"""Inspect an installation from the host: start its Python, and make and step an environment in it as it is."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from harness.judging.failure_texts import KILLED, extract_texts
from harness.machine import process, this_machine
from harness.machine.files.scratch_folders import scratch_folder
from harness.machine.store import Store
from harness.matrix import plan
from harness.model import FAILING, Case, CaseRecord, Outcome, Phase, PhaseRecord
from harness.probes import launch
from harness.probes.evidence import REPLY, Host
from harness.probes.measure import Laboratory
from harness.probes.vault import Vault
from harness.rootcause.doctor import doctor_rendering
from harness.rootcause.doctor.doctor_rendering import RenderingReport
from harness.running import case_run
from harness.running.signatures.shipped_signatures import texts
from harness.standalone import adapters
from harness.standalone.doctor.differences import versions
from harness.standalone.doctor.environment_choice import Choice
from harness.standalone.doctor.package_findings import NOTE, WARNING, Finding
from harness.standalone.failures.matching import Evidence
from harness.standalone.keys import SIMULATORS
from harness.standalone.running import ProcessResult

MEMORY_MB = 64_000
OUTPUT_KB = 1024
LOOKED_AT = {"gymnasium": "gymnasium", "mujoco": "MuJoCo", "robosuite": "robosuite", "dm-control": "dm_control"}
"""Installed packages, and how the libraries are called that are held against this machine's devices."""


def run(argv: Sequence[str], variables: Mapping[str, str], folder: str, seconds: float) -> ProcessResult:
    """Run a command with these variables in a folder, under the supervisor. `seconds` is its time limit."""
    with scratch_folder() as scratch:
        log = scratch / "log"
        done = process.run(
            process.Command(
                argv=tuple(argv),
                cwd=Path(folder),
                env=variables,
                limits=process.Limits(seconds=seconds, memory_mb=MEMORY_MB, output_kb=OUTPUT_KB),
                log=log,
                profile=process.Profile.HOST,
            )
        )
        output = log.read_text(encoding="utf-8", errors="replace") if log.is_file() else ""
    name = signal.Signals(done.signal).name if done.signal else None
    trouble = "" if done.killed is None else f"\n{done.killed}"
    return ProcessResult(done.exit_code, name, done.timed_out, output + trouble)


class Tried(msgspec.Struct, frozen=True, kw_only=True):
    """The result of making and stepping an environment in place, by phase. `said` is the result as a sentence."""

    env: str
    api: str
    phases: dict[str, str]
    decisive: str | None
    said: str


@dataclass(kw_only=True, slots=True)
class HostInspection:
    """The inspections that only the host can do. `tried` and `drawn` are set once `inspect` was called."""

    env: str | None
    rendering: bool
    api: str | None = None
    tried: Tried | None = None
    drawn: RenderingReport | None = None
    seen: list[Evidence] = field(default_factory=list)

    def inspect(self, choice: Choice, facts: Mapping[str, Any]) -> tuple[list[Finding], list[Evidence]]:
        """Return findings, and evidence to match against known failures."""
        findings: list[Finding] = []
        if self.rendering:
            self.drawn = doctor_rendering.here()
            findings += _rendering(self.drawn, versions(facts))
        if self.env is not None:
            findings += self._stepped(self.env, facts)
        return findings, self.seen

    def _stepped(self, env: str, facts: Mapping[str, Any]) -> list[Finding]:
        try:
            case = _case(env, self.api, versions(facts))
        except _Unmade as error:
            return [Finding("env.import", WARNING, f"{env} cannot be made: {error}")]
        with scratch_folder() as scratch:
            store = Store(scratch)
            until = Phase.RENDER if self.rendering else Phase.SINGLE
            record = case_run.run_case(_context(store, facts, scratch, until), case)
            self.tried = _tried(env, case, record, versions(facts))
            failed = [phase for phase in record.phases if phase.outcome in FAILING]
            self.seen += [_seen(phase, store) for phase in failed]
        where = next((one.phase for one in record.phases if one.outcome not in PASSING), None)
        return [Finding(f"env.{where}", WARNING, self.tried.said)] if where else []


def _rendering(looked: RenderingReport, installed: Mapping[str, str]) -> list[Finding]:
    """Return the rendering findings. One that names none of the installed libraries becomes a note."""
    names = [name for package, name in LOOKED_AT.items() if package in installed]
    return [
        Finding(one.check, NOTE if names and not any(name in one.text for name in names) else str(one.level), one.text)
        for one in looked.findings
    ]


# --- an environment in place -----------------------------------------------------------------------------------


class _Unmade(Exception):
    """The error for an environment of which no case can be made; the text says why."""


def _case(env: str, api: str | None, installed: Mapping[str, str]) -> Case:
    """Return the case that tries an environment with what is installed, gymnasium before gym. Raises _Unmade."""
    pins = tuple(f"{name}=={version}" for name, version in installed.items() if name in SIMULATORS)
    if not pins:
        message = "nothing that is installed has environments that are known here"
        raise _Unmade(message)
    # `plan.named_api` takes the first requirement that is an API, so gym must not stand before gymnasium.
    pins = tuple(sorted(pins, key=lambda pin: pin.startswith("gym==")))
    brought = next((name for name in ("gymnasium", "gym") if name in installed), None)
    (case,) = plan.cases_for(plan.TrialOptions(requirements=pins, python="host", envs=(env,), api=api, brought=brought))
    package = adapters.package(case.api)
    if package not in installed and case.api in {"gym", "gymnasium"}:
        message = f"{package} is not installed"
        raise _Unmade(message)
    return case


def _context(store: Store, facts: Mapping[str, Any], scratch: Path, until: Phase) -> case_run.Context:
    python = facts["python"]
    prefix = Path(python["prefix"])
    executable = Path(python["executable"])
    # `launch` needs the path of the interpreter relative to the folder of its environment.
    if not executable.is_relative_to(prefix):
        executable = prefix / "bin" / executable.name
    # Byte code goes to the scratch folder, because `doctor` changes no file of the user's environment.
    site = launch.Site(
        folder=prefix, python=executable, pycache=scratch / "pycache", variables=dict(os.environ), files={}
    )
    return case_run.Context(
        laboratory=Laboratory(
            vault=Vault(store.folder),
            site=lambda: site,
            host=Host(python=python["version"], undrawable=this_machine.explain_undrawable(os.environ)),
            places={},
        ),
        # The key does not cover the packages: nothing is reused, as the store is a scratch folder and `fresh` is set.
        identity=("doctor", str(prefix)),
        until=until,
        fresh=True,
    )


def _tried(env: str, case: Case, record: CaseRecord, installed: Mapping[str, str]) -> Tried:
    phases = {str(one.phase): str(one.outcome) for one in record.phases if one.outcome in REPORTED_OUTCOMES}
    failed = next((one for one in record.phases if one.outcome not in PASSING), None)
    package = adapters.package(case.api)
    name = f"{env} of {package} {installed[package]}" if package in installed else env
    others = [api for api in ("gymnasium", "gym") if api in installed and case.api in {"gymnasium", "gym"} - {api}]
    other = f"; --api {others[0]} tries that of {others[0]} {installed[others[0]]}" if others else ""
    if failed is None:
        sentence = f"{name} was made and stepped in this environment ({', '.join(phases)} passed){other}"
    else:
        sentence = (
            f"{name}: {failed.phase} {failed.outcome}: {failed.decisive or 'no line of the output explains it'}{other}"
        )
    return Tried(env=env, api=case.api, phases=phases, decisive=failed.decisive if failed else None, said=sentence)


REPORTED_OUTCOMES = frozenset(Outcome) - {Outcome.NOT_REACHED, Outcome.SKIPPED}
PASSING = frozenset({Outcome.PASSED, Outcome.SKIPPED, Outcome.NOT_REACHED})


def _seen(phase: PhaseRecord, store: Store) -> Evidence:
    """Return the errors of a failed phase with their tracebacks, to match against known failures."""
    lines = (phase.decisive, *(check.decisive for check in phase.checks))
    evidence_texts = texts(store.folder / phase.evidence) if phase.evidence else {}
    words = extract_texts({name: text for name, text in evidence_texts.items() if name == REPLY}, phase.phase)
    reasons = tuple(dict.fromkeys(filter(None, (*lines, *words))))
    killed = next((signal_match[1] for line in reasons if (signal_match := KILLED.search(line))), None)
    return Evidence(phase=str(phase.phase), reasons=reasons, signal=killed)
