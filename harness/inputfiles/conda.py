"""environment.yml."""

from __future__ import annotations

import re
from dataclasses import replace

import yaml
from packaging.specifiers import InvalidSpecifier, SpecifierSet

from harness.errors import BadInput
from harness.inputfiles.asked import Inputs, Parsed, Source
from harness.inputfiles.pip import read_lines


def environment_yml(text: str, source: Source) -> Parsed:
    """Read conda's format: its pip part and its Python; every other conda package is not modelled."""
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        message = f"{source.name}:{line}: {error.problem}"
        raise BadInput(message) from None
    tables = {key.value: value for key, value in (root.value if isinstance(root, yaml.MappingNode) else ())}
    dependencies = tables.get("dependencies")
    if not isinstance(dependencies, yaml.SequenceNode):
        message = f"{source.name}: there is no list of dependencies; is it a conda environment file?"
        raise BadInput(message)
    found, pip = Inputs(), []
    if "variables" in tables:
        line = tables["variables"].start_mark.line + 1
        found += Inputs(not_modelled=(f"{source.name}:{line}: variables are not modelled; give them with --set",))
    for entry in dependencies.value:
        where = f"{source.name}:{entry.start_mark.line + 1}"
        if isinstance(entry, yaml.MappingNode):
            pip += [(item.start_mark.line + 1, item.value) for _, items in entry.value for item in items.value]
        else:
            found += _conda(entry.value, where)
    parsed = read_lines(pip, source)
    return replace(parsed, inputs=found + parsed.inputs)


def _conda(spec: str, where: str) -> Inputs:
    match = re.fullmatch(r"(?:[\w./-]+::)?(?P<name>[\w.-]+?)\s*(?P<version>(?:[=<>!~ ].*)?)", spec.strip())
    name = match["name"] if match else spec
    version = match["version"].strip() if match else ""
    if name == "pip" and not version:
        return Inputs()
    if name != "python":
        return Inputs(not_modelled=(f"{where}: {spec}: conda packages are not modelled",))
    fuzzy = re.fullmatch(r"(==?)?\s*(\d+(?:\.\d+)*)(\.?\*)?(=[^=]*)?", version)  # =3.10, =3.10.*, 3.10, =3.10.4=h1_0
    if fuzzy:
        version = f"=={fuzzy[2]}" if fuzzy[1] == "==" and not fuzzy[3] else f"=={fuzzy[2]}.*"
    try:
        return Inputs(python=str(SpecifierSet(version)) or None)
    except InvalidSpecifier:
        return Inputs(not_modelled=(f"{where}: {spec}: this way of naming a Python is not modelled; give --python",))
