"""Derive the causes of a failure, the most likely first: each rule reads the lines that say why something failed."""

from __future__ import annotations

import re
from typing import Callable, Dict, List, Mapping, Optional, Sequence

from ..explain.api_history import Load
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
    installer_refusals,
    missing_files,
    missing_releases,
    mujoco_binaries,
    native_causes,
    saved_objects,
)
from .scene import Cause, Causes, Scene

RULES: Sequence[Callable[[str, Scene], Causes]] = (
    mujoco_binaries.causes,
    saved_objects.causes,
    installer_conflicts.causes,
    missing_releases.causes,
    build_causes.causes,
    installer_refusals.causes,
    environment_ids.causes,
    graphics_causes.causes,
    gpu_causes.causes,
    native_causes.causes,
    missing_files.causes,
    api_causes.causes,
    call_causes.causes,
)
"""What is specific goes first: of several causes of one line the first counts."""

MOST = 2
"""Causes of one line."""


def derive(
    failure: Failure, hints: Hints, installed: Optional[Mapping[str, str]], python: Optional[str], load: Load
) -> List[Diagnosis]:
    """Return the causes of the lines that say why something failed, each subject once."""
    versions = dict(hints.packages)
    versions.update(installed or {})
    scene = Scene(failure, versions, installed, python or hints.python, load)
    causes: Dict[str, Diagnosis] = {}
    for line in _lines(failure):
        for cause in _of_line(line, scene):
            causes.setdefault(cause.subject, _diagnosis(line, cause))
    return list(causes.values())


def _of_line(line: str, scene: Scene) -> List[Cause]:
    found: List[Cause] = []
    for rule in RULES:
        found += rule(line, scene)
        if found:
            return found[:MOST]
    return found


def _lines(failure: Failure) -> List[str]:
    """Return the lines that say why; of a short text the others, too."""
    lines = failure.text.splitlines()
    short = [line for line in lines if line.strip()] if len(lines) <= QUOTED else []
    return list(dict.fromkeys([*failure.lines, *(short if not failure.raised else ())]))


def _diagnosis(line: str, cause: Cause) -> Diagnosis:
    name = "derived:{}".format(cause.subject)
    signature = Signature(
        plain={"id": name, "cause": cause.text, "remedy": cause.remedy, "derived": True},
        id=name,
        phases=(),
        pattern=re.escape(line),
        signal=None,
        packages=(),
        python=None,
        masks=False,
        generic=False,
        silent=False,
    )
    return Diagnosis(signature=signature, phase=None, seen=line, is_reason=True)
