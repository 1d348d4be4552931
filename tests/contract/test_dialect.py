"""The in-cell side and what stands alone speak Python 3.7 to 3.14, standard library only, under names of their own."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

import pytest

import harness
from harness.machine import interpreters
from harness.model import Case, Outcome
from harness.model.vocabulary import APIS
from harness.probes import program

INCELL = Path(harness.__file__).parent / "incell"
STANDALONE = Path(harness.__file__).parent / "standalone"
OURS = sorted(path for path in STANDALONE.glob("**/*.py") if "vendored" not in path.parts)
FILES = sorted(INCELL.glob("**/*.py"))
SUPPORTED = ("3.7", "3.8", "3.9", "3.10", "3.11", "3.12", "3.13", "3.14")

REMOVED_MODULES = """
_bootlocale aifc asynchat asyncore audioop binhex cgi cgitb chunk crypt distutils dummy_threading formatter imghdr imp
lib2to3 macpath mailcap msilib nis nntplib ossaudiodev parser pipes smtpd sndhdr spwd sunau symbol telnetlib uu xdrlib
"""
"""Standard modules that are gone in 3.14 or before."""

REMOVED_NAMES = """
find_module find_loader load_module getargspec formatargspec makeSuite findTestCases assertEquals assertItemsEqual
assertRegexpMatches utcnow utcfromtimestamp getdefaultlocale resetlocale isAlive getchildren getiterator clock
set_coroutine_wrapper get_event_loop_policy set_child_watcher NameConstant Num Str Bytes decodestring encodestring
ugettext lgettext
"""
"""Functions, methods and classes of the standard library that are gone or going in 3.14 or before."""

NEWER_NAMES = """
removeprefix removesuffix is_relative_to readlink cached_property cache batched pairwise prod comb isqrt dist hypot
sumprod to_thread aclosing get_origin get_args TypedDict Final Literal Protocol TypeAlias ParamSpec
override StrEnum BooleanOptionalAction randbytes unparse get_source_segment waitstatus_to_exitcode
bit_count addModuleCleanup hardlink_to
"""
"""Functions and classes of the standard library that 3.7 lacks."""

NEWER_MODULES = {"importlib.metadata", "tomllib", "zoneinfo", "graphlib", "annotationlib", "compression"}

LIBRARIES = {"numpy", "metaworld"}
"""Packages that an in-cell module may import, once the library under test has brought them."""


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(), feature_version=(3, 7))


def _imports(tree: ast.AST) -> list[tuple[str, int]]:
    """Return (module, level of relative import) of each import statement."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, 0) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found.append((node.module or "", node.level))
    return found


def _at_load(tree: ast.Module) -> ast.Module:
    """Return the file without the bodies of its functions, which do not run at import."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            node.body = [ast.Pass()]
    return tree


@pytest.mark.parametrize("path", [*FILES, *OURS], ids=lambda path: path.name)
def test_syntax(path: Path) -> None:
    """Every file parses as Python 3.7."""
    _tree(path)


@pytest.mark.parametrize(
    "source", ["if (n := 1): pass", "def f(a, /): pass", "with (open('x') as f): match f:\n  case 1: pass"]
)
def test_syntax_check_can_fail(source: str) -> None:
    """Syntax newer than Python 3.7 is refused by the same call."""
    with pytest.raises(SyntaxError):
        ast.parse(source, feature_version=(3, 7))


def test_no_debug_format() -> None:
    """f-strings with `=` are of 3.8, which the parser does not tell."""
    assert [
        path.name for path in [*FILES, *OURS] if re.search(r"""\bf(["']).*\{[^{}"']*=\}.*\1""", path.read_text())
    ] == []


@pytest.mark.parametrize("path", [*FILES, *OURS], ids=lambda path: path.name)
def test_nothing_removed(path: Path) -> None:
    """No module and no name that a Python up to 3.14 has dropped is used."""
    tree = _tree(path)
    modules = {name.partition(".")[0] for name, level in _imports(tree) if level == 0}
    names = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert (modules & set(REMOVED_MODULES.split()), names & set(REMOVED_NAMES.split())) == (set(), set())


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_imports(path: Path) -> None:
    """Imports are of our own package, relatively and at the top, or of the standard library."""
    tree = _tree(path)
    relative = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.level]
    assert all(node in tree.body and node.level == 1 for node in relative)
    ours = {"_simmatrix_cell"} if path.name == "bootstrap.py" else set()
    others = {name.partition(".")[0] for name, level in _imports(tree) if level == 0}
    assert others - set(sys.stdlib_module_names) - LIBRARIES - ours == set()


@pytest.mark.parametrize("path", OURS, ids=lambda path: path.name)
def test_the_standalone_code_imports_itself_and_the_standard_library(path: Path) -> None:
    """Relatively, and nothing that 3.7 lacks; the host alone knows newer ones."""
    tree = _tree(path)
    relative = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.level]
    assert all(1 <= node.level <= len(path.relative_to(STANDALONE).parts) for node in relative)
    others = {name for name, level in _imports(tree) if level == 0}
    assert {name.partition(".")[0] for name in others} - set(sys.stdlib_module_names) == set()
    assert others & NEWER_MODULES == set()
    names = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    names |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert names & set(NEWER_NAMES.split()) == set()
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.keyword) and node.arg in {"strict", "slots"}]


def test_libraries_come_late() -> None:
    """Nothing that is loaded before the library under test imports a library."""
    early = {name for api in APIS for name in program.own().loaded(api, ["import.modules"])}
    found = {name.partition(".")[0] for file in early for name, _ in _imports(_at_load(_tree(INCELL / file)))}
    assert found & LIBRARIES == set()


def test_file_names() -> None:
    """No file is named like a module that a library could mean."""
    assert [
        path.name
        for path in FILES
        if not re.fullmatch(r"(bootstrap|(bootstrap|cell|api|check)_[a-z0-9_]+)\.py", path.name)
    ] == []


@pytest.mark.parametrize("version", SUPPORTED)
def test_runs(version: str, probe, tmp_path: Path) -> None:
    """Every interpreter compiles all files, imports standard modules through the door and ends the reply."""
    python = interpreters.find(version)
    if python is None:
        pytest.skip(f"unavailable: python{version}")
    (tmp_path / "compiled.py").write_text(
        f"import glob\nfor name in glob.glob({str(INCELL / '*.py')!r}):\n    compile(open(name).read(), name, 'exec')\n"
    )
    case = Case(id="c", env=None, api="", imports=("compiled", "decimal", "email.message"), checks=("import.modules",))
    done = probe(python.path, case)
    assert done.reply.problems == ()
    assert done.reply.complete, done.output
    assert done.reply.facts["python"].startswith(version)
    assert done["import.modules"].outcome is Outcome.PASSED
    assert list(done["import.modules"].facts["seconds"]) == ["compiled", "decimal", "email.message"]
    assert done.reply.modules == program.own().loaded("", case.checks)
