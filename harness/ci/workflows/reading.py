"""Read a workflow file of GitHub: the jobs that have a matrix, with the claims and the packages of each leg."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from harness.ci.workflows.combinations import Combination, Unreadable, combinations, unmatched_excludes
from harness.ci.workflows.legs import Leg, leg
from harness.model.errors import BadInput
from harness.packages.requirement_files.yaml_texts import readable_yaml

MOST = 256
"""GitHub refuses a matrix of more jobs."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Job:
    """One job with a matrix; `notes` are sentences about the matrix itself, or why it cannot be read."""

    name: str
    legs: tuple[Leg, ...]
    notes: tuple[str, ...]


def read(text: str, file: str) -> tuple[Job, ...]:
    """Read a workflow. Jobs without a matrix are left out; BadInput is raised if no job is left."""
    with readable_yaml(text, file):
        loader = _Loader(text)
        try:
            document = loader.get_single_data()
        finally:
            loader.dispose()
    jobs = document.get("jobs") if isinstance(document, dict) else None
    if not isinstance(jobs, dict):
        message = f"{file}: there are no jobs; is it a workflow of GitHub?"
        raise BadInput(message)
    matrix_jobs = tuple(_job(str(name), job) for name, job in jobs.items() if _matrix(job) is not None)
    if not matrix_jobs:
        message = f"{file}: none of its jobs ({', '.join(map(str, jobs))}) has a strategy.matrix"
        raise BadInput(message)
    return matrix_jobs


def _matrix(job: object) -> object:
    strategy = job.get("strategy") if isinstance(job, dict) else None
    # A whole strategy may be one expression. It is passed on, so that it is reported and not left out in silence.
    return strategy.get("matrix") if isinstance(strategy, dict) else strategy


def _job(name: str, job: Mapping[str, Any]) -> Job:
    matrix = _matrix(job)
    try:
        combos = combinations(matrix)
    except Unreadable as error:
        return Job(name=name, legs=(), notes=(str(error),))
    notes = [*_misread(matrix), *_replaced(combos)]
    notes += [f"exclude[{index}] leaves nothing out" for index in unmatched_excludes(matrix)]  # type: ignore[arg-type]
    if len(combos) > MOST:
        notes.append(f"{len(combos)} combinations are more than the {MOST} that GitHub runs")
    return Job(name=name, legs=tuple(leg(job, each) for each in combos), notes=tuple(dict.fromkeys(notes)))


def _misread(part: object, name: str = "matrix") -> Iterator[str]:
    """Yield a note for each version that YAML takes for a number and shortens, such as 3.10."""
    if isinstance(part, _Number) and part.written != f"{float(part):.15g}":
        yield f"{name}: {part.written} without quotes is the number {float(part):.15g}, which is what GitHub uses"
    if isinstance(part, list):
        for each in part:
            yield from _misread(each, name)
    for key, value in part.items() if isinstance(part, dict) else ():
        yield from _misread(value, name if key in {"include", "exclude"} else str(key))


def _replaced(combos: tuple[Combination, ...]) -> Iterator[str]:
    for each in combos:
        for lost in each.replaced:
            own = ", ".join(f"{name} {value}" for name, value in each.values.items() if name != lost.name)
            yield (
                f"include[{lost.index}] adds no combination: it replaces {lost.name} {lost.before} "
                f"by {lost.after} on {own or 'every combination'}"
            )


class _Number(float):
    """A number with the text that it was written as."""

    written: str


class _Loader(yaml.SafeLoader):
    """YAML 1.2 as GitHub reads it: `on` and `yes` are texts, dates too."""


def _number(loader: _Loader, node: yaml.ScalarNode) -> _Number:
    number = _Number(node.value)
    number.written = node.value
    return number


# Without a table of its own the loader would start from a copy of PyYAML's, which reads YAML 1.1.
_Loader.yaml_implicit_resolvers = {}
for _tag, _pattern, _starts in (
    ("tag:yaml.org,2002:null", r"(?:~|null|Null|NULL|)$", ["~", "n", "N", ""]),
    ("tag:yaml.org,2002:bool", r"(?:true|True|TRUE|false|False|FALSE)$", list("tTfF")),
    ("tag:yaml.org,2002:float", r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?$", list("-+.0123456789")),
    ("tag:yaml.org,2002:merge", r"<<$", ["<"]),
):
    _Loader.add_implicit_resolver(_tag, re.compile(_pattern), _starts)
_Loader.add_constructor("tag:yaml.org,2002:float", _number)
