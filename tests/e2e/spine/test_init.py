"""Start in a user's project: the files that `init` writes can be planned, run and compared without edits."""

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
    """Return a project that registers an environment and builds without tools."""
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
    """Return user settings that take packages from one folder only."""
    return {"PIP_FIND_LINKS": str(desk.wheels), "PIP_NO_INDEX": "1"}


def test_the_written_matrix_runs(project: Desk) -> None:
    """The matrix measures the project, nox lists its cells, the workflow is up to date; a second `init` keeps them."""
    settings = wheels(project)
    (project.folder / "tests").mkdir()
    (project.folder / "tests" / "test_it.py").write_text("def test_a():\n    import my_sim\n")
    ran = project.run("init", "--install", "simmatrix", **settings)

    assert (ran.code, ran.out.splitlines()) == (
        0,
        [
            "asking the installed package for its environments, and trying some of them",
            "  The package has 1 environment; each can be a case of its own.",
            "wrote matrices/my-sim.toml",
            "wrote noxfile.py",
            "next: simmatrix run matrices/my-sim.toml  (1 cell)",
            "later: simmatrix lock matrices/my-sim.toml --upgrade  (newer releases, for a scheduled workflow, too)",
        ],
    )
    expanded = json.loads((project.folder / "matrices" / "my-sim.expanded.json").read_text())
    assert expanded["axes"] == {"gymnasium": ["1.2.3"]}
    workflow = project.folder / ".github" / "workflows" / "simmatrix.yml"
    assert 'branches: ["master"]' in workflow.read_text()
    assert "pip install --quiet simmatrix\n" in workflow.read_text()
    check = ("ci", "matrices/my-sim.toml", "--branch", "master", "--install", "simmatrix", "--check", workflow)
    assert project.run(*check).code == 0
    listed = project.run("-l", module="nox")
    assert f"- cell(my-sim/py{PYTHON}_gymnasium-1.2.3) [my-sim,py{PYTHON}]" in listed.out

    (cell,) = project.run("run", "matrices/my-sim.toml", "--json", **settings).document["cells"]
    assert (cell["verdict"], [case["env"] for case in cell["cases"]]) == ("works", ["Healthy-v0"])
    assert (cell["suite"]["outcome"], cell["suite"]["tests"]) == ("passed", {"passed": 1})

    again = project.run("init", "--offline", "--install", "simmatrix")
    assert again.out.splitlines() == [
        "matrices/my-sim.toml: exists already and is kept",
        ".github/workflows/simmatrix.yml: exists already and is kept; "
        "`simmatrix ci matrices/my-sim.toml --check .github/workflows/simmatrix.yml` compares",
        "next: simmatrix run matrices/my-sim.toml  (1 cell)",
        "later: simmatrix lock matrices/my-sim.toml --upgrade  (newer releases, for a scheduled workflow, too)",
    ]


def test_versions_that_a_workflow_claims_and_never_installs(project: Desk) -> None:
    """Each leg of a workflow is listed with the versions really installed.

    The matrix uses the installed versions. Lines for an existing noxfile are printed.
    """
    (project.folder / "ci.yml").write_text(WORKFLOW)
    (project.folder / "noxfile.py").write_text("import nox\n")

    ran = project.run("init", "--from", "ci.yml", "--name", "ci", "--offline", "--install", "simmatrix")

    assert ran.code == 3, ran.err
    (waiting,) = [line for line in ran.out.splitlines() if line.startswith("still open: ")]
    assert "the network was disabled" in waiting
    assert ran.out.splitlines()[-1] == (
        "next: run `simmatrix init` again without --offline; it keeps existing files, so remove matrices/ci.toml first"
    )
    assert (
        '# Found in the sources, and not tried.\n[[cases]]\nenv = "Healthy-v0"'
        in (project.folder / "matrices" / "ci.toml").read_text()
    )
    claims, _, rest = ran.out.partition("wrote matrices/ci.toml\n")
    assert claims.splitlines()[:-1] == [
        "ci.yml: job test: 2 combinations",
        f"  python-version {PYTHON}, gym 1.2.3",
        f"    installs Python {PYTHON}, .",
        "    never installs gym 1.2.3: the step \"older\", which would, is left out by `if: matrix.gym != '1.2.3'`",
        "  python-version 3.99, gym 1.0.0",
        "    installs Python 3.99, ., gymnasium==1.0.0",
        "  include[1] adds no combination: it replaces gym 1.2.3 by 1.0.0 on python-version 3.99",
        "  1 of 2 combinations claimed but never installed",
    ]
    assert rest.startswith("noxfile.py: exists already and is kept; add these lines to it:\n\n")
    assert '    noxface.cells("matrices/ci.toml")\n' in rest
    assert (project.folder / "noxfile.py").read_text() == "import nox\n"
    plan = project.run("plan", "matrices/ci.toml", "--json").document
    assert [(cell["id"], cell["requirements"]) for cell in plan["cells"]] == [
        (f"ci/py{PYTHON}_newest", []),
        ("ci/py3.99_gymnasium-1.0.0", ["gymnasium==1.0.0"]),
    ]

    other = ("init", "--from", "ci.yml", "--name", "other", "--install", "simmatrix", "--json")
    document = project.run(*other, "--offline").document
    assert document["not_found_out"] == [waiting.partition(": ")[2]]
    assert [len(job["legs"]) for job in document["jobs"]] == [2]
    assert document["written"] == ["matrices/other.toml", ".github/workflows/simmatrix-other.yml"]
    assert document["kept"] == ["noxfile.py"]


def test_a_folder_without_a_project_is_refused(desk: Desk) -> None:
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


ENVS = """
import gymnasium
from my_sim.healthy import Healthy

class Broken(Healthy):
    def reset(self, **more):
        raise RuntimeError("no model for this")

class Asking(Healthy):
    def __init__(self, task, render_mode=None):
        self.render_mode = render_mode

for name, kind in {"Broken": Broken, "Asking": Asking, "Old": Healthy}.items():
    gymnasium.register(f"{name}-v0", kind)
gymnasium.register("Old-v1", Healthy)
"""


def test_a_first_case_is_stepped_and_not_drawn(project: Desk) -> None:
    """`init` tries an environment as far as `single`, which decides; pictures of a slow one would take minutes."""
    drawn = project.folder / "drawn"
    module = project.folder / "site" / "my_sim.py"
    method = "    def render(self):\n"
    module.write_text(module.read_text().replace(method, f"{method}        open({str(drawn)!r}, 'w').close()\n"))

    ran = project.run("init", "--install", "simmatrix", **wheels(project))

    assert ran.code == 0, ran.out
    assert 'env = "Healthy-v0"' in (project.folder / "matrices" / "my-sim.toml").read_text()
    assert not drawn.exists()


def test_environments_of_submodules_are_found_and_tried(project: Desk) -> None:
    """Submodules' environments that run become cases; failures are told, and a module that kills Python, too."""
    site = project.folder / "site"
    (site / "my_sim.py").rename(project.folder / "healthy.py")
    (site / "my_sim").mkdir()
    texts = {
        "__init__": "",
        "healthy": (project.folder / "healthy.py").read_text().replace('gymnasium.register("Healthy-v0", Healthy)', ""),
        "deadly": "import gymnasium, os\nregister = gymnasium.register\nos._exit(3)\nregister()\n",
        "lost": "import gymnasium, not_there\nregister()\n",
        "envs": ENVS,
    }
    for name, text in texts.items():
        (site / "my_sim" / f"{name}.py").write_text(text)

    ran = project.run("init", "--install", "simmatrix", **wheels(project))

    assert ran.code == 0, ran.out
    text = (project.folder / "matrices" / "my-sim.toml").read_text()
    assert [line for line in text.splitlines() if line.startswith(("env =", "imports ="))] == [
        'env = "Old-v1"',
        'imports = ["my_sim.envs"]',
    ]
    assert "# Broken-v0 was tried and left out: RuntimeError: no model for this" in text
    assert "Old-v0" not in text
    assert "not found out" not in ran.out
