"""Choose the environment to inspect: the one named, else the active one, else ./.venv, else `python` on PATH."""

from __future__ import annotations

import os
import shutil
import sys
from typing import Iterator, List, Mapping, NamedTuple, Optional, Tuple

NAMES = (("bin", "python"), ("bin", "python3"), ("python",))
HOW = "name an interpreter or the folder of an environment with --python PATH"


class NoEnvironment(ValueError):
    """Raised when no Python lies in the expected place; the message says where, and what to do."""


class Choice(NamedTuple):
    """The interpreter of an environment, the reason for choosing it, and remarks on the choice."""

    python: str
    why: str
    remarks: List[str]


def choose_environment(
    option: Optional[str], variables: Mapping[str, str], folder: str, running: Optional[str] = None
) -> Choice:
    """Return the environment that is meant: the one named, that of the Python `running` us, the active one, ./.venv.

    Raises NoEnvironment.
    """
    if option is not None:
        return Choice(_resolve_option(option, variables, folder), "named by --python", [])
    if running is not None:
        return Choice(running, "it runs this file", [])
    remarks: List[str] = []
    for text, place in _places(variables, folder):
        python = _find_interpreter(place)
        if python is None:
            remarks.append("{} is passed over: no Python lies in {}".format(text, place))
            continue
        return Choice(python, "named by " + text, [*remarks, *_note_other_python(python, variables)])
    for name in ("python", "python3"):
        executable = shutil.which(name, path=variables.get("PATH", os.defpath))
        if executable:
            return Choice(executable, "`{}` on PATH; no environment is active".format(name), remarks)
    message = "there is no Python here: no environment is active, there is no ./.venv, and PATH has no Python; " + HOW
    raise NoEnvironment(message)


def find_own_python() -> Optional[str]:
    """Return the Python that runs us where it belongs to a virtual or conda environment, else None."""
    virtual = sys.prefix != sys.base_prefix or os.path.isdir(os.path.join(sys.prefix, "conda-meta"))
    return sys.executable or None if virtual else None


def _places(variables: Mapping[str, str], folder: str) -> Iterator[Tuple[str, str]]:
    for name in ("VIRTUAL_ENV", "CONDA_PREFIX"):
        if variables.get(name):
            yield "$" + name, os.path.join(folder, variables[name])
    if os.path.isdir(os.path.join(folder, ".venv")):
        yield "./.venv", os.path.join(folder, ".venv")


def _find_interpreter(place: str) -> Optional[str]:
    """Return the interpreter in an environment's folder; None if there is none."""
    paths = (os.path.join(place, *parts) for parts in NAMES)
    return next((path for path in paths if os.path.isfile(path) and os.access(path, os.X_OK)), None)


def _resolve_option(text: str, variables: Mapping[str, str], folder: str) -> str:
    path = os.path.join(folder, os.path.expanduser(text))
    if os.path.isdir(path):
        interpreter = _find_interpreter(path)
        if interpreter:
            return interpreter
        dangling = next((one for one in (os.path.join(path, *parts) for parts in NAMES) if os.path.islink(one)), None)
        if dangling:
            gone = os.path.realpath(dangling)
            message = "--python {}: its Python was {}, which is gone; create the environment again".format(text, gone)
            raise NoEnvironment(message)
        message = "--python {}: that folder holds no Python; {}".format(text, HOW)
        raise NoEnvironment(message)
    if os.path.isfile(path):
        if os.access(path, os.X_OK):
            return path
        message = "--python {}: this file cannot be run; {}".format(text, HOW)
        raise NoEnvironment(message)
    names = [] if os.sep in text else [text, "python" + text]
    interpreter = next(filter(None, (shutil.which(one, path=variables.get("PATH", os.defpath)) for one in names)), None)
    if interpreter is None:
        message = "--python {}: there is no such file or folder; {}".format(text, HOW)
        raise NoEnvironment(message)
    return interpreter


def _note_other_python(python: str, variables: Mapping[str, str]) -> List[str]:
    """Return a remark if `python` on PATH is not the one of this environment, else an empty list."""
    executable = shutil.which("python", path=variables.get("PATH", os.defpath))
    # Folders are compared, as the interpreters of all environments of one base link to the same file.
    if executable is None or os.path.realpath(os.path.dirname(executable)) == os.path.realpath(os.path.dirname(python)):
        return []
    return ["`python` starts another one here: {}".format(executable)]
