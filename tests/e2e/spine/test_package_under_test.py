"""The package under test through the whole spine: on top of locks that never hold it, its own suite beside."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import wheelhouse as fakes
from commandline import PATIENCE, CommandResult, Desk, wait_for

INDEX = 'index = { no_index = true, find_links = ["@WHEELS@"] }\n'
HOOKS = """
import os
def files(entries):
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "own_envs", "__init__.py")) as file:
        entries["own_envs/__init__.py"] = file.read()
    return entries
"""
PYPROJECT = """
[build-system]
requires = []
build-backend = "_backend"
backend-path = ["."]
[project]
name = "own-envs"
version = "1.0"
[project.optional-dependencies]
more = ["fake-build-tool"]
all = ["own-envs[more]"]
[dependency-groups]
test = ["pytest", "fake-needs-plain"]
"""
TESTS = """
import subprocess, sys
import fake_needs_plain, fake_plain, own_envs

def test_installed_one():
    assert "site-packages" in own_envs.__file__

def test_children_find_all():
    assert subprocess.run([sys.executable, "-c", "import own_envs, fake_plain"]).returncode == 0
"""


@pytest.fixture
def git() -> Callable[..., str]:
    """Run git in a folder; a commit takes everything."""
    found = shutil.which("git")
    if not found:
        pytest.skip("missing library: git")

    def run(folder: Path, *arguments: str) -> str:
        identity = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "init.defaultBranch=main")
        if arguments[0] == "commit":
            run(folder, "add", "-A")
        done = subprocess.run((found, "-C", folder, *identity, *arguments), check=True, capture_output=True, text=True)
        return done.stdout.strip()

    return run


@pytest.fixture
def project(desk: Desk) -> Path:
    """A project in the working folder, laid out flat: what lies beside its tests could be met instead of the wheel."""
    about = {"name": "own-envs", "requires": ["fake-plain"], "extras": {"more": ["fake-build-tool"]}}
    about["extras"] |= {"all": ["own-envs[more]"]}  # type: ignore[operator]
    told = json.dumps({"name": "own-envs", "version": "1.0", "metadata": fakes.metadata("1.0", about)})
    texts = {
        "pyproject.toml": PYPROJECT,
        "about.json": told,
        "_backend.py": (fakes.FAKES / "_backend.py").read_text(encoding="utf-8"),
        "build_hooks.py": HOOKS,
        "own_envs/__init__.py": "import fake_plain\n",
        "tests/__init__.py": "",
        "tests/test_own.py": TESTS,
        "matrices/README": "",
    }
    for name, text in texts.items():
        path = desk.folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return desk.folder


def measured(desk: Desk, text: str, *more: str) -> tuple[CommandResult, dict[str, dict[str, Any]]]:
    """Run a matrix of the project, and return the ended command and the cells by label."""
    ran = desk.run("run", desk.matrix("matrices/own", text), "--json", *more)
    assert ran.out, ran.err
    return ran, {cell["id"].partition("/")[2].partition("_")[2] or "one": cell for cell in ran.document["cells"]}


def creation_times(desk: Desk, cells: dict[str, dict[str, Any]]) -> dict[str, int]:
    """Return the creation time (ns) of the environments of these cells, by key."""
    keys = {cell["key"] for cell in cells.values()}
    return {key: (desk.cache / "environments" / key / "stamp.json").stat().st_mtime_ns for key in keys}


def test_a_new_commit_reuses_locks_and_environments(desk: Desk, project: Path, git: Callable[..., str]) -> None:
    """The lock never holds the subject; a new commit reuses all that it shares with the one before."""
    git(project, "init")
    git(project, "commit", "-m", "one")
    text = (
        f'subject = "."\n{INDEX}[suite]\ngroups = ["test"]\n[axes]\npython = ["host"]\nx = {{ extra = ["", "all"] }}\n'
    )
    desk.matrix("matrices/own", text)
    git(project, "commit", "-m", "a matrix")
    ran, first = measured(desk, text)

    assert ran.code == 0, ran.err
    assert {label: cell["verdict"] for label, cell in first.items()} == {"no-extra": "works", "all": "works"}
    assert first["no-extra"]["installed"] == {"fake-plain": "3.0", "own-envs": "1.0"}
    assert first["all"]["installed"] == {"fake-build-tool": "2.0", "fake-plain": "3.0", "own-envs": "1.0"}
    for cell in first.values():
        assert "own" not in (desk.folder / cell["lock"]).read_text()
        assert (cell["suite"]["outcome"], cell["suite"]["tests"]) == ("passed", {"passed": 2})
        assert cell["phases"]["suite"] == "passed"
        assert (cell["subject"]["commit"], cell["subject"]["changed"]) == (git(project, "rev-parse", "HEAD"), False)
    before = creation_times(desk, first)

    (project / "own_envs" / "__init__.py").write_text("import fake_plain\nCHANGED = 1\n")
    _, second = measured(desk, text, "-k", "*all")
    cell = second["all"]
    assert (cell["key"], cell["lock_sha256"]) == (first["all"]["key"], first["all"]["lock_sha256"])
    assert cell["subject"]["changed"]
    assert cell["subject"]["wheel_sha256"] != first["all"]["subject"]["wheel_sha256"]
    assert not cell["reused"]
    assert second["no-extra"]["verdict"] == "not_run"
    assert creation_times(desk, first) == before

    (project / "tests" / "test_more.py").write_text("def test_bad():\n    assert 1 == 2\n")
    git(project, "commit", "-m", "three")
    ran, third = measured(desk, text, "-k", "*all")
    cell = third["all"]

    assert ran.code == 1
    assert (cell["verdict"], cell["phase"]) == ("broken", "suite")
    assert cell["decisive"] == "tests.test_more.test_bad: assert 1 == 2 (1 of 3 tests)"
    assert (cell["subject"]["changed"], cell["key"]) == (False, first["all"]["key"])
    assert (desk.folder / cell["suite"]["evidence"] / "log.txt").exists()
    assert cell["cases"] == second["all"]["cases"]
    _, again = measured(desk, text, "-k", "*all")

    assert again["all"]["reused"]
    assert again["all"]["measured"] == cell["measured"]

    ran = desk.run("--pyargs", "harness.smoke", "--matrix", "matrices/own.toml", "-k", "all", "-rf", module="pytest")
    assert [line for line in ran.out.splitlines() if line.startswith("FAILED")] == [
        f"FAILED {cell['id']}::suite - {cell['decisive']}",
        f"FAILED {cell['id']}::verdict - broken in suite: {cell['decisive']}",
    ]


def test_a_suite_that_would_move_a_pin(desk: Desk, project: Path) -> None:
    """Tests that ask for another version of the cell's package are not run: the cell keeps the verdict of its cases."""
    text = (
        f'subject = "."\n{INDEX}[suite]\ngroups = ["test"]\n[axes]\npython = ["host"]\nfake-plain = ["1.0", "3.0"]\n'
        '[[expect]]\ncells = "*1.0"\nverdict = "works"\nreason = "never so"\n'
    )
    ran, cells = measured(desk, text)

    assert ran.code == 3
    assert cells["fake-plain-3.0"]["verdict"] == "works"
    told = cells["fake-plain-1.0"]
    assert (told["verdict"], told["as_expected"], told["phases"]["import"]) == ("not_run", None, "passed")
    assert (told["suite"]["outcome"], told["phases"]["suite"]) == ("not_reached", "not_reached")
    assert told["installed"] == {"fake-plain": "1.0", "own-envs": "1.0"}
    assert told["suite"]["decisive"].startswith("the tests' packages cannot be installed with the cell's: Because ")
    assert "fake-plain==1.0" in told["suite"]["decisive"]


def test_a_repository_and_what_requires_it(desk: Desk, project: Path, git: Callable[..., str]) -> None:
    """A reference is recorded as its commit; a package that requires the subject does not bring it from the index."""
    about = json.loads((project / "about.json").read_text())
    named = {key: text.replace("own-envs", "fake-plain") for key, text in about.items()}
    named["metadata"] = fakes.metadata("1.0", {"name": "fake-plain"})
    (project / "about.json").write_text(json.dumps(named))
    (project / "pyproject.toml").write_text(PYPROJECT.replace("own-envs", "fake-plain"))
    (project / "own_envs" / "__init__.py").write_text("OWN = True\n")
    (project / "tests" / "test_own.py").write_text("def test_a():\n    assert True\n")
    git(project, "init")
    git(project, "commit", "-m", "one")
    git(project, "tag", "v1")
    first = git(project, "rev-parse", "HEAD")
    git(project, "commit", "--allow-empty", "-m", "two")
    text = (
        f'subject = "git+file://{project}@v1"\nrequirements = ["fake-needs-plain"]\n{INDEX}'
        '[axes]\npython = ["host"]\n[suite]\narguments = ["-k", "nothing_of_this_name"]\n'
    )
    _, cells = measured(desk, text)

    (cell,) = cells.values()
    assert (cell["subject"]["commit"], cell["subject"]["name"]) == (first, "fake-plain")
    assert cell["installed"] == {"fake-needs-plain": "1.0", "fake-plain": "1.0"}
    assert "fake-plain" not in (desk.folder / cell["lock"]).read_text()
    assert (cell["suite"]["outcome"], cell["verdict"]) == ("skipped", "not_run")
    assert [found["text"] for found in cell["findings"]] == [
        "fake-needs-plain requires fake-plain>=2, and this is fake-plain 1.0: pip would complain",
        "there is no test to run",
    ]


def test_a_build_that_fails(desk: Desk, project: Path) -> None:
    """A subject whose wheel cannot be built is uninstallable, and stays so without another build."""
    (project / "build_hooks.py").write_text('raise RuntimeError("no compiler for this")\n')
    text = f'subject = "."\n{INDEX}[axes]\npython = ["host"]\n'
    ran, cells = measured(desk, text)
    _, again = measured(desk, text)

    assert ran.code == 1
    assert (cells["one"]["verdict"], cells["one"]["decisive"]) == (
        "uninstallable",
        "RuntimeError: no compiler for this",
    )
    assert (again["one"]["verdict"], again["one"]["reused"]) == ("uninstallable", True)


def test_a_suite_whose_environment_goes_blames_nobody(desk: Desk, project: Path) -> None:
    """A suite that fails in an environment discarded meanwhile is infra, and blames neither package nor subject."""
    (project / "tests" / "test_own.py").write_text(
        "import os, pathlib, time\n\ndef test_slow():\n    pathlib.Path(os.environ['GATE']).touch()\n"
        "    while pathlib.Path(os.environ['GATE']).exists():\n        time.sleep(0.05)\n    assert False\n"
    )
    gate, cache = desk.folder / "gate", desk.folder / "cache"
    text = f'subject = "."\n{INDEX}environment = {{ GATE = "{gate}" }}\n[suite]\n[axes]\npython = ["host"]\n'
    asked = ("run", desk.matrix("matrices/own", text), "--json")
    with desk.started(*asked, HARNESS_CACHE=str(cache)) as process:
        wait_for(gate.exists)
        for stamp in cache.glob("environments/*/stamp.json"):
            stamp.unlink()
        gate.unlink()
        out, err = process.communicate(timeout=PATIENCE)
    (cell,) = CommandResult(code=process.returncode, out=out, err=err).document["cells"]

    assert (cell["suite"]["outcome"], cell["phases"]["suite"]) == ("infra", "infra")
    assert cell["decisive"] == "the environment was removed or changed while it was used"


def test_a_wheel_and_what_cannot_be(desk: Desk, project: Path) -> None:
    """A wheel is used as it is; options that it cannot have, and anything that is no subject, are refused first."""
    about = {"name": "own-envs", "requires": ["fake-plain"]}
    wheel = fakes.wheel(project, "2.0", {"own_envs.py": "import fake_plain\n"}, about)
    _, cells = measured(desk, f'subject = "{wheel.name}"\n{INDEX}[axes]\npython = ["host"]\n')

    assert cells["one"]["installed"] == {"fake-plain": "3.0", "own-envs": "2.0"}
    assert (cells["one"]["phases"]["import"], cells["one"]["subject"]["commit"]) == ("passed", None)

    places = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(desk.wheels)}
    ran = desk.run("try", "fake-plain<3", "--subject", wheel.name, "--python", "host", "--json", **places)
    assert ran.document["cells"][0]["installed"] == {"fake-plain": "2.0", "own-envs": "2.0"}

    axes = f'{INDEX}[axes]\npython = ["host"]\n'
    refusals = {
        f'subject = "{wheel.name}"\n{axes}[suite]\n': f"subject: {wheel.name} is a wheel, which has neither tests nor "
        "dependency groups; name a folder",
        f'subject = "tests"\n{axes}': f"subject: {project}/tests is neither a wheel nor a folder with a "
        "pyproject.toml or setup.py",
        f'subject = "."\nextras = ["mroe"]\n{axes}': f"{project}/matrices/own.toml: the subject has no extra "
        '"mroe"; did you mean "more"?',
    }
    for text, sentence in refusals.items():
        ran = desk.run("run", desk.matrix("matrices/own", text))
        assert (ran.code, ran.err.strip().splitlines()[-1]) == (2, f"simmatrix: {sentence}")
