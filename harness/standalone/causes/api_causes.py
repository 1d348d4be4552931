"""Derive from the histories of packages which release has the name that was asked for.

Nothing is derived where no release has the name, where all have it, or where the release at hand has it: then the fault
lies elsewhere, perhaps in the user's own code.
"""

from __future__ import annotations

import re
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

from ..explain.api_history import OF_IMPORT, PYTHON, Availability, History
from ..explain.history_words import packages_with
from ..explain.import_names import package_with
from .scene import DOTTED, EVERYBODYS, QUOTE, RARE, WORD, Cause, Causes, Pattern, Scene, requirement_remedy

ATTRIBUTE = Pattern(
    "(?:^|[^\\w'])(?:module )?{0}({1}){0} has no attribute {0}({2}){0}".format(QUOTE, DOTTED, WORD), "has no attribute"
)
UNNAMED = Pattern("cannot import name {0}?({1}){0}?\\s*$".format(QUOTE, WORD), "cannot import name ")
OF_SOME_MODULE = Pattern(
    "{0}module{0} object has no attribute {0}({1}){0}".format(QUOTE, WORD), "object has no attribute"
)
IMPORTED = Pattern(
    "cannot import (?:name )?{0}({2}){0} from (?:partially initialized module )?{0}?({1})".format(QUOTE, DOTTED, WORD),
    "cannot import ",
)
MODULE = Pattern("No module named {0}?({1}){0}?".format(QUOTE, DOTTED), "No module named ")
MEMBER = Pattern("{0}({1}){0} (?:object )?has no attribute {0}({2}){0}".format(QUOTE, DOTTED, WORD), "has no attribute")
REMOVED = Pattern(
    r"\b(?:was|were|been|is|and) removed (?:from [\w. ]+ )?in (?:the )?([A-Z][\w-]*) v?(\d+(?:\.\d+)+)(?![\w.]*\d)",
    " removed ",
)
SCHEMA = Pattern(
    r"XML [Ee]rror: Schema violation: unrecognized (element|attribute)"
    r"(?:: {0}?(\w+){0}?)?(?:\W+Element {0}(\w+){0})?".format(QUOTE),
    "Schema violation",
)
RARE_OWNER = 12
"""Letters of a class's name that two packages seldom share."""

SHORTEST = 5
"""Characters of a name that no line of a user's own has by accident."""

STANDARD = {
    "distutils": ("setuptools", "Python 3.12 removed `distutils`; setuptools contains a copy of it"),
    "pkg_resources": ("setuptools<82", "`pkg_resources` is part of setuptools before 82, and new environments lack it"),
    "setuptools": ("setuptools", "setuptools is not installed: environments of Python 3.12 and newer lack it"),
    "cmake": ("", "the script `cmake` here belongs to a Python package, which an isolated build does not see"),
    "swig": ("", "the script `swig` here belongs to a Python package, which an isolated build does not see"),
    "_tkinter": ("", "this Python was built without tkinter"),
}
"""Modules that came with Python or with every environment, the package that brings them, and why they are missing."""

USUAL = frozenset({"chunk", "distutils", "formatter", "parser", "symbol"})
"""Modules that older Pythons have, and that users have, too, or that a rule of its own is about."""

ELSEWHERE = {
    "cv_bridge": ("ROS", "Install ROS, source its setup.bash, and run the Python that it was built for."),
    "curobo": (
        "cuRobo",
        "Build it from its repository with this Python and torch: `pip install -e . --no-build-isolation`.",
    ),
    "habitat_sim": ("habitat-sim", "Type `conda install -c conda-forge -c aihabitat habitat-sim headless`."),
    "isaacgym": ("Isaac Gym", "Download Preview 4 from NVIDIA's site, and type `pip install -e isaacgym/python`."),
    "moveit_commander": ("ROS", "Install MoveIt, source its setup.bash, and run the Python that it was built for."),
    "pyflex": ("PyFleX", "Compile it as SoftGym explains; the package pyflex of the index is a different one."),
    "pytorch3d": ("PyTorch3D", "Build it, or install a wheel for your torch and Python; its INSTALL.md explains how."),
    "rclpy": ("ROS 2", "Install ROS 2, source its setup.bash, and run the Python that it was built for."),
    "rospy": ("ROS", "Install ROS, source its setup.bash, and run the Python that it was built for."),
}
"""Modules of programs that are not on package indexes: the program, and how to get it."""

TENSORFLOW_1 = frozenset(
    "ConfigProto Session app contrib flags get_default_graph global_variables_initializer layers log placeholder"
    " reset_default_graph set_random_seed to_float variable_scope".split()
)
"""Names that TensorFlow 2 does not have at the top any more (its guide to migration)."""

UPDATE = "Or install a newer release of the package that imports it."
OTHER_REMEDIES: Dict[str, Dict[str, Any]] = {
    "cmake": {
        "text": "Install the system's own: `apt-get install cmake` (or by conda), and remove the script from PATH."
    },
    "swig": {
        "text": "Install the system's own: `apt-get install swig` (or by conda), and remove the script from PATH."
    },
    "_tkinter": {"text": "Install it: `apt-get install python3-tk`, or use a Python from conda or python.org."},
}

FORWARDING = "1.0"
"""The first gymnasium whose wrappers do not forward attributes of the environment that they wrap."""


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause that a history gives: the one package whose releases differ in the name."""
    for rule in (_attribute, _some_module, _module, _member, _schema):
        answers: Dict[str, Cause] = {}
        for what, there in rule(line, scene):
            if there is not None:
                answers.setdefault(there.package, availability_cause(what, there, scene))
        if answers:
            # Of several packages that differ in it, none is accused.
            yield from list(answers.values()) if len(answers) == 1 else ()
            return


Answers = Iterator[Tuple[str, Optional[Availability]]]


def _attribute(line: str, scene: Scene) -> Answers:
    attribute, imported = ATTRIBUTE.search(line), IMPORTED.search(line)
    if attribute:
        module, name = attribute.groups()
    elif imported:
        name, module = imported.groups()
    else:
        name, module = _imported_by_source(line, scene)
    if not module or "depricated_handler" in scene.failure.text:
        return  # PettingZoo's own message, whatever failed
    history = scene.history_with(module)
    if history is None:
        return
    spans = history.spans("names", module, name)
    there = where(history, spans or history.spans("modules", "{}.{}".format(module, name)), scene)
    # A module is no attribute until somebody imports it: then no release is too old.
    is_known = history.spans("names", module) is not None
    if spans or not attribute or not is_known or (there and there.too_new):
        yield "`{}.{}`".format(module, name), there


def _imported_by_source(line: str, scene: Scene) -> Tuple[str, str]:
    """Return the name and the module of a failed import, where only the line of source names the module."""
    match = UNNAMED.search(line)
    source = match and re.search(r"from ([\w.]+) import [^\n#]*\b{}\b".format(match.group(1)), scene.failure.text)
    return (match.group(1), source.group(1)) if match and source else ("", "")


def _some_module(line: str, scene: Scene) -> Answers:
    """Yield where an attribute is of a module that the message does not name, as Python 2 writes it."""
    match = OF_SOME_MODULE.search(line)
    if match is None or len(match.group(1)) < SHORTEST:
        return
    name = match.group(1)
    for package in packages_with("names", name):
        # Any program may have a module with a plain word such as `Monitor`.
        is_rare = re.search(r"[a-z][A-Z]", name) is not None or (len(name) > RARE and "_" in name)
        history = scene.history(package) if is_rare or scene.speaks_of(package, package.replace("-", "_")) else None
        modules = [
            module
            for module, names in (history.plain if history else {}).get("names", {}).items()
            if name in names and "." not in module
        ]
        if history is not None and modules:
            module = min(modules, key=len)
            # No Python of the last ten years writes so: the environment is as old, and its packages are.
            version = scene.versions.get(package, history.versions[history.read[0]])
            yield "`{}.{}`".format(module, name), history.where(history.spans("names", module, name), version)


def _module(line: str, scene: Scene) -> Answers:
    match = MODULE.search(line)
    if match:
        module = match.group(1).rstrip(".")
        history = scene.history_with(module) if "." in module or module not in USUAL else None
        if history is not None and ("." in module or history.package == PYTHON):
            yield "the module `{}`".format(module), where(history, history.spans("modules", module), scene)


def wrapped(line: str, scene: Scene) -> Causes:
    """Yield the cause that a wrapper of gymnasium was asked for an attribute of the environment that it wraps."""
    match = MEMBER.search(line)
    if match is None or "object has no attribute" not in line:
        return
    owner, name = match.group(1).rpartition(".")[2], match.group(2)
    if name.startswith("_") or owner not in WRAPPERS or (scene.installed and "gymnasium" not in scene.installed):
        return
    if owner in OF_GYM_TOO and not (scene.speaks_of("gymnasium") or scene.installed or "gymnasium" in scene.versions):
        text = "the wrapper {} forwards no attributes, and `{}` belongs to the environment inside".format(owner, name)
        way = "Write `env.unwrapped.{}`. gymnasium before 1.0 and most releases of gym forward them.".format(name)
        subject = "gym" if scene.speaks_of("gym") else "wrapper"
        yield from () if name in REMOVED_FROM_GYM else (Cause(subject, text, {"text": way}),)
        return
    history = scene.load("gymnasium")
    is_own = bool(history and any(name in names for path, names in _members(history) if path.endswith("." + owner)))
    if scene.versions.get("gymnasium", FORWARDING).split(".")[0] != "0" and not is_own:
        text = "since {} gymnasium's wrappers forward no attributes, and `{}` belongs to the environment inside".format(
            FORWARDING, name
        )
        way = "Or write `env.unwrapped.{}`.".format(name)
        yield Cause("gymnasium", text, requirement_remedy("gymnasium<{}".format(FORWARDING), way))


OF_GYM_TOO = frozenset({"TimeLimit"})
"""Wrappers of today that gym had from its beginnings on."""

REMOVED_FROM_GYM = frozenset({"configure", "monitor", "seed"})
"""Attributes of all environments that gym removed."""

WRAPPERS = frozenset(
    "OrderEnforcing PassiveEnvChecker TimeLimit Autoreset AutoResetWrapper RecordEpisodeStatistics RecordVideo"
    " FlattenObservation NormalizeObservation NormalizeReward ClipAction RescaleAction TransformObservation"
    " TransformReward FrameStack FrameStackObservation ResizeObservation GrayScaleObservation GrayscaleObservation"
    " HumanRendering RenderCollection FilterObservation TimeAwareObservation AtariPreprocessing ClipReward".split()
)
"""Classes of gymnasium.wrappers that wrap one environment."""


def _members(history: History) -> List[Tuple[str, Any]]:
    return list(history.plain.get("members", {}).items())


def removed(line: str, scene: Scene) -> Causes:
    """Yield the cause that a package says itself that it removed what was asked for, and since when."""
    match = REMOVED.search(line)
    if match is None or "Warning" in line.partition(":")[0]:
        return
    name, version = match.group(1).lower(), match.group(2)
    if scene.load(name) is not None:
        text = "{} removed it in {}, as the message says".format(name, version)
        yield Cause(name, text, requirement_remedy("{}<{}".format(name, version)))


def of_tensorflow(line: str, scene: Scene) -> Causes:
    """Yield the cause that TensorFlow 2 lacks a name of TensorFlow 1."""
    match = ATTRIBUTE.search(line)
    if match and match.group(1) == "tensorflow" and match.group(2) in TENSORFLOW_1:
        text = "TensorFlow 2 has no `tensorflow.{}`, which was part of TensorFlow 1".format(match.group(2))
        way = "Its wheels end with Python 3.7. Or write `tensorflow.compat.v1`, which has most names but contrib."
        yield Cause("tensorflow", text, requirement_remedy("tensorflow<2", way))


def entry_points(line: str, scene: Scene) -> Causes:
    """Yield the cause that entry points are no dictionary any more."""
    match = MEMBER.search(line)
    if match and match.groups() == ("EntryPoints", "get"):
        text = "entry points are no longer a dictionary since importlib-metadata 5.0 and Python 3.12"
        way = "On Python 3.12 install a newer release of the package that reads them, or use Python 3.11."
        yield Cause("importlib-metadata", text, requirement_remedy("importlib-metadata<5", way))


def _member(line: str, scene: Scene) -> Answers:
    match = MEMBER.search(line)
    if match is None:
        return
    owner, name = match.group(1).rpartition(".")[2], match.group(2)
    for history in spoken_of(scene, match.group(1), "members", name):
        classes = [members for path, members in _members(history) if path.rpartition(".")[2] == owner]
        # A class that moved lies at two paths, and only a release that has the class can lack a member of it.
        spans = [span for members in classes for span in members.get(name, ())]
        places = {place for members in classes for each in members.values() for place in places_of(each)}
        if spans and len(classes) <= 3 and scene.is_tied(owner, name, history.package):
            among = sorted(places & set(history.read))
            there = where(history, spans, scene, among)
            # A class that the newest release lacks, or has elsewhere, does not say that the installed one is older.
            if there and (there.too_new or among[-1] == history.read[-1] or history.package in scene.versions):
                yield "`{}.{}`".format(owner, name), there


def _schema(line: str, scene: Scene) -> Answers:
    match = SCHEMA.search(scene.failure.text if "Schema violation" in line else line)
    history = scene.history("mujoco") if match else None
    if match is None or history is None:
        return
    kind, name, element = match.groups()
    if kind == "attribute" and name:
        end = "/{} {}".format(element, name) if element else " {}".format(name)
        entries = [key for key in history.plain.get("schema", {}) if key.endswith(end)]
        what = "the attribute `{}`{}".format(name, " of the element `{}`".format(element) if element else "")
    else:
        wanted = name or element
        entries = [key for key in history.plain.get("schema", {}) if wanted and key.endswith("/{}".format(wanted))]
        what = "the element `{}`".format(wanted)
    places = sorted(
        {
            place
            for key in entries
            for span in history.spans("schema", key) or ()
            for place in range(span[0], span[1] + 1)
        }
    )
    yield what, where(history, [(place, place) for place in places], scene, history.ran)


def misplaced(line: str, scene: Scene) -> Causes:
    """Yield the cause that a model has an element that every release of MuJoCo knows, where it may not stand."""
    match = SCHEMA.search(scene.failure.text if "Schema violation" in line else line)
    history = scene.history("mujoco") if match else None
    if match is None or history is None or match.group(1) != "element":
        return
    name = match.group(2) or match.group(3)
    spans = [each for key, each in history.plain.get("schema", {}).items() if name and key.endswith("/{}".format(name))]
    having = {place for each in spans for first, last in each for place in range(first, last + 1)}
    if having >= set(history.ran) and having:
        text = "every MuJoCo release has the element `{}`; here it is in a place that the schema does not allow".format(
            name
        )
        way = "Move it: a file with whole sections (compiler, asset, worldbody) is included at the top, not in a body."
        yield Cause("model", text, {"text": way})


def absent(line: str, scene: Scene) -> Causes:
    """Yield the cause that a whole package, or a module that came with older Pythons, is missing."""
    match = MODULE.search(line)
    if match is None:
        return
    module = match.group(1).rstrip(".")
    top = module.partition(".")[0]
    # A package that is there may lack one of its modules: then it is not missing.
    package, text = STANDARD.get(module if module.startswith(("setuptools.", "pkg_resources.")) else top, ("", ""))
    if text:
        remedy: Dict[str, Any] = OTHER_REMEDIES.get(module) or (
            requirement_remedy(package, "Or use Python 3.11.") if package else {"text": UPDATE}
        )
        yield Cause(package.partition("<")[0] or "python", text, remedy)
    elif top in ELSEWHERE and (module == top or module.rpartition(".")[2].startswith("_")):
        # Python names the first part that is missing: with a dotted name the program itself is there.
        name, way = ELSEWHERE[top]
        yield Cause(name, "the module `{}` is part of {}, which no package index has".format(top, name), {"text": way})
    elif module.startswith("omni.isaac.orbit"):
        text = "Orbit is called Isaac Lab now: its modules became omni.isaac.lab, and `isaaclab` with Isaac Lab 2.0"
        yield Cause(
            "isaaclab", text, {"text": "Use the Orbit release that the program was written for, or the new names."}
        )
    elif "." not in module and package_with(module):
        name = str(package_with(module))
        yield Cause(
            name,
            "the module `{}` belongs to the package {}, which is not installed for this Python".format(module, name),
            requirement_remedy(name),
        )


# --- what rules share ------------------------------------------------------------------------------------------


def spoken_of(scene: Scene, name: str, kind: str, word: str) -> Iterator[History]:
    """Yield the histories of packages that a dotted name or the traceback names, the innermost first.

    Of a line by itself these are the packages whose releases differ in a word of a kind.
    """
    tops = [name.partition(".")[0]] if "." in name else []
    tops += scene.modules
    if not word and scene.is_pasted:
        tops += [module for module in OF_IMPORT if scene.speaks_of(module)]
    histories = [history for history in map(scene.history_with, tops) if history is not None]
    owner = name.split(".")[-2] if "." in name else ""
    if len(owner) > RARE_OWNER and owner not in EVERYBODYS and not any(_has_class(each, owner) for each in histories):
        elsewhere = [history for history in map(scene.history, packages_with(kind, word)) if history is not None]
        histories += [history for history in elsewhere if _has_class(history, owner)]
    if not histories and scene.is_pasted:
        histories = [history for history in map(scene.history, packages_with(kind, word)) if history is not None]
    seen = set()
    for history in histories:
        if history.package not in seen:
            seen.add(history.package)
            yield history


def _has_class(history: History, owner: str) -> bool:
    return any(path.rpartition(".")[2] == owner for path in history.plain.get("members", {}))


def places_of(spans: Sequence[Any]) -> Iterator[int]:
    """Yield the places of releases that spans cover."""
    return (place for first, last in spans for place in range(first, last + 1))


def where(history: History, spans: Any, scene: Scene, among: Optional[List[int]] = None) -> Optional[Availability]:
    """Return where a name with these spans is to be had, for the version that the text or the environment tells."""
    return history.where(spans, scene.versions.get(history.package), among)


def availability_cause(what: str, there: Availability, scene: Scene) -> Cause:
    """Return the cause that a release lacks a name."""
    if there.after is None:
        text = "{} has {} only since {}, and the installed release is older".format(there.package, what, there.first)
    elif there.first is None:
        text = "{} lacks {} since {}, and the installed release is newer".format(there.package, what, there.after)
    else:
        text = "{} has {} from {} to {}, and the installed release is {}".format(
            there.package, what, there.first, there.last, side(there)
        )
    if there.package == PYTHON:
        remedy = {"python": there.bound[len(PYTHON) :], "text": UPDATE}
        return Cause("python", text.replace(PYTHON, "Python", 1) + _asker(scene, PYTHON), remedy)
    return Cause(there.package, text + _asker(scene, there.package), requirement_remedy(there.bound))


def side(there: Availability) -> str:
    """Return on which side of the releases with a name the installed one is."""
    return "older" if not there.too_new else "older or newer" if "," in there.bound else "newer"


def _asker(scene: Scene, package: str) -> str:
    """Return who asks for it, if it is another package."""
    asking = scene.modules[0] if scene.modules else ""
    history = scene.history_with(asking) if asking else None
    return "; `{}` requires it".format(asking) if asking and (history is None or history.package != package) else ""
