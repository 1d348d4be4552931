"""Render a matrix as a workflow for a CI platform or a cluster: plan, balanced shards, a merge that judges."""

from __future__ import annotations

import json
import math
import re
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from enum import StrEnum
from statistics import median

import msgspec

from harness.model import Plan, schema
from harness.model.errors import BadInput
from harness.model.report_types import format_count
from harness.reports.tables.cause_groups import in_order

ACTIONS = "actions.toml"

OLDEST = (3, 11)
"""The Python that the harness needs, as `requires-python` has it."""

TYPICAL = 60.0
"""Seconds of a cell where none was ever recorded: most of it are downloads and the install."""


class Provider(StrEnum):
    """A platform that runs a matrix."""

    GITHUB = "github"
    GITLAB = "gitlab"
    SLURM = "slurm"


TEMPLATES = {Provider.GITHUB: "github.yml.j2", Provider.GITLAB: "gitlab.yml.j2", Provider.SLURM: "slurm.sh.j2"}

MOST_SHARDS = {Provider.GITHUB: 256, Provider.GITLAB: 200, Provider.SLURM: 1001}
"""Jobs that a matrix of GitHub, a `parallel` of GitLab, an array of Slurm (by its default `MaxArraySize`) may have."""

RUNNERS = {Provider.GITHUB: "ubuntu-24.04", Provider.GITLAB: "python:{python}-bookworm", Provider.SLURM: "none"}
"""A machine or an image by name, not `latest`: results belong to a class of machine."""

FOREIGN: Mapping[Provider, tuple[str, ...]] = {
    Provider.GITHUB: (),
    Provider.GITLAB: ("branch",),
    Provider.SLURM: ("branch", "install", "python", "runner"),
}
"""Options of `ci` that mean nothing to a platform."""

LIBRARIES = ("libegl1", "libgl1-mesa-dri", "libglu1-mesa", "libosmesa6", "xvfb")
"""Packages of Debian and Ubuntu that rendering without a screen needs."""


class Action(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One action of GitHub; `commit` was read from a copy of its repository on the day `read`."""

    repository: str
    tag: str
    commit: str | None = None
    read: date | None = None

    def __str__(self) -> str:
        """Return the text that follows `uses: ` in a workflow."""
        if self.commit is None:
            return (
                f"{self.repository}@{self.tag} # by tag: no copy of its repository was at hand to read the commit from"
            )
        return f"{self.repository}@{self.commit} # {self.tag}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Pipeline:
    """The values that fill the template of a workflow.

    `matrix` is the argument of the commands in it: the name of a built-in matrix or a path in the repository. `made_by`
    is the command that makes the workflow. `planning` are the options with which a workflow counts its shards itself
    each time it runs; if a platform cannot, the file has the number of `shards`. `measuring` are the options of `run`.
    `state` distinguishes the caches of one state of the matrix from those of another. Without a snapshot (not `dated`),
    locks change while the matrix does not. `limit` is in minutes.
    """

    matrix: str
    name: str
    made_by: str
    shards: int
    planning: str
    measuring: str
    state: str
    dated: bool
    install: str
    python: str
    branch: str
    runner: str
    limit: int
    fail_on: str


def actions(text: str) -> dict[str, Action]:
    """Read the table of actions."""
    return schema.load_toml(text, dict[str, Action], ACTIONS)


def render(pipeline: Pipeline, template: str, action_table: Mapping[str, Action]) -> str:
    """Return the text of the workflow file: the filled template."""
    from jinja2 import Environment, StrictUndefined  # noqa: PLC0415 - start-up

    environment = Environment(
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        # These are YAML and shell, not HTML: values are checked (`plain`, `words`) or quoted for their place.
        autoescape=False,
        variable_start_string="<<",  # the platforms have their own braces
        variable_end_string=">>",
    )
    environment.filters |= {"quoted": json.dumps, "shell": shlex.quote}
    read = max((action.read for action in action_table.values() if action.read), default=None)
    return environment.from_string(template).render(
        it=pipeline,
        uses=action_table,
        read=read,
        unread=[name for name, action in action_table.items() if action.commit is None],
        libraries=" ".join(LIBRARIES),
        slug=re.sub(r"[^A-Za-z0-9]+", "-", pipeline.name),
    )


# --- shards ----------------------------------------------------------------------------------------------------


def shard_count(cells: Sequence[str], seconds: Mapping[str, float], minutes: int, most: int) -> int:
    """Return the number of shards of so many minutes each that the cells need, if they run one after another.

    `seconds` are recorded ones by id; a cell without counts as the median.
    """
    durations = [seconds[cell] for cell in cells if cell in seconds]
    usual = median(durations) if durations else TYPICAL
    whole = sum(seconds.get(cell, usual) for cell in cells)
    return max(1, min(math.ceil(whole / (60 * minutes)), len(cells), most))


def shard_outputs(count: int) -> str:
    """Return the shards as outputs of a GitHub step: `count`, and `shards` as a JSON list."""
    return f"count={count}\nshards={json.dumps([*range(1, count + 1)])}\n"


def plan_page(plan: Plan, count: int) -> str:
    """Return the plan as Markdown: the values of its axes, and the combinations left out."""
    values = {axis: in_order(cell.axes[axis] for cell in plan.cells if axis in cell.axes) for axis in plan.axes}
    lines = [
        f"## {plan.matrix}: {format_count(len(plan.cells), 'cell')} in {format_count(count, 'shard')}",
        "",
        "| axis | values |",
        "| --- | --- |",
        *(f"| {axis} | {', '.join(found)} |" for axis, found in values.items()),
        "",
        *(f"Out of date: {sentence}.\n" for sentence in plan.stale),
    ]
    if plan.dropped:
        reasons: Counter[str] = Counter()
        for gone in plan.dropped:
            reasons[gone.reason] += gone.count
        lines += [f"<details><summary>{format_count(reasons.total(), 'combination')} left out</summary>", ""]
        lines += [f"- {count}: {reason}" for reason, count in reasons.items()]
        lines += ["", "</details>", ""]
    return "\n".join(lines)


# --- texts that go into a workflow -------------------------------------------------------------------------------

# A quote or an expression could become code in a workflow, and a word that begins with `-` an option.
_PLAIN = re.compile(r"(?!-)[A-Za-z0-9_./+@:-]+( +(?!-)[A-Za-z0-9_./+@:-]+)*")


def plain(text: str, what: str) -> str:
    """Return an option's text for use in a workflow as it is. Raises BadInput if a platform would read more into it."""
    if _PLAIN.fullmatch(text):
        return text
    message = f"{what} {text!r}: a workflow takes letters, digits, spaces and ./+@:_- here, no word that starts with -"
    raise BadInput(message)


def python(text: str) -> str:
    """Return the version of a Python that simmatrix can be installed into. Raises BadInput for any other."""
    if re.fullmatch(r"3\.\d+(\.\d+)?", text) and int(text.split(".")[1]) >= OLDEST[1]:
        return text
    message = f"--python {text}: simmatrix runs on Python {'.'.join(map(str, OLDEST))} or newer; cells on any"
    raise BadInput(message)


def install_words(noted: str | None, release: str) -> str | None:
    """Return the pip arguments for a simmatrix: a commit, an address, or a release. None if only a folder has it.

    `noted` is the text of its direct_url.json (PEP 610), which installers leave of what did not come from an index.
    """
    if noted is None:
        return f"simmatrix=={release}"
    origin = json.loads(noted)
    address, commit = str(origin.get("url", "")), origin.get("vcs_info", {}).get("commit_id")
    if "://" not in address or address.startswith("file:"):
        return None
    return f"git+{address}@{commit}" if commit else address


def words(text: str, what: str) -> str:
    """Return words of a shell, each quoted. Raises BadInput for expressions, which the platform would replace."""
    try:
        tokens = shlex.split(text)
    except ValueError as error:
        message = f"{what} {text!r}: cannot be read as words of a shell: {error}"
        raise BadInput(message) from None
    if not tokens or "\n" in text or "${{" in text:
        message = f"{what} {text!r}: takes words for `pip install` on one line, and no expressions of the platform"
        raise BadInput(message)
    return shlex.join(tokens)
