"""Draft a matrix of the packages that the legs of a workflow really install, as far as its text shows."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, product

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from harness.ci.drafts.draft import MEASURED, Bundle, Draft
from harness.ci.workflows import Claim, Fate, Leg
from harness.model import replace
from harness.model.vocabulary import HOST

WELL_KNOWN = frozenset({*MEASURED, "numpy", "scipy", "torch", "jax", "tensorflow"})
"""What a value is taken to be a version of, where it was handed to something that cannot be seen into."""

TOOLS = frozenset({"pip", "uv", "build", "setuptools", "wheel", "virtualenv", "tox", "nox", "hatch", "poetry", "twine"})
"""What a workflow installs to install with."""

INSTALL = "install"
_SIGNS = {"==": "", ">=": "from", ">": "above", "<=": "upto", "<": "below", "~=": "like", "!=": "not", "===": ""}
_PYTHON = re.compile(r"3\.\d+(?:\.\d+)?")


@dataclass(frozen=True, kw_only=True, slots=True)
class _Installed:
    """The content of one leg: its Python, its packages with their requirements, and its extras."""

    python: str
    packages: Mapping[str, Requirement]
    extras: tuple[str, ...]

    def pin(self, name: str) -> str | None:
        """Return the version that a package is pinned to; None without a pin, or if the package has extras."""
        only = list(self.packages[name].specifier) if name in self.packages else []
        if len(only) != 1 or only[0].operator != "==" or self.packages[name].extras:
            return None
        try:
            return str(Version(only[0].version))
        except InvalidVersion:
            return None


def of_legs(legs: Sequence[Leg], source: str) -> Draft | None:
    """Return the draft of a matrix with the same combinations, None if no leg can be understood."""
    notes = [*_notes(legs)]
    installs: list[_Installed] = []
    pythons = [_python(leg) for leg in legs]
    for leg, python in zip(legs, pythons, strict=True):
        # A leg that sets up no Python counts only where no leg does: beside others its Python is not known.
        if python is None or (python == HOST and {*pythons} != {HOST}):
            notes.append(f"Left out: {leg.combination}, whose Python is not a version such as 3.11.")
        else:
            installs.append(_Installed(python=python, packages=_packages(leg), extras=leg.extras or ()))
    if not installs:
        return None
    versions = {name: _distinct(each.pin(name) or "" for each in installs) for name in _axes(installs)}
    rest = [_rest(each, versions) for each in installs]
    common = _common(rest)
    bundles = _distinctly([_bundle(requirements, extras, common) for requirements, extras in rest])
    values = {
        "python": _distinct(each.python for each in installs),
        **versions,
        INSTALL: _distinct(bundle.label for bundle in bundles),
    }
    legs_as = [
        {"python": each.python, **{name: each.pin(name) or "" for name in versions}, INSTALL: bundle.label}
        for each, bundle in zip(installs, bundles, strict=True)
    ]
    single_bundle = len(values[INSTALL]) == 1
    if single_bundle:
        common, values = (rest[0][0], rest[0][1]), {name: each for name, each in values.items() if name != INSTALL}
        legs_as = [{name: value for name, value in leg.items() if name != INSTALL} for leg in legs_as]
    return Draft(
        description=f"What {source} really installs",
        pythons=values["python"],
        versions=versions,
        bundles=() if single_bundle else tuple({bundle.label: bundle for bundle in bundles}.values()),
        requirements=common[0],
        extras=common[1],
        excludes=tuple(_missing(values, legs_as)),
        notes=tuple(dict.fromkeys(notes)),
    )


def _notes(legs: Iterable[Leg]) -> Iterator[str]:
    for leg in legs:
        yield from (f"Not taken over: {unread}." for unread in leg.unread)
        for claim in leg.claims:
            if claim.fate is Fate.HANDED_ON and (_find_requirement(claim) or claim.name.startswith("python")):
                yield f"{claim.name} is handed to {claim.why}; it is taken at its word here."


def _python(leg: Leg) -> str | None:
    handed = [c.value for c in leg.claims if c.fate is Fate.HANDED_ON and c.name.lower().startswith("python")]
    named = leg.python or (handed[0] if handed else HOST)
    return named if named == HOST or _PYTHON.fullmatch(named) else None


def _packages(leg: Leg) -> dict[str, Requirement]:
    named = [Requirement(text) for text in leg.requirements]
    named += [
        requirement
        for claim in leg.claims
        if claim.fate is Fate.HANDED_ON and (requirement := _find_requirement(claim))
    ]
    by_name = {canonicalize_name(each.name): each for each in named}
    return {name: each for name, each in by_name.items() if name not in TOOLS}


def _find_requirement(claim: Claim) -> Requirement | None:
    """Return the requirement that a value stands for by its name, such as `numpy-version: ">=2.1"`, if well known."""
    return claim.requirement if claim.requirement and canonicalize_name(claim.requirement.name) in WELL_KNOWN else None


def _axes(installs: Sequence[_Installed]) -> list[str]:
    """Return the packages that every leg pins, not all to the same version."""
    return [
        name
        for name in installs[0].packages
        if all(each.pin(name) for each in installs) and len({each.pin(name) for each in installs}) > 1
    ]


Rest = tuple[tuple[str, ...], tuple[str, ...]]
"""Requirements that are no axis, and extras of the project."""


def _rest(each: _Installed, versions: Mapping[str, object]) -> Rest:
    return tuple(str(made) for name, made in each.packages.items() if name not in versions), each.extras


def _common(rest: Sequence[Rest]) -> Rest:
    requirements, extras = (set.intersection(*(set(each[side]) for each in rest)) for side in (0, 1))
    return (
        tuple(line for line in rest[0][0] if line in requirements),
        tuple(extra for extra in rest[0][1] if extra in extras),
    )


def _bundle(requirements: Sequence[str], extras: Sequence[str], common: Rest) -> Bundle:
    own = tuple(line for line in requirements if line not in common[0])
    added = tuple(extra for extra in extras if extra not in common[1])
    label = "-".join([*map(_label, own), *added]) or "newest"
    return Bundle(label=label[:100].strip("-"), requirements=own, extras=added)


def _distinctly(bundles: Sequence[Bundle]) -> list[Bundle]:
    """Return the bundles with new labels, so that different bundles have different labels."""
    by_content: dict[tuple[tuple[str, ...], tuple[str, ...]], Bundle] = {}
    for bundle in bundles:
        taken = {each.label.casefold() for each in by_content.values()}
        label = next(name for name in _numbered(bundle.label) if name.casefold() not in taken)
        by_content.setdefault((bundle.requirements, bundle.extras), replace(bundle, label=label))
    return [by_content[bundle.requirements, bundle.extras] for bundle in bundles]


def _numbered(label: str) -> Iterator[str]:
    yield label
    yield from (f"{label}.{number}" for number in count(2))


def _label(line: str) -> str:
    """Return a requirement as a label: `numpy-1.26.4` or, for `numpy<2,>=1.21`, `numpy-from1.21-below2`."""
    requirement = Requirement(line)
    bounds = sorted(requirement.specifier, key=lambda each: (each.operator not in {">=", ">"}, str(each)))
    parts = [f"{_SIGNS[each.operator]}{each.version}" for each in bounds]
    return re.sub(r"[^A-Za-z0-9._+-]+", "-", "-".join([canonicalize_name(requirement.name), *parts]))


def _missing(values: Mapping[str, Sequence[str]], legs: Sequence[Mapping[str, str]]) -> Iterator[dict[str, str]]:
    """Yield the combinations that no leg has, by the axes that have more than a single value."""
    for combination in product(*values.values()):
        named = dict(zip(values, combination, strict=True))
        if named not in legs:
            yield {name: value for name, value in named.items() if len(values[name]) > 1}


def _distinct(values: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(values))
