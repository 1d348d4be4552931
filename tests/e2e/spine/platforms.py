"""Stand-ins for the platforms that `ci` makes files for: they run the very scripts of those files.

Of GitHub: jobs in order, each in a fresh checkout, with outputs, summary, artifacts and conditions. Steps that install
on the runner are left out; actions are what they come to (a copy of the repository, a folder of artifacts).
Of Slurm: `sbatch`, which runs each task at once, without network.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import yaml
from commandline import Desk, closed_network

SHELL = ("bash", "--noprofile", "--norc", "-eo", "pipefail")
"""What GitHub starts for `shell: bash`."""

LEFT_OUT = ("python -m pip install ", "sudo apt-get ")


def executable(path: Path, text: str) -> Path:
    """Write a script that can be executed."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def with_simmatrix(desk: Desk, prefix: tuple[str, ...] = ()) -> dict[str, str]:
    """Return variables in which the command `simmatrix` is the version under test."""
    command = " ".join((*prefix, sys.executable, "-m", "harness"))
    folder = executable(desk.folder / "bin" / "simmatrix", f'#!/bin/sh\nexec {command} "$@"\n').parent
    return desk.environment({"PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"})


# --- GitHub ----------------------------------------------------------------------------------------------------


@dataclass(kw_only=True)
class Job:
    """Result, outputs and log of a job."""

    result: str = "success"
    outputs: dict[str, str] = field(default_factory=dict)
    log: str = ""
    summary: str = ""
    failed: list[str] = field(default_factory=list)


@dataclass(kw_only=True)
class GitHub:
    """One run of a workflow; `repository` is what a checkout brings."""

    desk: Desk
    workflow: dict[Any, Any]
    repository: Path
    folder: Path
    jobs: dict[str, list[Job]] = field(default_factory=dict)

    @property
    def artifacts(self) -> Path:
        """Return the folder with the uploaded artifacts, by name."""
        return self.folder / "artifacts"

    def run(self, *names: str) -> dict[str, list[Job]]:
        """Run every job, or some again; those of a matrix once for each of its values."""
        for name, job in self.workflow["jobs"].items():
            if names and name not in names:
                continue
            values = [None]
            if "strategy" in job:
                values = json.loads(self._expanded(job["strategy"]["matrix"]["shard"], {}))
            self.jobs[name] = [self._job(f"{name}-{value}", job, {"matrix.shard": str(value)}) for value in values]
        return self.jobs

    def results(self) -> dict[str, str]:
        """Return the result of each job, for all its matrix values."""
        worst = ("failure", "skipped", "success")
        return {name: min((job.result for job in jobs), key=worst.index) for name, jobs in self.jobs.items()}

    def _job(self, name: str, job: Mapping[str, Any], context: dict[str, str]) -> Job:
        needs = [job.get("needs", [])] if isinstance(job.get("needs"), str) else job.get("needs", [])
        results = [self.results()[needed] for needed in needs]
        context = context | {"join(needs.*.result, ' ')": " ".join(results)}
        condition = job.get("if", "${{ success() }}")
        wanted = {
            "${{ success() }}": all(result == "success" for result in results),
            "${{ always() }}": True,
            "${{ !cancelled() && needs.plan.result == 'success' }}": results[:1] == ["success"],
        }
        if not wanted[condition]:
            return Job(result="skipped")
        place = self.folder / name
        if place.exists():
            shutil.rmtree(place)
        place.mkdir(parents=True)
        (place / ".simmatrix-cache").symlink_to(self.desk.cache)
        done = Job()
        for step in job["steps"]:
            if done.failed and step.get("if") != "${{ !cancelled() }}":
                continue
            if not self._step(step, place, {**job.get("env", {}), **step.get("env", {})}, context, done):
                done.failed.append(step["name"])
        done.result = "failure" if done.failed else "success"
        done.outputs = {key: self._expanded(value, context) for key, value in job.get("outputs", {}).items()}
        return done

    def _step(
        self, step: Mapping[str, Any], place: Path, variables: Mapping[str, str], context: dict[str, str], done: Job
    ) -> bool:
        if "uses" in step:
            action = step["uses"].partition("@")[0].partition("/")[2]
            given = {key: self._expanded(str(value), context) for key, value in step.get("with", {}).items()}
            self._action(action, given, place)
            return True
        if step["run"].startswith(LEFT_OUT):
            return True
        output, summary = place / "output", place / "summary"
        own = {name: self._expanded(value, context) for name, value in variables.items()}
        files = {"GITHUB_OUTPUT": str(output), "GITHUB_STEP_SUMMARY": str(summary)}
        ran = subprocess.run(
            (*SHELL, "-c", step["run"]),
            cwd=place,
            env=with_simmatrix(self.desk, closed_network()) | own | files,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        done.log += ran.stdout
        done.summary = summary.read_text() if summary.exists() else ""
        for line in output.read_text().splitlines() if output.exists() else ():
            key, _, value = line.partition("=")
            context[f"steps.{step['id']}.outputs.{key}"] = value
        return ran.returncode == 0

    def _action(self, name: str, given: Mapping[str, str], place: Path) -> None:
        match name:
            case "checkout":
                shutil.copytree(self.repository, place, dirs_exist_ok=True)
            case "upload-artifact":
                assert given["overwrite"] == "True"
                shutil.copytree(place / given["path"], self.artifacts / given["name"], dirs_exist_ok=True)
            case "download-artifact":
                matches = [one for one in self.artifacts.iterdir() if fnmatch(one.name, given["pattern"])]
                for artifact in matches:  # a single one gets no folder of its own
                    target = place / given["path"] / (artifact.name if len(matches) > 1 else "")
                    shutil.copytree(artifact, target, dirs_exist_ok=True)
            case _:
                assert name in {"setup-python", "cache"}

    def _expanded(self, text: str, context: Mapping[str, str]) -> str:
        """Return the text with its expressions replaced; an unknown expression is an error of the test."""
        outputs = {
            f"needs.{name}.outputs.{key}": value
            for name, jobs in self.jobs.items()
            for key, value in jobs[0].outputs.items()
        }
        replacements = {"runner.os": "Linux", "runner.arch": "X64", **context, **outputs}
        replacements |= {f"fromJSON({name})": value for name, value in replacements.items()}
        replacements |= dict.fromkeys(re.findall(r"hashFiles\([^)]*\)", text), "hash")
        return re.sub(r"\$\{\{ (.*?) \}\}", lambda match: replacements[match[1]], text)


def read_workflow(text: str) -> dict[Any, Any]:
    """Read a workflow file as data."""
    return dict(yaml.safe_load(text))


# --- Slurm -----------------------------------------------------------------------------------------------------

SBATCH = r"""#!/usr/bin/env bash
# Runs a copy of the script for every task at once; before the first one the machine loses what @GONE@ holds.
echo "$*" >> "@FOLDER@/sbatch.log"
if [ -e "@GONE@" ]; then mv "@GONE@" "@GONE@.gone"; fi
tasks=
while [[ $1 == --* ]]; do
    case $1 in --array=1-*) tasks=$(seq "${1##*-}") ;; esac
    shift
done
cp "$1" "@FOLDER@/spooled"
shift
run() { @CLOSED@ bash "@FOLDER@/spooled" "$@"; echo $? >> "@FOLDER@/codes"; }
if [ -z "$tasks" ]; then run "$@" >> "@FOLDER@/job.log" 2>&1; echo "78;cluster"; exit; fi
for task in $tasks; do
    SLURM_ARRAY_JOB_ID=77 SLURM_ARRAY_TASK_ID=$task run "$@" >> "@FOLDER@/job.log" 2>&1
done
echo "77;cluster"
"""


def with_slurm(desk: Desk, gone: Path) -> dict[str, str]:
    """Return variables in which `sbatch` runs tasks without network and without `gone`."""
    words = {"@FOLDER@": str(desk.folder), "@GONE@": str(gone), "@CLOSED@": " ".join(closed_network())}
    text = SBATCH
    for word, meaning in words.items():
        text = text.replace(word, meaning)
    executable(desk.folder / "bin" / "sbatch", text)
    return with_simmatrix(desk)
