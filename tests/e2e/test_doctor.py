"""`doctor` on real environments, whose packages are tiny and have one defect each."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import wheelhouse

from harness.commands.doctor import Doctored
from harness.model import Interpreter, schema
from harness.rootcause.doctor import in_place
from harness.standalone import running
from harness.standalone.doctor import doctor, inspect_environment
from harness.standalone.failures import matching

NOTHING = doctor.Knowledge([], lambda: {"cells": [], "locks": {}})
BASE = {name: os.environ[name] for name in ("PATH", "HOME", "LANG") if name in os.environ}


class Place:
    """An environment without pip, and the working folder of the user."""

    def __init__(self, folder: Path, python: str, *options: str) -> None:
        self.folder, self.here = folder / "env", folder / "here"
        self.here.mkdir()
        subprocess.run((python, "-m", "venv", "--without-pip", *options, self.folder), check=True)
        (self.site,) = self.folder.glob("lib/python3*/site-packages")
        self.shelf = folder

    def put(self, name: str, version: str, code: str = "", *, at: Path | None = None, **about: Any) -> None:
        """Install a package of one module."""
        files = {f"{name.replace('-', '_')}/__init__.py": f"__version__ = {version!r}\n{code}"}
        wheel = wheelhouse.wheel(self.shelf, version, files, {"name": name, **about})
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(at or self.site)

    def look(self, **variables: str) -> dict[str, Any]:
        """Return the document of `doctor` for this environment, with these variables."""
        asked = doctor.Request(str(self.folder), None, {**BASE, **variables}, str(self.here))
        return doctor.document(asked, running.run, NOTHING)


@pytest.fixture
def place(tmp_path: Path, host: Interpreter) -> Place:
    """Return an empty environment of the host's Python."""
    return Place(tmp_path, host.path)


def texts_of_findings(made: dict[str, Any], level: str = "warning") -> list[tuple[str, str]]:
    """Return check and text of each finding of a level."""
    return [(one["check"], one["text"]) for one in made["findings"] if one["level"] == level]


def tree(folder: Path) -> dict[str, Any]:
    """Return modification time (ns) and digest of everything below a folder."""
    return {
        str(path.relative_to(folder)): (
            path.lstat().st_mtime_ns,
            sha256(path.read_bytes()).hexdigest() if path.is_file() else None,
        )
        for path in sorted(folder.rglob("*"))
    }


def test_nothing_is_wrong(place: Place) -> None:
    """Packages that fit together and can be imported give no finding."""
    place.put("numpy", "2.2.6")
    place.put("gym", "0.26.2", "import numpy", requires=["numpy>=1.18"])

    made = place.look()

    assert (texts_of_findings(made), doctor.code(made)) == ([], 0)
    assert {name: one["version"] for name, one in made["imports"].items()} == {"numpy": "2.2.6", "gym": "0.26.2"}


def test_nothing_is_changed(place: Place) -> None:
    """Every file is as it was, to its times, and no bytecode was written."""
    place.put("numpy", "2.2.6")
    place.put("gym", "0.26.2", "import numpy\nnumpy.no_such_name")
    (place.here / "mujoco.py").write_text("")
    before = tree(place.folder), tree(place.here)

    place.look(PYTHONPATH=str(place.here))

    assert (tree(place.folder), tree(place.here)) == before
    assert not [name for name in before[0] if "__pycache__" in name]


def test_conflict(place: Place) -> None:
    """A violated bound is found with the import that fails because of it, and the import decides."""
    place.put("numpy", "2.2.6")
    place.put("gym", "0.21.0", "import numpy\nnumpy.bool8", requires=["numpy<2"])

    made = place.look()

    error = "`import gym` fails: AttributeError: module 'numpy' has no attribute 'bool8'"
    assert texts_of_findings(made) == [
        ("import", error),
        ("requirements.conflict", "numpy 2.2.6 is not what gym 0.21.0 (numpy<2) needs"),
    ]
    assert (made["decisive"], doctor.code(made)) == (error, 1)


def test_a_file_of_ones_own(place: Place) -> None:
    """A file of the user that hides a package or one of Python's modules is found.

    A folder without `__init__.py` hides nothing.
    """
    place.put("mujoco", "3.1.6")
    place.put("gym", "0.26.2")
    (place.here / "mujoco.py").write_text("raise RuntimeError('mine')\n")
    (place.here / "queue.py").write_text("")
    (place.here / "gym").mkdir()

    made = place.look()

    assert [(check, text.partition(":")[0]) for check, text in texts_of_findings(made)] == [
        ("import.shadowed", "the working folder hides mujoco of this environment"),
        ("import.shadowed", "the working folder hides queue of Python's own library"),
    ]
    assert made["imports"]["mujoco"]["error"] == "RuntimeError: mine"


def test_broken_metadata(place: Place) -> None:
    """Broken metadata are found: METADATA missing, unreadable or without version, a project twice, missing files."""
    for name in ("numpy", "scipy", "glfw", "h5py", "imageio"):
        place.put(name, "1.0")
    (place.site / "numpy-1.0.dist-info" / "METADATA").unlink()
    (place.site / "scipy-1.0.dist-info" / "METADATA").write_bytes(b"Name: scipy\nVersion: 1.0\nAuthor: \xe9\n")
    (place.site / "glfw-1.0.dist-info" / "METADATA").write_text("Name: glfw\n")
    place.put("h5py", "2.0")
    (place.site / "imageio" / "__init__.py").unlink()
    (place.site / "~umba").mkdir()

    made = place.look()

    found = [
        (check, text.rpartition("site-packages/")[2].split(";")[0].partition(" in /")[0])
        for check, text in texts_of_findings(made)
    ]
    assert sorted(found) == [
        ("metadata.broken", "glfw-1.0.dist-info: its metadata names no version"),
        ("metadata.broken", "numpy-1.0.dist-info: it has no METADATA"),
        ("metadata.broken", "scipy-1.0.dist-info: METADATA is not UTF-8 text"),
        ("metadata.duplicate", "h5py is there 2 times"),
        ("metadata.files", "imageio 1.0 lacks 1 of its files, such as imageio/__init__.py"),
    ]
    assert made["environment"]["packages"]["numpy"] == "1.0"
    assert [check for check, _ in texts_of_findings(made, "note")] == ["metadata.leftover"]


def test_two_packages_with_the_same_files(place: Place) -> None:
    """Two packages with one file are reported if its content differs; identical files do no harm."""
    about = {"opencv-python": "A = 1", "opencv-python-headless": "A = 2", "box2d": "", "box2d-py": ""}
    for name, code in about.items():
        module = "cv2" if "cv" in name else "Box2D"
        files = {f"{module}/__init__.py": code}
        wheel = wheelhouse.wheel(place.shelf, "1.0", files, {"name": name})
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(place.site)

    assert [(check, text.partition(" have")[0]) for check, text in texts_of_findings(place.look())] == [
        ("modules.claimed", "opencv-python and opencv-python-headless")
    ]


def test_imports_that_die_or_hang_are_named(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    """A crash, an exit and an endless import are each reported by name, and later modules are still tried."""
    monkeypatch.setattr(inspect_environment, "SECONDS", 2)
    place.put("numpy", "1.0", "import os; os.abort()")
    place.put("gym", "1.0", "import sys; sys.exit('no')")
    place.put("mujoco", "1.0", "import os; os._exit(7)")
    place.put("glfw", "1.0", "import time; time.sleep(60)")
    place.put("h5py", "1.0")

    made = place.look()

    assert {name: one["error"] for name, one in made["imports"].items()} == {
        "numpy": "killed by SIGABRT",
        "gym": "SystemExit: no",
        "mujoco": "the process ended with exit code 7",
        "glfw": "TimeoutError: `import glfw` takes more than 2 s",
        "h5py": None,
    }


def test_an_import_that_fails_only_after_others(place: Place) -> None:
    """An import that fails only after others is tried alone, too, and the finding says so."""
    place.put("numpy", "1.0")
    place.put("gym", "1.0", "import sys\nassert 'numpy' not in sys.modules")

    assert texts_of_findings(place.look()) == [
        ("import", "`import gym` fails once others are imported, and works alone: AssertionError")
    ]


# --- the caller's settings -------------------------------------------------------------------------------------


def test_python_path(place: Place) -> None:
    """Another version from PYTHONPATH is reported with its folder."""
    place.put("numpy", "2.2.6")
    more = place.shelf / "more"
    place.put("numpy", "1.26.4", at=more)

    made = place.look(PYTHONPATH=str(more))

    assert [(check, text.partition(":")[0]) for check, text in texts_of_findings(made)] == [
        ("import.shadowed", f"PYTHONPATH ({more}) hides numpy of this environment"),
        ("probe.difference", "versions from outside this environment are used"),
    ]
    (difference,) = [one for one in made["differences"] if one["kind"] == "module"]
    assert (difference["module"], difference["by"]) == ("numpy", ["PYTHONPATH"])


@pytest.mark.parametrize(("name", "said"), [("MUJOCO_GL", "MUJOCO_GL=bad"), ("STRANGE_SETTING", "STRANGE_SETTING")])
def test_a_variable_that_breaks_an_import(place: Place, name: str, said: str) -> None:
    """A variable that breaks an import is found, whether usual or not; its value may be a secret."""
    place.put("mujoco", "3.1.6", f"import os\nif os.environ.get({name!r}) == 'bad': raise RuntimeError('no')")
    others = {f"OTHER_{number}": "x" for number in range(9)}

    made = place.look(**others, **{name: "bad"})

    assert texts_of_findings(made) == [
        ("probe.difference", f"with {said} `import mujoco` fails: RuntimeError: no; without, it works")
    ]


def test_variables_that_break_an_import_together(place: Place) -> None:
    """If variables break an import only together, the smallest such set is named."""
    place.put("mujoco", "3.1.6", "import os\nif {'LEFT', 'RIGHT'} <= {*os.environ}: raise RuntimeError('no')")
    others = {f"OTHER_{number}": "x" for number in range(9)}

    made = place.look(**others, LEFT="1", RIGHT="2")

    assert made["decisive"] == "with LEFT and RIGHT `import mujoco` fails: RuntimeError: no; without, it works"


def test_the_user_site(tmp_path: Path, other: Interpreter) -> None:
    """Packages in ~/.local count if Python looks there, but are no part of the environment."""
    place = Place(tmp_path, other.path, "--system-site-packages")
    place.put("gym", "0.21.0")
    user = tmp_path / "home" / ".local" / "lib" / f"python{other.minor}" / "site-packages"
    place.put("numpy", "1.19.5", "raise ImportError('of another Python')", at=user)

    made = place.look(HOME=str(tmp_path / "home"))

    assert [text for _, text in texts_of_findings(made)] == [
        f"the user site brings numpy from {user}, outside this environment",
        "with the user site `import numpy` fails: ImportError: of another Python; "
        "without, it fails: ModuleNotFoundError: No module named 'numpy'",
    ]
    assert made["imports"]["numpy"]["error"] == "ImportError: of another Python"


def test_a_python_that_does_not_start(place: Place) -> None:
    """A Python that PYTHONHOME keeps from starting is started without it, and both are reported."""
    place.put("numpy", "2.2.6")

    made = place.look(PYTHONHOME="/nowhere", PYTHONUTF8="1", LD_BIND_NOW="1")

    assert "with PYTHONHOME=/nowhere this Python does not start here" in str(made["decisive"])
    assert made["environment"]["packages"] == {"numpy": "2.2.6"}
    assert doctor.code(made) == 1


@pytest.mark.parametrize(("prints", "code"), [("3.6", 3), ("", 1)], ids=["old", "dead"])
def test_no_python_at_all(tmp_path: Path, prints: str, code: int) -> None:
    """A Python that is too old cannot be examined; one that does not start is a finding."""
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\nprintf '%s' '{prints}'\nexit 1\n")
    python.chmod(0o755)

    made = doctor.document(doctor.Request(str(python), None, BASE, str(tmp_path)), running.run, NOTHING)

    assert doctor.code(made) == code
    assert ("older than 3.7" if code == 3 else "does not start") in made["decisive"]


# --- conda -----------------------------------------------------------------------------------------------------


def test_conda(place: Place) -> None:
    """In a conda environment, packages that pip wrote over conda's are found (a recorded `conda-meta`)."""
    place.put("numpy", "2.2.6")
    (place.site / "numpy-2.2.6.dist-info" / "INSTALLER").write_text("pip\n")
    place.put("six", "1.16")
    folder = place.folder / "conda-meta"
    folder.mkdir()
    site = place.site.relative_to(place.folder)
    for name, version in (("numpy", "1.26.4"), ("six", "1.16")):
        files = [f"{site}/{name}-{version}.dist-info/METADATA", f"{site}/{name}/__init__.py"]
        record = {"name": name, "version": version, "build": "py_0", "channel": "conda-forge", "files": files}
        (folder / f"{name}-{version}-py_0.json").write_text(json.dumps(record))
    (folder / "torn-1.0-0.json").write_text("{")
    (folder / "history").write_text("")

    made = place.look()

    assert made["environment"]["conda"] is True
    assert texts_of_findings(made) == [
        ("conda.overwritten", "conda says numpy 1.26.4 (py_0), but pip has put 2.2.6 over it"),
        ("conda.broken", "conda-meta/torn-1.0-0.json: it cannot be read"),
    ]


# --- the verb --------------------------------------------------------------------------------------------------


@pytest.fixture
def typed(place: Place, workplace: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run `simmatrix doctor` in the caller's folder."""

    def run(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
        kept = {name: os.environ[name] for name in ("PATH", "HOME", "HARNESS_CACHE", "HARNESS_STATE")}
        argv = (sys.executable, "-m", "harness", "doctor", *arguments)
        return subprocess.run(
            argv, cwd=place.here, env={**kept, **variables}, capture_output=True, text=True, check=False
        )

    return run


def test_the_verb(place: Place, typed: Callable[..., Any]) -> None:
    """The verb names the chosen environment first, and its document fits the schema.

    Known failures and measured results are used.
    """
    place.put("numpy", "2.2.6", "bool_ = bool")
    place.put("gym", "0.26.2", "import numpy\nnumpy.bool8", requires=["numpy>=1.18"])

    people = typed(VIRTUAL_ENV=str(place.folder))
    document = json.loads(typed("--json", "--python", str(place.folder)).stdout)

    lines = people.stdout.splitlines()
    assert (people.returncode, people.stderr) == (1, "")
    version = document["environment"]["version"]
    assert lines[0] == f"{place.folder}/bin/python (Python {version}), named by $VIRTUAL_ENV"
    assert "warning: `import gym` fails: AttributeError: module 'numpy' has no attribute 'bool8'" in lines
    jsonschema.validate(document, schema.json_schema(Doctored))
    assert document["nearest"]["command"].startswith(f"{place.folder}/bin/python -m ensurepip && ")
    assert {one["name"] for one in document["nearest"]["changes"]} >= {"numpy"}


def test_the_verb_refuses(typed: Callable[..., Any], tmp_path: Path) -> None:
    """A path without an environment is refused with a sentence and code 2."""
    done = typed("--python", "nowhere")

    hint = "name an interpreter or the folder of an environment with --python PATH"
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"simmatrix: doctor: --python nowhere: there is no such file or folder; {hint}\n"


def test_under_the_supervisor(place: Place) -> None:
    """The host's supervisor starts Pythons with the caller's variables and folder, and reports deaths alike."""
    argv = (sys.executable, "-c", "import os; print(os.environ.get('MINE'), os.getcwd(), flush=True); os.abort()")

    done = in_place.run(argv, {"MINE": "yes"}, str(place.here), 30.0)
    late = in_place.run((sys.executable, "-c", "import time; time.sleep(60)"), {}, str(place.here), 1.0)

    assert (done.signal, done.output.split()[:2]) == ("SIGABRT", ["yes", str(place.here)])
    assert late.timed_out


def test_known_failures_are_named(place: Place) -> None:
    """A known silent failure of a version, and a visible one, are named with their remedies."""
    place.put("mujoco", "4.0.0", "raise OSError('no libGL')")
    silent = {"id": "quiet", "cause": "it computes wrongly", "silent": True, "packages": ["mujoco==4.0.0"]}
    loud = {"id": "loud", "cause": "there is no libGL", "pattern": "no libGL", "phases": ["import"]}
    known = [matching.read({"remedy": {"text": "do this"}, "references": [], **one}) for one in (silent, loud)]
    asked = doctor.Request(str(place.folder), None, BASE, str(place.here))

    made = doctor.document(asked, running.run, NOTHING._replace(signatures=known))

    lines = list(doctor.lines(made, lambda remedy: str(remedy["text"])))
    assert [one["signature"] for one in made["diagnoses"]] == ["loud"]
    assert [one["signature"] for one in made["lurking"]] == ["quiet"]
    assert lines[3:5] == ["cause: there is no libGL", "remedy: do this"]
    assert "warning: it computes wrongly (quiet)" in lines
    assert "  remedy: do this" in lines


CELL = {
    "id": "m/cell",
    "python": ".".join(map(str, sys.version_info[:3])),
    "machine": "here",
    "measured": "2026-11-22T00:00:00Z",
    "verdict": "works",
    "unverified": [],
    "phases": {"single": "passed"},
    "cases": [{"env": "Ant-v4", "api": "gym", "phases": {"single": "passed"}}],
    "axes": {},
    "lock": "l",
}
MEASURED = {"cells": [CELL], "locks": {"l": [["gym", "0.26.2"], ["numpy", "1.26.4"]]}}


@pytest.mark.parametrize(
    ("env", "numpy", "said"),
    [
        (None, "2.2.6", "these versions were not measured together; the nearest that work (m/cell, here, 2026-11-22)"),
        (None, "1.26.4", "these versions were measured together, and work (m/cell, here, 2026-11-22)"),
        ("Other-v0", "2.2.6", "  Other-v0 was not part of any measurement"),
    ],
    ids=["other-versions", "these-versions", "another-environment"],
)  # fmt: skip
def test_measured_combinations_are_reported(place: Place, env: str | None, numpy: str, said: str) -> None:
    """Measured combinations are reported without a command to type; an environment never measured is named as such."""
    place.put("gym", "0.26.2")
    place.put("numpy", numpy)
    asked = doctor.Request(str(place.folder), env, BASE, str(place.here))

    made = doctor.document(asked, running.run, NOTHING._replace(measured=lambda: MEASURED))

    lines = list(doctor.lines(made, str))
    assert any(line.startswith(said) for line in lines)
    assert not any("pip install" in line for line in lines)
    assert made["nearest"]["env"] is None


def test_the_one_file(place: Place, other: Interpreter) -> None:
    """The file of `--standalone` examines an environment with another Python, and names what only the harness does."""
    place.put("gym", "0.26.2")
    place.put("numpy", "2.2.6")
    file = place.here / "simmatrix-doctor.pyz"
    made = subprocess.run((sys.executable, "-m", "harness", "doctor", "--standalone", file), env=BASE, check=False)

    def typed(*arguments: str) -> subprocess.CompletedProcess[str]:
        argv = (other.path, file, "doctor", "--python", str(place.folder), *arguments)
        return subprocess.run(argv, cwd=place.here, env=BASE, capture_output=True, text=True, check=False)

    people, document, proof = typed("--rendering"), typed("--json"), typed("--prove")

    assert (made.returncode, people.stderr, document.stderr) == (0, "", "")
    assert "pip install simmatrix; simmatrix doctor --rendering" in people.stdout
    assert json.loads(document.stdout)["environment"]["packages"] == {"gym": "0.26.2", "numpy": "2.2.6"}
    assert (proof.returncode, proof.stdout) == (2, "")
    assert "needs simmatrix on Python 3.11" in proof.stderr
