"""Read the files of `-r FILE`, in each of the supported formats.

The format follows from the file's name, of another TOML file from its content. `-r pyproject.toml --extra mujoco
--group dev` takes extras and dependency groups.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from packaging.utils import canonicalize_name

from harness.machine.files import given_files
from harness.model import replace, schema
from harness.model.errors import BadInput
from harness.packages.requirement_files import pip, project, uv_lock
from harness.packages.requirement_files.entry import Include, Inputs, Parsed, Source

FOREIGN = {"setup.py", "setup.cfg", "Pipfile", "Pipfile.lock", "poetry.lock", "conda-lock.yml"}
"""Formats that people have and that are not read."""


def read(paths: Sequence[Path], extras: Sequence[str] = (), groups: Sequence[str] = ()) -> Inputs:
    """Read several files, with the files that they include, and return their contents together.

    Raises BadInput for a file that is missing or wrong (file and line), and for an extra or a group of no file.
    """
    inputs, known_extras, known_groups = Inputs(), set[str](), set[str]()
    for path in paths:
        parsed = _parse(path, extras, groups)
        known_extras |= set(parsed.extras)
        known_groups |= set(parsed.groups)
        inputs += parsed.inputs + _included(parsed.includes, path, seen={path.resolve()})
    _check("extra", extras, known_extras)
    _check("group", groups, known_groups)
    return inputs


def _parse(path: Path, extras: Sequence[str] = (), groups: Sequence[str] = ()) -> Parsed:
    with schema.readable(str(path)):
        return _parsed(path, _text(path), extras, groups)


def _parsed(path: Path, text: str, extras: Sequence[str], groups: Sequence[str]) -> Parsed:
    source = Source(name=str(path), folder=path.absolute().parent, variables=os.environ)
    if path.name == "uv.lock":
        return uv_lock.uv_lock(text, source)
    if path.suffix == ".toml":
        is_lock = re.fullmatch(r"pylock(\.[^.]+)?\.toml", path.name) or (
            path.name != "pyproject.toml" and re.search(r"(?m)^lock-version", text)
        )
        if is_lock:
            from harness.packages.requirement_files import pylock  # noqa: PLC0415 - start-up

            return pylock.pylock(text, source, extras, groups)
        return project.pyproject(text, source, extras, groups)
    if path.suffix in {".yml", ".yaml"}:
        from harness.packages.requirement_files import conda  # noqa: PLC0415  (the YAML library is for this format alone)

        return conda.environment_yml(text, source)
    return pip.requirements_txt(text, source)


def _text(path: Path) -> str:
    if path.name in FOREIGN:
        message = (
            f"{path}: unknown format; give requirements.txt, pyproject.toml, uv.lock, pylock.toml or environment.yml"
        )
        raise BadInput(message)
    return given_files.read_text(path)


def _included(includes: Iterable[Include], path: Path, seen: set[Path]) -> Inputs:
    """Read the files that a file names with -r and -c, each once; requirements of a -c file become constraints."""
    inputs = Inputs()
    for include in includes:
        if "://" in include.path:
            inputs += Inputs(not_modelled=(f"{include.where}: {include.path}: a file on the network is not supported",))
            continue
        target = path.parent / include.path
        if not os.path.isfile(target):  # noqa: PTH113 - a name may be too long for `Path.is_file`
            message = f"{include.where}: there is no file {target}"
            raise BadInput(message)
        if target.resolve() not in seen:
            seen.add(target.resolve())
            parsed = _parse(target)
            inner = parsed.inputs + _included(parsed.includes, target, seen)
            if include.constraint:
                inner = replace(inner, requirements=(), constraints=inner.requirements + inner.constraints)
            inputs += inner
    return inputs


def _check(kind: str, names: Iterable[str], choices: set[str]) -> None:
    for name in names:
        if canonicalize_name(name) not in {canonicalize_name(one) for one in choices}:
            message = f"--{kind} {name}: no file that was given has this {kind}{schema.suggestion(name, choices)}"
            raise BadInput(message)
