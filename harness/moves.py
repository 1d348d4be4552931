"""Changes that may turn a red cell green, taken from what failed; in parts, to be combined and left out one by one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Any

from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version

from harness import changes
from harness.evidence import causes
from harness.model import Cell, Change, Phase
from harness.signatures import Diagnosis, Evidence
from harness.vocabulary import parsed_requirement, required_name


class Way(StrEnum):
    """Where a change comes from, the least intrusive first."""

    KNOWN = "the remedy of a known failure"
    MISSING = "what is imported and not required"
    OVERLAY = "a repaired release"
    BUILDS = "build requirements of the time"
    DATE = "the index as it stood"
    LOCK = "a combination that works"
    WHEELS = "wheels only"
    VARIABLE = "a variable"
    DISPLAY = "a display"
    PYTHON = "another Python"
    PINS = "another version of what is asked for"


COSTS = {way: float(place) for place, way in enumerate(Way)} | {Way.PYTHON: 20.0, Way.PINS: 40.0}
"""What is tried first is least; of two that cure, the less costly is the smaller change."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Move:
    """A change to try. `why` says in words where it comes from."""

    change: Change
    way: Way
    why: str
    guard: bool = False
    """Whether it keeps big packages from being built here, which is none of what cures."""

    @property
    def cost(self) -> float:
        """How intrusive it is."""
        return COSTS[self.way]


# --- changes and their parts -----------------------------------------------------------------------------------

REPLACING = ("requirements", "constraints", "overrides", "build_constraints")
"""Lists of requirements: a later one on a package replaces an earlier."""


def together(one: Change, other: Change) -> Change:
    """Both changes as one; where they speak of the same, the other has the last word."""
    found: dict[str, Any] = {}
    for each in fields(Change):
        old, new = getattr(one, each.name), getattr(other, each.name)
        if each.name in REPLACING:
            names = set(map(required_name, new))
            found[each.name] = (*(line for line in old if required_name(line) not in names), *new)
        elif isinstance(old, tuple):
            found[each.name] = tuple(dict.fromkeys((*old, *new)))
        elif isinstance(old, Mapping):
            found[each.name] = {**old, **new}
        else:
            found[each.name] = new or old
    return Change(**found)


def parts(change: Change) -> tuple[Change, ...]:
    """The smallest changes that it is made of."""
    found: list[Change] = []
    for each in fields(Change):
        value = getattr(change, each.name)
        single: Iterable[Any] = ()
        if isinstance(value, tuple):
            single = [(line,) for line in value]
        elif isinstance(value, Mapping):
            single = [{name: text} for name, text in value.items()]
        elif value:
            single = [value]
        found += [Change(**{each.name: one}) for one in single]
    return tuple(found)


def of_parts(found: Iterable[Change]) -> Change:
    """The change that is made of these."""
    made = Change()
    for part in found:
        made = together(made, part)
    return made


def without(change: Change, part: Change) -> Change:
    """The change without some of its parts."""
    gone = parts(part)
    return of_parts(one for one in parts(change) if one not in gone)


def in_words(change: Change) -> str:
    """What it does, in a few words."""
    return "; ".join(changes.described(change)) or "nothing"


def empty(change: Change) -> bool:
    """Whether it changes nothing."""
    return change == Change()


# --- what the user asked for -----------------------------------------------------------------------------------


def pins(cell: Cell) -> dict[str, str]:
    """The packages of which the cell asks for one version."""
    found = {}
    for line in (*cell.question.requirements, *cell.question.constraints):
        version = _exact(parsed_requirement(line).specifier)
        if version:
            found[required_name(line)] = version
    return found


def _exact(specifier: SpecifierSet) -> str | None:
    one = list(specifier)
    exact = len(one) == 1 and one[0].operator in {"==", "==="} and not one[0].version.endswith(".*")
    return str(one[0].version) if exact else None


def asked_for(cell: Cell) -> tuple[str, ...]:
    """The packages that it names itself."""
    return tuple(dict.fromkeys(map(required_name, cell.question.requirements)))


def moved(before: Cell, after: Cell) -> tuple[str, ...]:
    """What the user wrote that is not there any more: requirements and bounds that were replaced by others."""

    def said(cell: Cell) -> dict[str, set[str]]:
        found: dict[str, set[str]] = {}
        for line in (*cell.question.requirements, *cell.question.constraints):
            texts = {str(each) for each in parsed_requirement(line).specifier}
            found.setdefault(required_name(line), set()).update(texts)
        return found

    kept = said(after)
    return tuple(name for name, texts in said(before).items() if texts - kept.get(name, set()))


def constraint(cell: Cell, name: str, bound: str) -> str:
    """A bound on a package beside those that the cell has on it already, which stay."""
    lines = [line for line in cell.question.constraints if required_name(line) == name]
    own = [parsed_requirement(line) for line in lines]
    specifiers = SpecifierSet(bound)
    for one in own:
        if one.marker is None:
            specifiers &= one.specifier
    return f"{name}{specifiers}"


def released(cell: Cell, name: str, bound: str) -> Change:
    """The change that asks for other versions of what the cell asks for, whether it does so itself or bounds it."""
    if name in asked_for(cell):
        return Change(requirements=(f"{name}{bound}",))
    return Change(constraints=(f"{name}{bound}",))


# --- known failures --------------------------------------------------------------------------------------------


def known(cell: Cell, found: Iterable[Diagnosis]) -> Iterator[Move]:
    """The remedies of the known failures that fit, the deepest cause first, masks only where nothing else is known.

    What the user wrote stays beside them; where it cannot, it is another version of that which is asked for.
    """
    fitting = {str(one.signature.id): one.signature for one in found}
    for name in causes({each: one.masks for each, one in fitting.items()}):
        change = fitting[name].remedy.change
        if change:
            made, contrary = beside(cell, change)
            yield Move(change=made, way=Way.PINS if contrary else Way.KNOWN, why=f"the remedy of {name}")


def beside(cell: Cell, change: Change) -> tuple[Change, bool]:
    """The change with the bounds that the cell has on the same packages, and whether it is contrary to one of them."""
    made, contrary = [replace(change, requirements=(), constraints=())], False
    asked = {required_name(line): line for line in cell.question.requirements}
    bounds = {required_name(line): line for line in cell.question.constraints}
    for line, plain in (*((one, False) for one in change.requirements), *((one, True) for one in change.constraints)):
        new = parsed_requirement(line)
        name = required_name(line)
        old = [parsed_requirement(lines[name]) for lines in (asked, bounds) if name in lines]
        if new.marker or not old or new.url:
            made.append(Change(constraints=(line,)) if plain else Change(requirements=(line,)))
            continue
        both = new.specifier
        for one in old:
            both &= one.specifier
        clash = both.is_unsatisfiable()
        contrary = contrary or clash
        specifier = new.specifier if clash else both
        extras = sorted(new.extras | {extra for one in old for extra in one.extras})
        listed = f"{new.name}[{','.join(extras)}]" if extras else new.name
        as_bound = plain and (name not in asked or not clash)
        made.append(
            Change(constraints=(f"{name}{specifier}",)) if as_bound else Change(requirements=(f"{listed}{specifier}",))
        )
    return of_parts(made), contrary or bool(set(change.uninstall) & set(asked))


# --- what is imported and not required -------------------------------------------------------------------------

NO_MODULE = re.compile(r"No module named '?([A-Za-z_][\w.]*)'?")
PIP_INSTALL = re.compile(r"pip3? install (?:-U |--upgrade )?[`'\"]?([A-Za-z0-9][\w.-]*(?:\[[\w.,-]+\])?)")
PROVIDERS = {
    "absl": "absl-py", "attr": "attrs", "Box2D": "box2d", "cffi": "cffi", "cloudpickle": "cloudpickle",
    "cv2": "opencv-python-headless", "dateutil": "python-dateutil", "distutils": "setuptools", "git": "gitpython",
    "glfw": "glfw", "google": "protobuf", "h5py": "h5py", "imageio": "imageio", "jax": "jax", "jinja2": "jinja2",
    "lxml": "lxml", "matplotlib": "matplotlib", "mpl_toolkits": "matplotlib", "moviepy": "moviepy", "numpy": "numpy",
    "OpenGL": "pyopengl", "packaging": "packaging", "pandas": "pandas", "PIL": "pillow",
    "pkg_resources": "setuptools<81", "psutil": "psutil", "pygame": "pygame", "requests": "requests",
    "scipy": "scipy", "setuptools": "setuptools", "six": "six", "skimage": "scikit-image", "sklearn": "scikit-learn",
    "termcolor": "termcolor", "tqdm": "tqdm", "tree": "dm-tree", "typing_extensions": "typing-extensions",
    "Xlib": "python-xlib", "yaml": "pyyaml", "zmq": "pyzmq",
}  # fmt: skip
"""Modules that everybody knows, and the requirement that brings them; no other module's provider is ever guessed."""


def missing_modules(evidence: Iterable[Evidence]) -> tuple[str, ...]:
    """The top-level modules that were not found, those told first first."""
    found: dict[str, None] = {}
    told = list(evidence)
    for texts in (*(one.told for one in told), *(one.logs for one in told)):
        for text in texts:
            found |= dict.fromkeys(match[1].partition(".")[0] for match in NO_MODULE.finditer(text))
    return tuple(found)


def providers(module: str, declared: Iterable[str]) -> tuple[str, ...]:
    """The requirements that may bring a module: what is well known, and packages of its name among those declared."""
    same = str(canonicalize_name(module))
    named = [name for name in declared if str(canonicalize_name(name)) == same]
    return tuple(dict.fromkeys((*([PROVIDERS[module]] if module in PROVIDERS else []), *named)))


def brought(cell: Cell, requirement: str) -> Change:
    """The change that adds a package, or bounds one that is asked for already."""
    name, bound = required_name(requirement), str(parsed_requirement(requirement).specifier)
    if name in asked_for(cell):
        return Change(constraints=(constraint(cell, name, bound),))
    return Change(requirements=(requirement,))


def told_to_install(cell: Cell, evidence: Iterable[Evidence]) -> Iterator[Change]:
    """What an error tells to install, where that is an extra of what the cell asks for, or a well-known package."""
    asked = {required_name(line): line for line in cell.question.requirements}
    for one in evidence:
        for text in one.told:
            for match in PIP_INSTALL.finditer(text):
                wanted = parsed_requirement(match[1])
                name = required_name(match[1])
                if name in asked and wanted.extras:
                    old = parsed_requirement(asked[name])
                    extras = ",".join(sorted({*old.extras, *wanted.extras}))
                    yield Change(requirements=(f"{name}[{extras}]{old.specifier}",))
                elif name not in asked and name in {required_name(each) for each in PROVIDERS.values()}:
                    yield Change(requirements=(match[1],))


# --- what may be at fault --------------------------------------------------------------------------------------

IMPORTED_AS = {
    "opencv-python": "cv2", "opencv-python-headless": "cv2", "pyopengl": "OpenGL", "pillow": "PIL", "pyyaml": "yaml",
    "dm-tree": "tree", "scikit-learn": "sklearn", "scikit-image": "skimage", "protobuf": "google", "attrs": "attr",
}  # fmt: skip


def suspects(names: Iterable[str], evidence: Iterable[Evidence]) -> tuple[str, ...]:
    """The packages, those first that are named by the line that says why, then by how often the logs name them."""
    shown = list(evidence)
    told = "\n".join(text for one in shown for text in one.told)
    logs = "\n".join(text for one in shown for text in one.logs)

    def rank(name: str) -> tuple[int, int, str]:
        pattern = re.compile(rf"\b{re.escape(IMPORTED_AS.get(name, name.replace('-', '_')))}\b", re.IGNORECASE)
        return -min(len(pattern.findall(told)), 1), -len(pattern.findall(logs)), name

    return tuple(sorted(names, key=rank))


def named(name: str, evidence: Iterable[Evidence]) -> bool:
    """Whether a line that says why names the package."""
    pattern = re.compile(rf"\b{re.escape(IMPORTED_AS.get(name, name.replace('-', '_')))}\b", re.IGNORECASE)
    return any(pattern.search(text) for one in evidence for text in one.told)


def bound(good: str, bad: str) -> str:
    """The specifier that keeps a package on the good side of two neighbours: `<2`, never `<2.0.0`."""
    return f"<{short(bad)}" if Version(good) < Version(bad) else f">={short(good)}"


def short(version: str) -> str:
    """A version without the zeros at its end."""
    found = Version(version)
    if found.is_prerelease or found.is_postrelease or found.local or found.epoch:
        return version
    numbers = list(found.release)
    while len(numbers) > 1 and numbers[-1] == 0:
        numbers.pop()
    return ".".join(map(str, numbers))


# --- variables -------------------------------------------------------------------------------------------------

DRAWING = re.compile(r"(?i)\b(?:e?gl|opengl|osmesa|glfw|glx|render|mujoco_gl|display|window|sdl|pyglet|x11)")


def variables(cell: Cell, phase: Phase, evidence: Iterable[Evidence], *, here: frozenset[str]) -> Iterator[Move]:
    """Ways of drawing that this machine has (`here`) and the cell does not name, where a failure speaks of drawing."""
    texts = [text for one in evidence for text in one.told]
    if phase is not Phase.RENDER and not any(DRAWING.search(text) for text in texts):
        return
    given = cell.environment
    for way in ("egl", "osmesa"):
        if way in here and given.get("MUJOCO_GL") != way:
            platform = {"PYOPENGL_PLATFORM": way} if "PYOPENGL_PLATFORM" in given or way == "osmesa" else {}
            change = Change(environment={"MUJOCO_GL": way, **platform})
            yield Move(change=change, way=Way.VARIABLE, why=f"drawn by {way}")
    if "PYOPENGL_PLATFORM" in given:
        change = Change(environment={"PYOPENGL_PLATFORM": ""})
        yield Move(change=change, way=Way.VARIABLE, why="the way that each library chooses")
    if given.get("SDL_VIDEODRIVER", "dummy") != "dummy":
        change = Change(environment={"SDL_VIDEODRIVER": "dummy"})
        yield Move(change=change, way=Way.VARIABLE, why="drawn without a window")
    if "display" in here:
        yield Move(change=Change(environment={"DISPLAY": "virtual"}), way=Way.DISPLAY, why="a virtual display")
        change = Change(environment={"DISPLAY": "virtual", "MUJOCO_GL": "glfw"})
        yield Move(change=change, way=Way.DISPLAY, why="a window on a virtual display")
