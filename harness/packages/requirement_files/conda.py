"""Read conda's environment.yml."""

from __future__ import annotations

import re
from collections.abc import Sequence

import yaml
from packaging.specifiers import InvalidSpecifier

from harness.model import replace, requirement_texts
from harness.model.errors import BadInput
from harness.packages.requirement_files.entry import CONDA_PACKAGE, Inputs, Parsed, Source, check_number
from harness.packages.requirement_files.pip import read_lines
from harness.packages.requirement_files.yaml_texts import readable_yaml


def environment_yml(text: str, source: Source) -> Parsed:
    """Read conda's format: its pip part and its Python; every other conda package is not supported."""
    # Nodes instead of plain values: they know their lines, which messages name.
    with readable_yaml(text, source.name):
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    tables = _entries(root)
    dependencies = tables.get("dependencies")
    if not isinstance(dependencies, yaml.SequenceNode):
        message = f"{source.name}: there is no list of dependencies; is it a conda environment file?"
        raise BadInput(message)
    check_number(len(dependencies.value), source)
    inputs, pip = Inputs(), []
    if "variables" in tables:
        line = tables["variables"].start_mark.line + 1
        inputs += Inputs(not_modelled=(f"{source.name}:{line}: variables are not supported; give them with --set",))
    for entry in dependencies.value:
        where = f"{source.name}:{entry.start_mark.line + 1}"
        if isinstance(entry, yaml.MappingNode):
            for items in _entries(entry).values():
                pip += [(item.start_mark.line + 1, _text(item, source)) for item in _items(items, source)]
        else:
            inputs += _conda(_text(entry, source), where)
    parsed = read_lines(pip, source)
    return replace(parsed, inputs=inputs + parsed.inputs)


def _entries(node: yaml.Node | None) -> dict[str, yaml.Node]:
    """Return the entries of a mapping whose keys are scalars; nothing for any other node."""
    pairs = node.value if isinstance(node, yaml.MappingNode) else ()
    return {key.value: value for key, value in pairs if isinstance(key, yaml.ScalarNode)}


def _items(node: yaml.Node, source: Source) -> Sequence[yaml.Node]:
    if not isinstance(node, yaml.SequenceNode):
        message = f"{source.name}:{node.start_mark.line + 1}: expected a list"
        raise BadInput(message)
    return list(node.value)


def _text(node: yaml.Node, source: Source) -> str:
    if not isinstance(node, yaml.ScalarNode):
        message = f"{source.name}:{node.start_mark.line + 1}: expected the name of a package"
        raise BadInput(message)
    return str(node.value)


PYPI = {"pytorch": "torch", "pytorch-cpu": "torch", "pytorch-gpu": "torch", "opencv": "opencv-python"}
"""Names that conda has for releases of an index's package."""


def _as_requirement(name: str, version: str) -> tuple[str, ...]:
    """Return a conda package as a requirement of the same release; nothing where it names none.

    Three numbers name a release, for which conda has builds; fewer of them name all releases that begin so.
    """
    version = re.sub(r"^==(\d+\.\d+\.\d+(?:\.\d+)*)\.\*$", r"==\1", version)
    try:
        return (f"{name}{requirement_texts.specifiers(version)}",) if re.fullmatch(r"[\w.-]*\w", name) else ()
    except InvalidSpecifier:
        return ()


def _conda(spec: str, where: str) -> Inputs:
    match = re.fullmatch(r"(?:[\w./-]+::)?(?P<name>[\w.-]+?)\s*(?P<version>(?:[=<>!~ ].*)?)", spec.strip())
    name = match["name"] if match else spec
    version = match["version"].strip() if match else ""
    if name == "pip" and not version:
        return Inputs()
    fuzzy = re.fullmatch(r"(==?)?\s*(\d+(?:\.\d+)*)(\.?\*)?(=[^=]*)?", version)  # =3.10, =3.10.*, 3.10, =3.10.4=h1_0
    if fuzzy:
        version = f"=={fuzzy[2]}" if fuzzy[1] == "==" and not fuzzy[3] else f"=={fuzzy[2]}.*"
    if name != "python":
        releases = _as_requirement(PYPI.get(name, name), version)
        reason = CONDA_PACKAGE if releases else "this way of naming a package of conda is not supported"
        return Inputs(conda=releases, not_modelled=(f"{where}: {spec}: {reason}",))
    try:
        return Inputs(python=str(requirement_texts.specifiers(version)) or None)
    except InvalidSpecifier:
        return Inputs(not_modelled=(f"{where}: {spec}: this way of naming a Python is not supported; give --python",))
