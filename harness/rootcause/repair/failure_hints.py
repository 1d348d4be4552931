"""Extract hints from a failure: missing modules, packages that may be at fault, another way to render."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress

from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.utils import canonicalize_name

from harness.model import Cell, Change, Phase
from harness.model.vocabulary import parsed_requirement, readers, required_name
from harness.rootcause.repair.candidate_changes import Move, Way, asked_for, constraint
from harness.standalone import keys
from harness.standalone.failures.matching import Evidence

# --- what is imported and not required -------------------------------------------------------------------------

NO_MODULE = re.compile(r"No module named '?([A-Za-z_][\w.]*)'?")
PIP_INSTALL = re.compile(r"pip3? install (?:-U |--upgrade )?[`'\"]?([A-Za-z0-9][\w.-]*(?:\[[\w.,-]+\])?)")
# Python 3.12 dropped distutils, and setuptools brings a stand-in; setuptools 82 dropped pkg_resources.
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
    """Return the top-level modules that were not found; those in the lines that say why come first."""
    modules: dict[str, None] = {}
    evidence_list = list(evidence)
    for texts in (*(one.reasons for one in evidence_list), *(one.logs for one in evidence_list)):
        for text in texts:
            modules |= dict.fromkeys(match[1].partition(".")[0] for match in NO_MODULE.finditer(text))
    return tuple(modules)


def providers(module: str, declared: Iterable[str]) -> tuple[str, ...]:
    """Return the requirements that may provide a module: the well-known one, and declared packages of its name."""
    same = str(canonicalize_name(module))
    named = [name for name in declared if str(canonicalize_name(name)) == same]
    return tuple(dict.fromkeys((*([PROVIDERS[module]] if module in PROVIDERS else []), *named)))


def add_requirement(cell: Cell, requirement: str) -> Change:
    """Return the change that adds a package, or bounds one that is required already."""
    name, bound = required_name(requirement), str(parsed_requirement(requirement).specifier)
    if name in asked_for(cell):
        return Change(constraints=(constraint(cell, name, bound),))
    return Change(requirements=(requirement,))


def find_suggested_installs(cell: Cell, evidence: Iterable[Evidence]) -> Iterator[Change]:
    """Yield the installs that an error suggests: an extra of a required package, or a well-known package."""
    requirements = {required_name(line): line for line in cell.question.requirements}
    for item in evidence:
        for text in item.reasons:
            for match in PIP_INSTALL.finditer(text):
                wanted = parsed_requirement(match[1])
                name = required_name(match[1])
                if name in requirements and wanted.extras:
                    old = parsed_requirement(requirements[name])
                    extras = ",".join(sorted({*old.extras, *wanted.extras}))
                    yield Change(requirements=(f"{name}[{extras}]{old.specifier}",))
                # An error text is no authority: of other packages only well-known ones are installed on its word.
                elif name not in requirements and name in {required_name(each) for each in PROVIDERS.values()}:
                    yield Change(requirements=(match[1],))


# --- bounds that an error names --------------------------------------------------------------------------------

BOUND = re.compile(r"\b([A-Za-z][\w.-]*?)(?:\[[\w.,-]+\])?\s?((?:(?:[<>]=?|==|~=|!=)\s?\d[\w.*]*,?\s?)+)")
"""A package with bounds on its version, as `mujoco<3` and `gymnasium>=0.28.1,<0.30`."""


def bounds(texts: Iterable[str], names: Collection[str]) -> dict[str, SpecifierSet]:
    """Return the bounds that texts name on these packages. The first bound on a package counts."""
    specifiers: dict[str, SpecifierSet] = {}
    for text in texts:
        for name, bound in named_bounds(text):
            if name in names:
                specifiers.setdefault(name, bound)
    return specifiers


def named_bounds(text: str) -> Iterator[tuple[str, SpecifierSet]]:
    """Yield packages with their bounds; `a>=2 or <1` gives two for one package. A pin is not a bound."""
    name = ""
    for match in BOUND.finditer(text):
        name = name if match[1] in {"or", "and"} else str(canonicalize_name(match[1]))
        # A text may look like a bound and be none: `~=2` is not a valid specifier.
        with suppress(InvalidSpecifier):
            specifier = SpecifierSet(match[2].strip(" ,."))
            if name and not all(each.operator == "==" for each in specifier):
                yield name, specifier


def find_unmet_bounds(texts: Iterable[str], versions: Mapping[str, str]) -> dict[str, SpecifierSet]:
    """Return the bounds that texts name and that these versions do not meet."""
    specifiers = bounds(texts, versions)
    return {name: bound for name, bound in specifiers.items() if not bound.contains(versions[name], prereleases=True)}


def format_bound(bound: SpecifierSet) -> str:
    """Return a bound as people write it, the lower end first."""
    return ",".join(sorted(map(str, bound), key=lambda text: (text.startswith("<"), text)))


def subjects(text: str) -> frozenset[str]:
    """Return the packages that a sentence of the resolver bounds; Python is none of them."""
    return frozenset(str(canonicalize_name(match[1])) for match in BOUND.finditer(text)) - {"python"}


# --- what may be at fault --------------------------------------------------------------------------------------

MODULES = {required_name(line): module for module, line in PROVIDERS.items() if required_name(line) not in PROVIDERS}
"""Packages of that table, and the modules that they are imported as, where these are called otherwise."""


def suspects(names: Iterable[str], evidence: Iterable[Evidence]) -> tuple[str, ...]:
    """Return the packages, those in the lines that say why first, then by how often the logs name them."""
    shown = list(evidence)
    reasons = "\n".join(text for one in shown for text in one.reasons)
    logs = "\n".join(text for one in shown for text in one.logs)

    def rank(name: str) -> tuple[int, int, str]:
        module = MODULES.get(name) or keys.MODULES.get(name) or name.replace("-", "_")
        pattern = re.compile(rf"\b{re.escape(module)}\b", re.IGNORECASE)
        return -min(len(pattern.findall(reasons)), 1), -len(pattern.findall(logs)), name

    return tuple(sorted(names, key=rank))


# --- variables -------------------------------------------------------------------------------------------------

DRAWING = re.compile(r"(?i)\b(?:e?gl|opengl|osmesa|glfw|glx|render|mujoco_gl|display|window|sdl|pyglet|x11)")


def variables(
    cell: Cell,
    phase: Phase,
    evidence: Iterable[Evidence],
    *,
    here: frozenset[str],
    installed: Collection[str] | None = None,
) -> Iterator[Move]:
    """Yield ways to render that this machine has (`here`) and the cell does not set, if a failure is about rendering.

    If `installed` is given, no variable is set that no installed package reads.
    """
    texts = [text for one in evidence for text in one.reasons]
    if phase is not Phase.RENDER and not any(DRAWING.search(text) for text in texts):
        return
    for move in _ways(cell.environment, here):
        names = {name for name, value in move.change.environment.items() if value}
        # Every package counts as a reader of DISPLAY, so beside another variable only that other one decides.
        read = [readers(name) for name in names - {"DISPLAY"} or names]
        if installed is None or not names or any(one is None or {*one} & {*installed} for one in read):
            yield move


def _ways(given: Mapping[str, str], here: frozenset[str]) -> Iterator[Move]:
    if "PYOPENGL_PLATFORM" in given:
        change = Change(environment={"PYOPENGL_PLATFORM": ""})
        yield Move(change=change, way=Way.VARIABLE, why="the way that each library chooses")
    for way in ("egl", "osmesa"):
        if way in here and given.get("MUJOCO_GL") != way:
            # Libraries refuse a PYOPENGL_PLATFORM that differs from MUJOCO_GL (`devices/egl_advice.py`).
            # OSMesa always needs it: PyOpenGL may bind itself to GLX first and then has no functions of OSMesa.
            platform = {"PYOPENGL_PLATFORM": way} if "PYOPENGL_PLATFORM" in given or way == "osmesa" else {}
            change = Change(environment={"MUJOCO_GL": way, **platform})
            yield Move(change=change, way=Way.VARIABLE, why=f"drawn by {way}")
    # A cell that does not set it runs with `dummy` already (`this_machine.choose_variables`).
    if given.get("SDL_VIDEODRIVER", "dummy") != "dummy":
        change = Change(environment={"SDL_VIDEODRIVER": "dummy"})
        yield Move(change=change, way=Way.VARIABLE, why="drawn without a window")
    if "display" in here:
        if given.get("SDL_VIDEODRIVER") != "x11":
            change = Change(environment={"SDL_VIDEODRIVER": "x11"})
            yield Move(change=change, way=Way.DISPLAY, why="a window of SDL on a virtual display")
        yield Move(change=Change(environment={"DISPLAY": "virtual"}), way=Way.DISPLAY, why="a virtual display")
        change = Change(environment={"DISPLAY": "virtual", "MUJOCO_GL": "glfw"})
        yield Move(change=change, way=Way.DISPLAY, why="a window on a virtual display")
