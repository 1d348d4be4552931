"""Starting in somebody's project: what `init` writes is planned, run and compared by the other verbs as it stands."""

from __future__ import annotations

import json
import platform
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from commandline import Desk
from wheelhouse import FAKES

PYTHON = ".".join(platform.python_version_tuple()[:2])
PYPROJECT = f"""
[project]
name = "my-sim"
version = "1.0"
requires-python = ">={PYTHON}"
classifiers = ["Programming Language :: Python :: {PYTHON}"]
dependencies = ["gymnasium>=1"]

[build-system]
requires = []
build-backend = "_backend"
backend-path = ["."]
"""
METADATA = "Metadata-Version: 2.1\nName: my-sim\nVersion: 1.0\nRequires-Dist: gymnasium>=1\n"
WORKFLOW = """
on: push
jobs:
  test:
    runs-on: ubuntu-latest
    strategy:
      matrix:
        python-version: ["@PYTHON@", "3.99"]
        include:
          - gym: "1.2.3"
          - { python-version: "3.99", gym: "1.0.0" }
    steps:
      - uses: actions/setup-python@v5
        with: { python-version: "${{ matrix.python-version }}" }
      - run: pip install .
      - name: older
        if: matrix.gym != '1.2.3'
        run: pip install gymnasium==${{ matrix.gym }}
""".replace("@PYTHON@", PYTHON)


@pytest.fixture
def project(desk: Desk) -> Desk:
    """A project that registers an environment, built without tools."""
    folder = desk.folder / "my-sim"
    (folder / "site").mkdir(parents=True)
    (folder / ".git").mkdir()
    (folder / ".git" / "HEAD").write_text("ref: refs/heads/master\n")
    (folder / "pyproject.toml").write_text(PYPROJECT)
    (folder / "about.json").write_text(json.dumps({"name": "my-sim", "version": "1.0", "metadata": METADATA}))
    (folder / "site" / "my_sim.py").write_text((FAKES / "healthy" / "fake_healthy.py").read_text())
    shutil.copy(FAKES / "_backend.py", folder)
    return replace(desk, folder=folder)


def wheels(desk: Desk) -> dict[str, str]:
    """A user's settings: packages from a folder and from nowhere else."""
    return {"PIP_FIND_LINKS": str(desk.wheels), "PIP_NO_INDEX": "1"}


def test_what_is_written_runs(project: Desk) -> None:
    """The matrix measures the project, nox lists its cells, the workflow is up to date; a second time all is kept."""
    settings = wheels(project)
    ran = project.run("init", **settings)

    assert (ran.code, ran.out.splitlines()) == (
        0,
        [
            "wrote matrices/my-sim.toml",
            "wrote noxfile.py",
            "next: simmatrix run matrices/my-sim.toml  (1 cell)",
        ],
    )
    expanded = json.loads((project.folder / "matrices" / "my-sim.expanded.json").read_text())
    assert expanded["axes"] == {"gymnasium": ["1.2.3"]}
    workflow = project.folder / ".github" / "workflows" / "simmatrix.yml"
    assert 'branches: ["master"]' in workflow.read_text()
    check = ("ci", "matrices/my-sim.toml", "--branch", "master", "--check", workflow)
    assert project.run(*check).code == 0
    listed = project.run("-l", module="nox")
    assert f"- cell(my-sim/py{PYTHON}-gymnasium1.2.3) [my-sim,py{PYTHON}]" in listed.out

    (cell,) = project.run("run", "matrices/my-sim.toml", "--json", **settings).document["cells"]
    assert (cell["verdict"], [case["env"] for case in cell["cases"]]) == ("works", ["Healthy-v0"])

    again = project.run("init", "--offline")
    assert again.out.splitlines() == [
        "matrices/my-sim.toml: is there already and stays as it is",
        ".github/workflows/simmatrix.yml: is there already and stays as it is; "
        "`simmatrix ci matrices/my-sim.toml --check .github/workflows/simmatrix.yml` compares",
        "next: simmatrix run matrices/my-sim.toml  (1 cell)",
    ]


def test_what_a_workflow_claims_and_never_installs(project: Desk) -> None:
    """Each leg is listed; its matrix is what is installed; lines for a noxfile that is there are printed."""
    (project.folder / "ci.yml").write_text(WORKFLOW)
    (project.folder / "noxfile.py").write_text("import nox\n")

    ran = project.run("init", "--from", "ci.yml", "--name", "ci", "--offline")

    assert ran.code == 0, ran.err
    claims, _, rest = ran.out.partition("wrote matrices/ci.toml\n")
    assert claims.splitlines() == [
        "ci.yml: job test: 2 combinations",
        f"  python-version {PYTHON}, gym 1.2.3",
        f"    installs Python {PYTHON}, .",
        "    never installs gym 1.2.3: the step \"older\", which would, is left out by `if: matrix.gym != '1.2.3'`",
        "  python-version 3.99, gym 1.0.0",
        "    installs Python 3.99, ., gymnasium==1.0.0",
        "  include[1] adds no combination: it replaces gym 1.2.3 by 1.0.0 on python-version 3.99",
        "  1 of 2 combinations claimed and never installed as such",
    ]
    assert rest.startswith("noxfile.py: is there already and stays as it is; its cells come with these lines:\n\n")
    assert '    noxface.cells("matrices/ci.toml")\n' in rest
    assert (project.folder / "noxfile.py").read_text() == "import nox\n"
    plan = project.run("plan", "matrices/ci.toml", "--json").document
    assert [(cell["id"], cell["requirements"]) for cell in plan["cells"]] == [
        (f"ci/py{PYTHON}-newest", []),
        ("ci/py3.99-gymnasium1.0.0", ["gymnasium==1.0.0"]),
    ]

    document = project.run("init", "--from", "ci.yml", "--name", "other", "--json").document
    assert [len(job["legs"]) for job in document["jobs"]] == [2]
    assert document["written"] == ["matrices/other.toml", ".github/workflows/simmatrix-other.yml"]
    assert document["kept"] == ["noxfile.py"]


def test_a_folder_without_a_project_is_told(desk: Desk) -> None:
    """Nothing is written where there is nothing to measure."""
    ran = desk.run("init")

    message = f"simmatrix: {desk.folder}: has neither pyproject.toml nor setup.py; name the folder of a project\n"
    assert (ran.code, ran.err, list(desk.folder.iterdir())) == (2, message, [])
    assert desk.run("init", "nowhere").err == "simmatrix: nowhere: is not a folder\n"
    assert desk.run("init", "--from", "ci.yml").err == (
        "simmatrix: --from ci.yml: cannot be read: No such file or directory\n"
    )
    (desk.folder / "setup.py").write_text("import setuptools\n")
    for name in ("../up", ""):
        ran = desk.run("init", "--name", name)
        message = f'simmatrix: --name: "{name}" cannot be a label: use letters, digits and "._+-" only\n'
        assert (ran.code, ran.err) == (2, message)
    assert not (Path(desk.folder) / "matrices").exists()
