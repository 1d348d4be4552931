"""The checks of our probes as users write them for pytest: a test for each, run in the processes that ours takes."""

import functools
import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

PLACE = Path("requests", "{}.{}-{}".format(*sys.version_info[:2], version("gymnasium")))
REQUESTS = {name: json.loads((PLACE / name).with_suffix(".json").read_text()) for name in ("checks", "repeat")}


@functools.cache
def outcomes(name):
    """Run the checks of a request, once, and return their outcomes."""
    subprocess.run([sys.executable, "-s", "incell/bootstrap.py", str((PLACE / name).with_suffix(".json"))], check=True)
    lines = (PLACE / name / "reply.jsonl").read_text().splitlines()
    records = [json.loads(line) for line in lines]
    return {record["check"]: record["outcome"] for record in records if record["kind"] == "check"}


@pytest.mark.parametrize(("name", "check"), [(name, check) for name in REQUESTS for check in REQUESTS[name]["limits"]])
def test_check(name, check):
    """A check passes, or does not apply."""
    outcome = outcomes(name)[check]
    if outcome == "skipped":
        pytest.skip("it does not apply here")
    assert outcome == "passed"
