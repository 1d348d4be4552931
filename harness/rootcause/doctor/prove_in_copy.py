"""Try version changes in a throw-away copy of an environment (`doctor --prove`)."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec

from harness.machine import interpreters, store
from harness.matrix import plan
from harness.model import Cell, Verdict
from harness.model.errors import CouldNotTell
from harness.model.report_types import UNTOLD, word
from harness.reports import publishing
from harness.reports.text import progress
from harness.rootcause.bench import Bench, Trial
from harness.running.open_matrix import REUSED_FOR_HOURS
from harness.running.scheduler import Settings
from harness.standalone.keys import SIMULATORS, weight
from harness.standalone.versions import is_version


class Copied(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one throw-away copy."""

    requirements: tuple[str, ...]
    verdict: str
    phases: dict[str, str]
    decisive: str | None


class Proof(msgspec.Struct, frozen=True, kw_only=True):
    """The result of trying the changes. `before` is the copy without them, `after` with them; None if it was not made.

    `left_out` are packages that could not be copied in their version. `text` is the result as a sentence.
    """

    proven: bool
    text: str
    before: Copied | None = None
    after: Copied | None = None
    left_out: tuple[str, ...] = ()


def proof(document: Mapping[str, Any], *, env: str | None, offline: bool) -> Proof:
    """Try the changes that lead to the nearest known-good combination. Raises CouldNotTell."""
    near = document["nearest"]
    if near is None or not near["changes"]:
        text = "nothing is to be proven: " + ("no change is known" if near is None else "no version has to change")
        return Proof(proven=False, text=text)
    environment = document["environment"]
    changed = {one["name"]: one["then"] for one in near["changes"]}
    python = _python(environment)
    opened = store.open_store()
    as_of = opened.instant(plan.TRY_MATRIX, hours=REUSED_FOR_HOURS)
    # A local part such as `+cpu` names an index and not a release; a pin with it finds nothing on another index.
    installed = {
        name: version.partition("+")[0] for name, version in environment["packages"].items() if is_version(version)
    }
    with (
        progress.Progress(2, 1, publishing.headline) as board,
        Bench(opened, Settings(offline=offline), board) as bench,
    ):
        copies = _Copies(bench=bench, python=python, env=env, as_of=as_of)
        # The copy with the changes comes first: if it tells nothing, the other one need not be made.
        after, left_out = copies.measure({**installed, **changed}, changed)
        if after.assessed.verdict in UNTOLD:
            message = f"doctor --prove: it cannot be told here: {after.assessed.decisive}"
            raise CouldNotTell(message)
        before, _ = copies.measure(installed, {})
    return _proof(before, after, left_out)


def _python(environment: Mapping[str, Any]) -> str:
    interpreter = interpreters.find(environment["executable"] or environment["python"])
    if interpreter is None:
        message = (
            f"doctor --prove: no environment can be made with {environment['python']}; a Python from 3.7 on is needed"
        )
        raise CouldNotTell(message)
    return interpreter.path


class _Copies:
    """Throw-away copies, made of one Python."""

    def __init__(self, *, bench: Bench, python: str, env: str | None, as_of: str) -> None:
        self.bench, self.python, self.env, self.as_of = bench, python, env, as_of

    def measure(self, versions: Mapping[str, str], changed: Iterable[str]) -> tuple[Trial, tuple[str, ...]]:
        """Measure a copy with these versions, or, if they do not resolve together, only with those that matter.

        Return the trial, and the packages left to the resolver.
        """
        pins = {name: f"{name}=={version}" for name, version in versions.items() if name not in NOT_COPIED}
        requirements = [pins[name] for name in pins if name in SIMULATORS or name in changed or weight(name)]
        trial = self.bench.measure(self._cell(requirements, list(pins.values())), keep=True)
        if trial.assessed.verdict is not Verdict.UNRESOLVABLE:
            return trial, ()
        essentials = {name for name in pins if name in SIMULATORS or name in changed}
        again = self.bench.measure(self._cell([pins[name] for name in pins if name in essentials], []), keep=True)
        return again, tuple(sorted(set(pins) - essentials))

    def _cell(self, requirements: Sequence[str], constraints: Sequence[str]) -> Cell:
        version = interpreters.find(self.python)
        request = plan.TrialOptions(
            requirements=tuple(requirements),
            constraints=tuple(constraints),
            python=version.version if version else "host",
            envs=(self.env,) if self.env else (),
            environment={name: os.environ[name] for name in PASSED if os.environ.get(name)},
            instant=self.as_of,
            interpreter=self.python,
        )
        return plan.single(request).cells[0]


PASSED = ("MUJOCO_GL", "PYOPENGL_PLATFORM")
"""The caller's variables that a copy has, too."""

NOT_COPIED = frozenset({"pip", "setuptools", "wheel"})


def _proof(before: Trial, after: Trial, left_out: tuple[str, ...]) -> Proof:
    works = after.works and not before.works
    sentence = f"without the changes a copy {_describe_trial(before)}; with them it {_describe_trial(after)}"
    if after.works and before.works:
        sentence = "a copy works with the changes, and without them, too: what was tried shows no fault of the versions"
    beside = f" ({len(left_out)} other packages were left to the resolver)" if left_out else ""
    return Proof(
        proven=works,
        text=("proven: " if works else "not proven: ") + sentence + beside,
        before=_copied(before),
        after=_copied(after),
        left_out=left_out,
    )


def _describe_trial(trial: Trial) -> str:
    if trial.works:
        passed = [phase for phase, how in trial.assessed.phases.items() if how == "passed"]
        return f"works ({', '.join(passed)})"
    return f"does not: {word(trial.assessed.verdict)} in {trial.assessed.phase}: {trial.assessed.decisive}"


def _copied(trial: Trial) -> Copied:
    return Copied(
        requirements=trial.cell.question.requirements,
        verdict=str(trial.assessed.verdict),
        phases={str(phase): str(how) for phase, how in trial.assessed.phases.items()},
        decisive=trial.assessed.decisive,
    )


def lines(result: Proof) -> Iterable[str]:
    """Yield the proof as lines for a terminal."""
    yield result.text
    for name, copy in (("without", result.before), ("with", result.after)):
        if copy:
            yield f"  {name}: {', '.join(copy.requirements)}"
