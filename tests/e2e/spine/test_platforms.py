"""The files that `ci` writes are run with their own scripts, from the plan to the verdict on the merged report."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

from commandline import SMALL, Desk
from platforms import GitHub, read_workflow, with_slurm

RED = """
[[expect]]
when = { which = "blank" }
verdict = "partial"
phase = "render"
match = "blank frame"
reason = "it paints black"
"""


FEW = SMALL.read_text().replace("@FAKES@", '"fake-healthy", "fake-blank-frame"')
"""Two cells, one of them red, in an environment that is made quickly."""


def test_github(desk: Desk) -> None:
    """Each shard measures one cell and the merged report has both; a lost shard makes the one required check red."""
    repository = desk.folder / "repository"
    repository.mkdir()
    desk.matrix("repository/small", FEW + RED)
    ran = replace(desk, folder=repository).run("ci", "small.toml", "--shards", "2")
    assert ran.code == 0, ran.err
    platform = GitHub(desk=desk, workflow=read_workflow(ran.out), repository=repository, folder=desk.folder / "actions")

    jobs = platform.run()

    assert platform.results() == dict.fromkeys(jobs, "success"), [job.log for values in jobs.values() for job in values]
    outputs = jobs["plan"][0].outputs
    assert re.fullmatch(r"\d{4}-\d\d", outputs["week"])
    assert outputs == {"count": "2", "shards": "[1, 2]", "week": outputs["week"]}
    assert jobs["plan"][0].summary.startswith("## small: 2 cells in 2 shards\n")
    assert jobs["merge"][0].summary == (platform.artifacts / "small-report" / "report.md").read_text()
    assert "::error" not in jobs["merge"][0].log
    measured = [read(platform.artifacts / f"small-shard-{at}", "measured") for at in (1, 2)]
    assert sorted(sorted(map(bool, shard.values())) for shard in measured) == [[False, True]] * 2
    assert measured[0] != measured[1]
    assert read(platform.artifacts / "small-report", "verdict") == {"good": "works", "blank": "partial"}

    shutil.rmtree(platform.artifacts / "small-shard-2")
    platform.run("merge", "simmatrix")

    lost = next(name for name, instant in measured[1].items() if instant)
    told = [line for line in jobs["merge"][0].log.splitlines() if line.startswith("::error")]
    assert platform.results() == {"plan": "success", "shard": "success", "merge": "failure", "simmatrix": "failure"}
    assert jobs["merge"][0].failed == ["Judge"]
    assert [line.endswith(f"_{lost}::not run") for line in told] == [True], told
    assert jobs["merge"][0].summary.startswith("# small")


def read(folder: Path, key: str) -> dict[str, Any]:
    """Return one key of every cell of a report."""
    cells = json.loads((folder / "report.json").read_text())["cells"]
    return {cell["axes"]["which"]: cell[key] for cell in cells}


def test_slurm(desk: Desk, tmp_path: Path) -> None:
    """Slurm's job fetches with network, its array tasks measure without, and the results are merged."""
    wheels = tmp_path / "wheels"
    shutil.copytree(desk.wheels, wheels)
    online = replace(desk, wheels=wheels, online=True)
    online.matrix("small", FEW)
    assert online.run("ci", "small.toml", "--provider", "slurm", "--shards", "2", "--out", "slurm.sh").code == 0

    submitted = subprocess.run(
        ("bash", "slurm.sh"),
        cwd=tmp_path,
        env=with_slurm(online, gone=wheels) | {"TMPDIR": str(tmp_path), "PARTITION": "long"},
        capture_output=True,
        text=True,
        check=False,
    )

    log = (tmp_path / "job.log").read_text() if (tmp_path / "job.log").exists() else ""
    assert submitted.returncode == 0, submitted.stdout + submitted.stderr + log
    assert submitted.stdout.splitlines()[-1] == (
        f"array job 77 of 2 shards; the report will be {tmp_path}/simmatrix-small/runs/77/merged/report.md"
    )
    assert (tmp_path / "codes").read_text().split() == ["0", "0", "1"], log
    merged = tmp_path / "simmatrix-small" / "runs" / "77" / "merged"
    assert read(merged, "verdict") == {"good": "works", "blank": "partial"}
    first, second = (tmp_path / "sbatch.log").read_text().splitlines()
    assert "--array=1-2" in first
    assert "--partition=long" in first
    assert "--dependency=afterany:77 " in second


def test_slurm_without_all_that_is_needed(desk: Desk, tmp_path: Path) -> None:
    """Nothing is submitted for a matrix of which not all could be fetched."""
    desk.matrix("small", FEW.replace('"fake-healthy"', '"fake-healthy @ http://127.0.0.1:9/none-1.0-py3-none-any.whl"'))
    assert desk.run("ci", "small.toml", "--provider", "slurm", "--out", "slurm.sh").code == 0

    ran = subprocess.run(
        ("bash", "slurm.sh"),
        cwd=tmp_path,
        env=with_slurm(desk, gone=tmp_path / "none") | {"UV_HTTP_RETRIES": "0"},
        capture_output=True,
        text=True,
        check=False,
    )

    assert (ran.returncode, (tmp_path / "sbatch.log").exists()) == (3, False), ran.stdout + ran.stderr
    assert ran.stderr.splitlines()[-1] == (
        "nothing was submitted: the download is incomplete; run this again to continue, "
        "or set INCOMPLETE=1 to submit anyway"
    )


def test_slurm_usage(desk: Desk, tmp_path: Path) -> None:
    """An argument that the script does not know is refused before anything is fetched."""
    desk.matrix("small", SMALL.read_text())
    assert desk.run("ci", "small.toml", "--provider", "slurm", "--out", "slurm.sh").code == 0

    ran = subprocess.run(("bash", "slurm.sh", "shards"), cwd=tmp_path, capture_output=True, text=True, check=False)

    assert (ran.returncode, ran.stderr) == (2, "usage: bash slurm.sh\n")
