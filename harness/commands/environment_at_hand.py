"""Read the environment that `check` and `upgrade` are about, from its folders: nothing of it is run."""

from __future__ import annotations

import os
from pathlib import Path

from harness.model.errors import BadInput
from harness.reports.projects.project import Declared, Project
from harness.standalone import packages
from harness.standalone.doctor.environment_choice import NoEnvironment, choose_environment
from harness.standalone.versions import is_version, specifiers


def read_environment(python: str | None) -> Project:
    """Return the packages of an environment: the named one, else the active one. Raises BadInput."""
    folder = str(Path.cwd())
    try:
        choice = choose_environment(python, os.environ, folder)
    except NoEnvironment as error:
        raise BadInput(str(error)) from None
    held = packages.of_interpreter(choice.python, os.environ, folder)
    if held is None or not held.version:
        message = f"{choice.python}: its Python version cannot be determined; name another Python with --python"
        raise BadInput(message)
    # A local part such as `+cpu` names an index and not a release.
    versions = {name: text.partition("+")[0] for name, text in held.installed.items() if is_version(text)}
    return Project(
        source=f"{choice.python} (Python {held.version}, {choice.why})",
        packages={
            name: Declared(name=name, versions=specifiers(f"=={text}"), pinned=text) for name, text in versions.items()
        },
        pythons=specifiers(""),
        python=held.version,
        interpreter=choice.python,
        requirements=packages.requirements_of(choice.python, os.environ, folder),
    )
