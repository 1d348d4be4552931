"""`gc`: environments in use stay, everything deleted can be rebuilt, and the freed space is as announced."""

from __future__ import annotations

import os
import time
from dataclasses import replace

from commandline import Desk
from test_resume import PATIENCE

MATRIX = """
requirements = ["gymnasium==1.2.3", "fake-gate", "fake-blank-frame"]
index = { no_index = true, find_links = ["@WHEELS@"] }
environment = { FAKE_GATE = "@FOLDER@/gate" }
cases = [{ env = "fake_gate:Gate-v0", api = "gymnasium" }]

[axes]
python = ["host"]
"""


def test_all_that_goes_is_made_again(desk: Desk) -> None:
    """An environment stays while a probe runs in it; later all is deleted, and a new run gives the same results."""
    own = replace(desk, cache=desk.folder / "cache")
    matrix = own.matrix("m", MATRIX)
    with own.started("run", matrix, "--json") as process:
        deadline = time.monotonic() + PATIENCE
        while not (own.folder / "gate.reached").exists():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        busy = own.run("gc", "--older-than", "0", "--json")
        (own.folder / "gate").touch()
        process.communicate(timeout=PATIENCE)
    assert (process.returncode, busy.code, busy.document["in_use"]) == (0, 0, 2)
    assert list(own.cache.glob("environments/*/stamp.json"))

    dry = own.run("gc", "--older-than", "0", "--dry-run", "--json")
    assert list(own.cache.glob("environments/*/stamp.json"))
    swept = own.run("gc", "--older-than", "0", "--json")
    assert not list(own.cache.glob("environments/*"))[1:]
    told = {one["kind"]: one["number"] for one in swept.document["removed"]}
    assert told == {"environments": 1, "downloads (uv's cache)": 1}
    for ran in (dry, swept):
        assert abs(ran.document["size_before"] - ran.document["freed"] - ran.document["size_after"]) < 100_000
    assert swept.document["freed"] > 10_000_000

    kept = own.run("run", matrix, "--json").document["cells"][0]
    assert not list(own.cache.glob("environments/*/stamp.json"))
    anew = own.run("run", matrix, "--json", "--fresh").document["cells"][0]
    assert (kept["verdict"], kept["reused"]) == ("works", True)
    assert (anew["verdict"], anew["reused"], anew["key"]) == ("works", False, kept["key"])


def test_waste_is_deleted_without_limits(desk_with_results: Desk) -> None:
    """Without limits only waste is deleted; the user learns what limits would free, and bad limits are refused."""
    own = replace(desk_with_results, cache=desk_with_results.folder / "cache")
    left = own.state / "evidence" / "left-over"
    left.mkdir()
    (left / "log.txt").write_text("x" * 5000)
    (own.cache / "environments" / "unfinished").mkdir(parents=True)
    for path in (left, left / "log.txt"):
        os.utime(path, (time.time() - 1e6,) * 2)

    ran = own.run("gc")

    assert ran.code == 0
    assert [line.split("  ")[0] for line in ran.out.splitlines()[:-1]] == ["logs and frames", "environments"]
    assert " freed, " in ran.out.splitlines()[-1]
    assert (left.exists(), (own.cache / "environments" / "unfinished").exists()) == (False, False)
    assert own.run("report", "small").code == 1
    wrong = own.run("gc", "--max-size", "much")
    assert (wrong.code, wrong.err.splitlines()[-1]) == (
        2, "simmatrix gc: error: argument --max-size: 'much' is not a size; write one such as 20GB or 500MB"
    )  # fmt: skip
