"""The guide's steps for adding a simulator are complete: its adapter and its matrix are enough."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

from commandline import Desk

ROOT = Path(__file__).parents[3]
SECTION = (ROOT / "docs" / "extending" / "simulator.md").read_text(encoding="utf-8")


DECLARED = """
IDS = r"heavy|light"
EXAMPLE = "pointmass:heavy"
DRAWS = ("fake_pointmass",)
DRAWING_CODE = (r"/fake_pointmass/egl\\b",)
NATIVE_ERRORS = (r"\\[pointmass\\] .+",)
READS_MUJOCO_GL = ("fake-pointmass",)
"""

ASKED = """
import json, re
from harness.judging.runs.check import Ending, check_record
from harness.model import CheckReply, Outcome, Raised
from harness.matrix.plan import adapter_choice
from harness.standalone import keys
from harness.model.vocabulary import settings

def drawn(traceback, **facts):
    error = Raised(type="RuntimeError", message="no", traceback=traceback, blame="library")
    reply = CheckReply(check="render.rgb_array", outcome=Outcome.FAILED, raised=error, facts=facts)
    return check_record(reply, Ending(), {"": "no EGL here"}).outcome

print(json.dumps({
    "weight": keys.weight("fake-pointmass"),
    "module": keys.MODULES.get("fake-pointmass"),
    "api": adapter_choice.guess_api("light", ["fake-pointmass"]),
    "set": settings({"MUJOCO_GL": "egl"}, ["fake-pointmass"]),
    "loaded": drawn("", loaded=["fake_pointmass"]),
    "code": drawn('  File "$ENV/site-packages/fake_pointmass/egl.py", line 1'),
}))
"""


def add(desk: Desk, declared: str = "") -> None:
    """Make a copy of the harness with the guide's adapter, which may declare more, and its matrix."""
    (adapter,) = re.findall(r"```python\n(.*?)```", SECTION, re.DOTALL)
    (matrix,) = re.findall(r"```toml\n(.*?)```", SECTION, re.DOTALL)
    names = re.findall(r"`((?:harness|matrices)/[\w/]+\.\w+)`", SECTION)
    shutil.copytree(ROOT / "harness", desk.folder / "harness", ignore=shutil.ignore_patterns("__pycache__"))
    top, code = adapter.split("\n\n\n", 1)
    (desk.folder / names[0]).write_text(f"{top}\n{declared}\n\n{code}", encoding="utf-8")
    (desk.folder / "matrices").mkdir()
    index = f'index = {{ no_index = true, find_links = ["{desk.wheels}"] }}\n'
    (desk.folder / names[1]).write_text(index + matrix, encoding="utf-8")


def read_answers(desk: Desk) -> dict[str, object]:
    """Return the answers that the copy of the harness gives about the simulator."""
    ran = subprocess.run((sys.executable, "-c", ASKED), cwd=desk.folder, capture_output=True, text=True, check=True)
    return dict(json.loads(ran.stdout))


def test_the_declarations_of_a_simulator_are_used_everywhere(desk: Desk) -> None:
    """A declared package, ids, drawing and native errors are used everywhere, and no other file has to name them."""
    add(desk, DECLARED)

    ran = desk.run("run", "pointmass", "--json")

    found = ran.cells("fake-pointmass")["2.0"]["findings"]
    assert [(one["check"], one["text"]) for one in found] == [("import.native", "[pointmass] push: no such force")]
    assert read_answers(desk) == {
        "weight": 5,
        "module": "fake_pointmass",
        "api": "pointmass",
        "set": ["MUJOCO_GL=egl"],
        "loaded": "unavailable",
        "code": "unavailable",
    }


def test_missing_declarations_of_a_simulator_are_not_guessed(desk: Desk) -> None:
    """A simulator that declares only its package gives plain answers to the same questions."""
    add(desk)

    assert read_answers(desk) == {
        "weight": 5,
        "module": "fake_pointmass",
        "api": None,
        "set": [],
        "loaded": "failed",
        "code": "failed",
    }


def test_a_simulator_is_one_file_and_one_matrix(desk: Desk) -> None:
    """The guide's adapter and matrix measure a simulator in a copy of the harness, without any other change."""
    add(desk)

    ran = desk.run("run", "pointmass", "--json")

    assert ran.code == 1, ran.err
    cells = ran.cells("fake-pointmass")
    assert {version: cell["verdict"] for version, cell in cells.items()} == {"1.0": "works", "2.0": "broken"}
    assert cells["2.0"]["decisive"] == "TypeError: push() takes a vector since 2.0"
    (case,) = cells["1.0"]["cases"]
    assert (case["api"], case["env"]) == ("pointmass", "pointmass:heavy")
    assert case["checks"] == {
        "import.modules": "passed",
        "single.loop": "passed",
        "single.start_pose": "skipped",
        "single.contact": "skipped",
        "single.solver": "skipped",
        "single.arrays": "passed",
        "vector.sync": "skipped",
        "vector.async.fork": "skipped",
        "render.rgb_array": "passed",
        "render.camera": "skipped",
    }
    assert cells["1.0"]["findings"] == []
