"""Measure throw-away copies of an environment, with other versions of some packages."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence

from harness.machine import interpreters
from harness.machine.store import Store
from harness.matrix import plan
from harness.model import Cell, Verdict
from harness.model.errors import CouldNotTell
from harness.rootcause.bench import Bench, Trial
from harness.running.open_matrix import REUSED_FOR_HOURS
from harness.standalone.keys import SIMULATORS, weight
from harness.standalone.versions import is_version

PASSED = ("MUJOCO_GL", "PYOPENGL_PLATFORM")
"""The caller's variables that a copy has, too."""

NOT_COPIED = frozenset({"pip", "setuptools", "wheel"})


def find_python(verb: str, python: str) -> str:
    """Return the interpreter that copies are made of. Raises CouldNotTell."""
    interpreter = interpreters.find(python)
    if interpreter is None:
        message = f"{verb}: no environment can be made with {python}; a Python from 3.7 on is needed"
        raise CouldNotTell(message)
    return interpreter.path


def public_versions(installed: Mapping[str, str]) -> dict[str, str]:
    """Return the versions of packages without their local parts.

    A part such as `+cpu` names an index and not a release; a pin with it finds nothing on another index.
    """
    return {name: version.partition("+")[0] for name, version in installed.items() if is_version(version)}


def instant(opened: Store) -> str:
    """Return the instant at which copies are resolved, the same for all of a few hours."""
    return opened.instant(plan.TRY_MATRIX, hours=REUSED_FOR_HOURS)


class EnvironmentCopies:
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
