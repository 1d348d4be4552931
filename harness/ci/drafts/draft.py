"""Draft a matrix, and write its text."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name

from harness.ci.drafts.project import Case, Project
from harness.ci.drafts.suite import SuiteDraft
from harness.model import requirement_texts, schema
from harness.model.vocabulary import HOST, Rule
from harness.reports.template_files import fill

MEASURED = (
    *("gymnasium", "gym", "mujoco", "dm-control", "pybullet", "ale-py", "pettingzoo", "robosuite"),
    *("gymnasium-robotics", "metaworld", "stable-baselines3"),
)
"""Packages whose versions are worth an axis, where a project requires them."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Range:
    """A package axis: the releases that the project says it works with, and what was left out of them, as a note."""

    package: str
    range: str
    rule: Rule
    note: str | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Bundle:
    """One value of the `install` axis: requirements and extras that some legs install and others do not."""

    label: str
    requirements: tuple[str, ...] = ()
    extras: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class Draft:
    """A matrix to be written. `notes` are comments, on what could not be taken over for instance.

    `main` is the Python beside which ranges are varied, where it is not the one in the middle.
    """

    description: str
    pythons: tuple[str, ...] = (HOST,)
    ranges: tuple[Range, ...] = ()
    versions: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    bundles: tuple[Bundle, ...] = ()
    requirements: tuple[str, ...] = ()
    extras: tuple[str, ...] = ()
    excludes: tuple[Mapping[str, str], ...] = ()
    cases: tuple[Case, ...] = ()
    suite: SuiteDraft | None = None
    notes: tuple[str, ...] = ()
    main: str | None = None

    @property
    def baseline(self) -> str | None:
        """Return the Python on which ranges are varied one at a time: `main`, else the middle one, with most wheels."""
        return (self.main or self.pythons[(len(self.pythons) - 1) // 2]) if self.ranges else None


def of_project(project: Project) -> Draft:
    """Draft a matrix of the Pythons and the package versions that a project claims, one of them varied at a time."""
    return Draft(
        description=f"What {project.name} says it works with",
        pythons=project.pythons or (HOST,),
        ranges=tuple(_ranges(project)),
        notes=()
        if project.pythons
        else ("The project does not say which Pythons it is for: this is the one at hand.",),
    )


def _ranges(project: Project) -> Iterator[Range]:
    required: dict[str, Requirement] = {}
    for line in project.dependencies:
        try:
            requirement = requirement_texts.requirement(line)
        except InvalidRequirement:
            continue
        if not requirement.url:
            required.setdefault(canonicalize_name(requirement.name), requirement)
    for name in (name for name in MEASURED if name in required):
        specifier = required[name].specifier
        bounded = any(each.operator in {">=", ">", "~=", "=="} for each in specifier)
        # Without a lower bound a range reaches back to the first release, where one value for each X.Y would be many.
        rule = Rule.LATEST_PATCH if bounded else Rule.LATEST_MINOR
        yield Range(package=name, range=str(specifier) or ">=0", rule=rule)


def text_of(draft: Draft, template: str) -> str:
    """Fill the template (the text of `templates/matrix.toml.j2`)."""
    filters: dict[str, Callable[..., str]] = {
        "toml": schema.toml_value,
        "key": schema.key_path,
        # A note may quote the text of others: a line end in it would end the comment.
        "comment": lambda note: "".join(sign for sign in " ".join(note.split()) if sign.isprintable()),
        "inline": lambda table: ", ".join(
            f"{schema.key_path(key)} = {schema.toml_value(value)}" for key, value in table.items()
        ),
    }
    return fill(template, filters, it=draft)
