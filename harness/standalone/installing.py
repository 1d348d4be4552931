"""Name the commands that install packages into an environment: by pip, uv or conda, whichever serves it."""

from __future__ import annotations

import os
import shlex
import shutil
from typing import Container, Mapping, NamedTuple, Optional, Sequence, Tuple


class Installer(NamedTuple):
    """Commands of one environment: `prepare` is typed first, `install` and `uninstall` take packages after them.

    `conda` is whether conda made the environment.
    """

    install: str
    uninstall: str
    prepare: Tuple[str, ...] = ()
    conda: bool = False

    def installing(self, requirements: Sequence[str]) -> Tuple[str, ...]:
        """Return the lines to type that install these requirements."""
        return (*self.prepare, " ".join([self.install, *map(shlex.quote, requirements)]))

    def uninstalling(self, packages: Sequence[str]) -> Tuple[str, ...]:
        """Return the lines to type that remove these packages."""
        return (*self.prepare, " ".join([self.uninstall, *map(shlex.quote, packages)]))


PIP = Installer("python -m pip install", "python -m pip uninstall")
"""The commands for an environment that is not known."""


def installer(
    python: Optional[str], installed: Optional[Container[str]] = None, variables: Mapping[str, str] = os.environ
) -> Installer:
    """Return the commands for the environment of an interpreter, which holds the packages `installed`.

    An environment without pip, such as one that uv made, is served by uv where that is on PATH, else it is given pip
    first: by conda where conda made it, by ensurepip elsewhere. Where `installed` is not known, pip is assumed.
    """
    if python is None:
        return PIP
    quoted = shlex.quote(python)
    prefix = os.path.dirname(os.path.dirname(python))
    conda = os.path.isdir(os.path.join(prefix, "conda-meta"))
    by_pip = Installer("{} -m pip install".format(quoted), "{} -m pip uninstall".format(quoted), conda=conda)
    if installed is None or "pip" in installed:
        return by_pip
    if shutil.which("uv", path=variables.get("PATH", os.defpath)):
        place = "--python {}".format(quoted)
        return Installer("uv pip install {}".format(place), "uv pip uninstall {}".format(place))
    if conda:
        return by_pip._replace(prepare=("conda install --prefix {} pip".format(shlex.quote(prefix)),))
    return by_pip._replace(prepare=("{} -m ensurepip".format(quoted),))
