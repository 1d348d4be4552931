"""Refuse names that a project or a command line can only have by mistake: releases, packages, environments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path

from harness.machine.files import given_files
from harness.model.errors import BadInput
from harness.model.measured import Measured
from harness.reports.projects.measured_sets import bare
from harness.reports.projects.project import Declared, Project
from harness.standalone.explain.api_history import load_shipped
from harness.standalone.keys import SIMULATORS
from harness.standalone.versions import is_version, version

LIKENESS = 0.8
"""The least likeness of two names for one to be taken for a misspelling of the other."""


def refuse_unknown(project: Project, paths: Sequence[Path], say: Callable[[str], None]) -> None:
    """Refuse pinned releases that do not exist, and names that look like a simulator's and that no index has.

    The index is asked about such a name alone. Raises BadInput with file and line.
    """
    own = [declared for declared in project.packages.values() if declared.by is None]
    for declared in own:
        near = _missing_release(declared)
        if near:
            where = _where(declared, paths)
            message = f"{where}{declared.name} {declared.pinned}: no such release; near it are {' and '.join(near)}"
            raise BadInput(message)
    names = [declared.name for declared in own]
    alike = {
        name
        for simulator in SIMULATORS
        for name in get_close_matches(simulator, names, n=len(names) or 1, cutoff=LIKENESS)
    }
    for declared in own:
        if declared.name in alike - SIMULATORS and load_shipped(declared.name) is None:
            from harness.reports.answers import misspelt  # noqa: PLC0415 - start-up

            try:
                misspelt.check([declared.name], say)
            except BadInput as error:
                message = f"{_where(declared, paths)}{error}"
                raise BadInput(message) from None


def _missing_release(declared: Declared) -> list[str]:
    """Return the releases around a pinned one that does not exist; one newer than all that are known may exist."""
    history = load_shipped(declared.name)
    if history is None or declared.pinned is None or not is_version(declared.pinned):
        return []
    wanted = version(declared.pinned)
    releases = sorted((version(release), release) for release in history.versions if is_version(release))
    if any(release == wanted for release, _ in releases) or not releases or wanted > releases[-1][0]:
        return []
    below = [text for release, text in releases if release < wanted][-1:]
    above = [text for release, text in releases if release > wanted][:1]
    return [*below, *above]


def _where(declared: Declared, paths: Iterable[Path]) -> str:
    """Return the file and the line that name a package, as the beginning of a message."""
    for path in paths:
        for number, line in enumerate(given_files.read_text(path).splitlines(), 1):
            if declared.name in line.lower().replace("_", "-") and (declared.pinned or "") in line:
                return f"{path}:{number}: "
    return ""


def refuse_environment(env: str | None, measured: Measured) -> None:
    """Refuse the id of an environment that was never measured and looks like one that was. Raises BadInput."""
    if env is None:
        return
    measured_names = {bare(case.env, case.api) for cell in measured.cells for case in cell.cases if case.env}
    name = env.rpartition(":")[2]
    near = get_close_matches(name, sorted(measured_names), n=3, cutoff=LIKENESS)
    if name not in {each.rpartition(":")[2] for each in measured_names} and near:
        message = f"--env {env}: no environment of this id was measured; did you mean {' or '.join(near)}?"
        raise BadInput(message)
