"""Tests libraries that replace functions of the standard library, or of ours, under every Python present."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from textwrap import dedent

import pytest

import harness
from harness.machine import interpreters
from harness.model import Case, Outcome

SUPPORTED = ("3.7", "3.8", "3.9", "3.10", "3.11", "3.12", "3.13", "3.14")

HEALTHY = {
    "json": "import json; json.dumps = lambda value, **_: b'{}'; json.dump = json.load = json.loads = None",
    "encoder": """
        import json, json.encoder
        class Other:
            def __init__(self, **_): pass
            def encode(self, value): return b'{}'
        json.JSONEncoder = json.encoder.JSONEncoder = Other
        json.encoder.encode_basestring_ascii = json.encoder.c_make_encoder = None
        """,
    "pid": "import os; os.getpid = lambda: 1",
    "write": "import os; os.write = lambda *_: 0; os.open = os.fstat = os._exit = None",
    "time": "import time; time.monotonic = time.time = lambda: 0.0",
    "imports": "import gc, importlib; importlib.import_module = gc.collect = None",
    "signals": "import signal; signal.setitimer = signal.alarm = None",
    "path": "import os.path; os.path.join = lambda *parts: b'x'",
}
"""Packages that do no wrong, though they put something of their own in the place of what Python has."""


def importing(name: str) -> Case:
    """Return a case that only imports."""
    return Case(id="c", env=None, api="", imports=(name,), checks=("import.modules",))


@pytest.mark.parametrize("version", SUPPORTED)
@pytest.mark.parametrize("what", HEALTHY)
def test_a_package_that_replaces_the_standard_library_is_healthy(
    what: str, version: str, probe, tmp_path: Path
) -> None:
    """The reply is the same whole one, and nothing of it is a finding."""
    python = interpreters.find(version)
    if python is None:
        pytest.skip(f"unavailable: python{version}")
    (tmp_path / "replacing.py").write_text(dedent(HEALTHY[what]))
    done = probe(python.path, importing("replacing"))
    assert done.returncode == 0, done.output
    assert (done.reply.problems, done.reply.complete, done.findings) == ((), True, {})
    assert done["import.modules"].outcome is Outcome.PASSED


REPLACING = {
    "function": "m['cell_module_search'].import_or_call = lambda name: None",
    "method": "m['cell_run'].Probe._attempt = lambda self, check, follows=False: 'passed'",
    "check": "m['check_import_modules'].run = lambda probe, facts: None",
}


@pytest.mark.parametrize("what", REPLACING)
def test_a_replaced_function_of_ours_is_a_finding(what: str, probe, tmp_path: Path) -> None:
    """A replaced function of ours is named, unless the replacement is hidden with care."""
    find = "import sys; m = {n.rpartition('.')[2]: v for n, v in list(sys.modules.items()) if '_simmatrix_cell' in n}\n"
    (tmp_path / "replacing.py").write_text(find + REPLACING[what])
    found = probe(sys.executable, importing("replacing")).findings
    (texts,) = found.values()
    name = {
        "function": "cell_module_search.import_or_call",
        "method": "cell_run._attempt",
        "check": "check_import_modules.run",
    }
    assert list(found) == ["import.replaced"]
    assert texts[0].endswith(f"so that its checks prove nothing: {name[what]}")


VALUES = [
    None,
    True,
    False,
    0,
    -(10**30),
    1.5,
    1e300,
    'a "b" \\ \n \x00 \x7f é \U0001f600',
    [1, [2.0, "x"], ()],
    {"a": {"b": [None]}, "": ""},
]


@pytest.fixture
def encoded(monkeypatch: pytest.MonkeyPatch):
    """Return the encoder, imported by this Python as the bootstrap does."""
    package = type(sys)("_simmatrix_cell")
    package.__path__ = [str(Path(harness.__file__).parent / "incell")]
    monkeypatch.setitem(sys.modules, "_simmatrix_cell", package)
    from _simmatrix_cell import cell_originals  # type: ignore[import-not-found]

    return cell_originals.encode


@pytest.mark.parametrize("value", VALUES, ids=repr)
def test_values_are_json(value: object, encoded) -> None:
    """JSON values are written as the standard library writes them."""
    assert encoded(value) == json.dumps(value)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (math.nan, "nan"),
        (-math.inf, "-inf"),
        (Path("x"), "x"),
        ("\udcff", "\\udcff"),
        (1 << 20000, "a number of 20001 bits"),
        (b"x", "b'x'"),
    ],
    ids=["nan", "inf", "object", "surrogate", "long", "bytes"],
)
def test_values_that_json_lacks_become_text(value: object, text: str, encoded) -> None:
    """A number that JSON lacks, an object, a text that UTF-8 cannot hold become text that it can."""
    assert json.loads(encoded(value)) == text
