"""Derive the causes of a failure, the most likely first: each rule reads the lines that say why something failed."""

from __future__ import annotations

import re
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Tuple

from ..explain.api_history import PYTHON, Load
from ..explain.failure_text import QUOTED, Failure
from ..explain.version_hints import Hints
from ..failures.matching import Diagnosis, Signature
from . import (
    api_causes,
    build_causes,
    call_causes,
    environment_ids,
    gpu_causes,
    graphics_causes,
    installer_conflicts,
    missing_files,
    missing_releases,
    native_causes,
    python_causes,
    saved_objects,
)
from .scene import Cause, Causes, Scene

Rule = Callable[[str, Scene], Causes]

RULES: Sequence[Tuple[Rule, bool]] = (
    (installer_conflicts.causes, False),
    (missing_releases.causes, False),
    (environment_ids.released, False),
    (graphics_causes.of_mesa, False),
    (native_causes.random_numbers, False),
    (missing_files.of_mujoco, True),
    (saved_objects.causes, True),
    (python_causes.causes, True),
    (build_causes.causes, True),
    (installer_conflicts.refusals, True),
    (environment_ids.causes, True),
    (native_causes.causes, True),
    (graphics_causes.causes, True),
    (gpu_causes.causes, True),
    (missing_files.causes, True),
    (api_causes.removed, True),
    (api_causes.entry_points, True),
    (api_causes.of_tensorflow, True),
    (api_causes.wrapped, False),
    (api_causes.causes, False),
    (api_causes.misplaced, False),
    (missing_files.shadowed, True),
    (api_causes.absent, True),
    (call_causes.causes, False),
)
"""The rules, what is specific first, and whether a rule is broad: then whatever is documented of the line goes before.

The first rule that knows a line answers for it.
"""

MISSING = "No module named "
"""An exception that says all: no other line of the text is why a module is missing."""

MOST = 2
"""Causes of one line."""


def derive(
    failure: Failure, hints: Hints, installed: Optional[Mapping[str, str]], python: Optional[str], load: Load
) -> List[Diagnosis]:
    """Return the causes of the lines that say why something failed, each subject once."""
    versions = dict(hints.packages)
    versions.update(installed or {})
    if python or hints.python:
        versions[PYTHON] = str(python or hints.python)
    scene = Scene(failure, versions, installed, python or hints.python, load)
    causes: Dict[str, Diagnosis] = {}
    for line in _lines(failure):
        for cause, broad in _of_line(line, scene):
            causes.setdefault(cause.subject, _diagnosis(line, cause, broad=broad))
    return list(causes.values())


def _of_line(line: str, scene: Scene) -> List[Tuple[Cause, bool]]:
    for rule, broad in RULES:
        causes = [(cause, broad) for cause in rule(line, scene)]
        if causes:
            return causes[:MOST]
    return []


def _lines(failure: Failure) -> List[str]:
    """Return the lines that say why; of a short text the others, too."""
    lines = failure.text.splitlines()
    if failure.raised and MISSING in (failure.decisive or ""):
        return list(failure.lines[:1])
    short = [line for line in lines if line.strip()] if len(lines) <= QUOTED else []
    return list(dict.fromkeys([*failure.lines, *(short if not failure.raised else ())]))


def _diagnosis(line: str, cause: Cause, *, broad: bool) -> Diagnosis:
    name = "derived:{}".format(cause.subject)
    asker = {"asker": cause.asker} if cause.asker else {}
    signature = Signature(
        plain={"id": name, "cause": cause.text, "remedy": cause.remedy, "derived": True, **asker},
        id=name,
        phases=(),
        pattern=re.escape(line),
        signal=None,
        packages=(),
        python=None,
        masks=False,
        generic=broad,
        silent=False,
    )
    return Diagnosis(signature=signature, phase=None, seen=line, is_reason=True)
