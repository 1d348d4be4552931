"""The digests of the in-cell program are the same under every Python that the host runs on."""

from __future__ import annotations

import json
import subprocess

import pytest

from harness.machine import interpreters
from harness.model.vocabulary import INCELL
from harness.probes import program, syntax
from harness.standalone import adapters

HOSTS = ("3.11", "3.12", "3.13", "3.14")

DIGESTING = """
import ast, importlib.util, json, pathlib, sys
spec = importlib.util.spec_from_file_location("syntax", sys.argv[1])
syntax = importlib.util.module_from_spec(spec)
spec.loader.exec_module(syntax)
trees = {path.name: ast.parse(path.read_bytes()) for path in pathlib.Path(sys.argv[2]).glob("*.py")}
trees["strings"] = ast.parse("f'{a:<{b}}', f'a{{b}}' 'c' f'{d}', '\\u2028 \\U0001fae8', 1e300, -0.0, 1j, ...")
declared = {name: sys.argv[3:] if name.startswith("api_") else () for name in trees}
print(json.dumps({name: syntax.digest(tree, declared[name]) for name, tree in trees.items()}))
"""


def digests(version: str) -> dict[str, str]:
    """Digest every in-cell file, and odd strings, by one of the Pythons."""
    python = interpreters.find(version)
    if python is None:
        pytest.skip(f"unavailable: python{version}")
    command = (python.path, "-c", DIGESTING, syntax.__file__, str(INCELL), *adapters.NAMES)
    return dict(json.loads(subprocess.run(command, capture_output=True, check=True).stdout))


@pytest.mark.parametrize("version", HOSTS)
def test_digests_are_those_of_every_host(version: str) -> None:
    """A measurement from one Python is known from another."""
    found = digests(version)
    assert found.pop("strings") == "91e21e57695110c29611aded216be859"
    assert found == {name: file.digest for name, file in program.own().files.items()}
