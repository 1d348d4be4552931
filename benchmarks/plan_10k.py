"""Plan a matrix of 10,000 cells: seconds from text to plan, and peak memory of the whole process.

Run as `python benchmarks/plan_10k.py`. The aim is under 2 s and 300 MB.
"""

from __future__ import annotations

import argparse
import resource
import time

from harness.matrix import matrix_file, plan
from harness.model import Plan


def matrix_text() -> str:
    """Return a matrix of 5 x 20 x 25 x 2 x 2 = 10,000 combinations, with conditions of every sort."""
    gymnasium = ", ".join(f'"1.{minor}.{patch}"' for minor in range(5) for patch in range(4))
    mujoco = ", ".join(f'"3.{minor}.0"' for minor in range(25))
    return f"""
requirements = ["gymnasium[mujoco]"]
constraints = ["scipy<2", {{ require = "numpy<2", when = {{ gymnasium = "<1.1" }} }}]
environment = {{ PYTHONWARNINGS = "default" }}
[axes]
python = ["3.9", "3.10", "3.11", "3.12", "3.13"]
gymnasium = [{gymnasium}]
mujoco = [{mujoco}]
MUJOCO_GL = {{ variable = ["egl", "osmesa"] }}
api = {{ plain = {{}}, numpy1 = {{ constraints = ["numpy<2"] }} }}
[[cases]]
env = "CartPole-v1"
api = "gymnasium"
[[cases]]
env = "Ant-v5"
api = "gymnasium"
when = {{ mujoco = ">=3.2" }}
[[exclude]]
when = {{ python = "3.9", gymnasium = "1.4.3", mujoco = "3.24.0" }}
reason = "an exclusion"
[[expect]]
cells = "py3.9_*_osmesa_*"
verdict = "partial"
phase = "render"
match = "OSMesa"
reason = "an expectation"
[[expect]]
when = {{ mujoco = "<3.3", python = ">=3.12" }}
verdict = "broken"
reason = "another"
"""


def planned(text: str) -> Plan:
    """Return the plan of the matrix."""
    return plan.make_plan(plan.Sources(matrix=matrix_file.read(text, "large.toml"), host_python="3.11.7"))


def main() -> None:
    """Print what one plan costs."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    text = matrix_text()
    started = time.perf_counter()
    matrix_plan = planned(text)
    seconds = time.perf_counter() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{len(matrix_plan.cells)} cells, {len(matrix_plan.dropped)} dropped: {seconds:.2f} s, peak {peak:.0f} MB")


if __name__ == "__main__":
    main()
