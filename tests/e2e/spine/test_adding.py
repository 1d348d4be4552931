"""What the README says of adding a simulator is all that it takes."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from commandline import Desk

ROOT = Path(__file__).parents[3]
HEADING = "## Adding a simulator\n"
SECTION = (ROOT / "README.md").read_text(encoding="utf-8").partition(HEADING)[2].partition("\n## ")[0]


def test_a_simulator_is_one_file_and_one_matrix(desk: Desk) -> None:
    """In a copy of the harness the README's adapter and matrix, and nothing else, measure a simulator."""
    (adapter,) = re.findall(r"```python\n(.*?)```", SECTION, re.DOTALL)
    (matrix,) = re.findall(r"```toml\n(.*?)```", SECTION, re.DOTALL)
    names = re.findall(r"`((?:harness|matrices)/[\w/]+\.\w+)`", SECTION)
    shutil.copytree(ROOT / "harness", desk.folder / "harness", ignore=shutil.ignore_patterns("__pycache__"))
    (desk.folder / names[0]).write_text(adapter, encoding="utf-8")
    (desk.folder / "matrices").mkdir()
    index = f'index = {{ no_index = true, find_links = ["{desk.wheels}"] }}\n'
    (desk.folder / names[1]).write_text(index + matrix, encoding="utf-8")

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
