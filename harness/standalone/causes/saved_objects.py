"""Explain objects that cannot be loaded: saved by another release of a package, another NumPy or another Python."""

from __future__ import annotations

from typing import Optional

from ..explain.import_names import package_with
from .scene import QUOTE, Cause, Causes, Pattern, Scene

UNPICKLED = Pattern(
    r"Can't get attribute {0}(\w+){0} on <module {0}([\w.]+){0}(?: from {0}([^'\"]*){0})?".format(QUOTE),
    "Can't get attribute",
)
NUMPY_MODULE = Pattern(r"No module named {0}numpy\.(_core\b|random\._pickle|core\.\w+){0}?".format(QUOTE), "numpy.")
POINTER = Pattern(r"invalid load key, 'v'", "invalid load key")
LOADER = Pattern(r"load\(\) missing 1 required positional argument: '?Loader'?", "'Loader'", " Loader")
BYTECODE = Pattern(
    r"code\(\) argument \d+ must be \w+, not \w+|code(?:\(\))? (?:expected|takes) at most \d+ arguments"
    r"|unknown opcode|bad marshal data|unsupported pickle protocol: (\d)",
    "code", "opcode", "marshal", "pickle protocol",
)  # fmt: skip
BIT_GENERATOR = Pattern(r"is not a known BitGenerator module", "BitGenerator")
SPACES = Pattern(r"observation_space and action_space were not given, can't verify new environments", "can't verify")
ALGORITHM = Pattern(
    r"The algorithm only supports \(?<class '(gym|gymnasium)\.spaces|The (?:observation|action) space must inherit from"
    r" (gym|gymnasium)\.spaces|environment is of type <class '[\w.]+'>, not a (Gymnasium|Gym) environment",
    "algorithm only supports", "must inherit from", "environment is of type",
)  # fmt: skip


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where an object was saved by, or made for, other packages than those that are here."""
    for rule in (_unpickled, _file, _numpy, _bytecode, _spaces):
        cause = rule(line, scene)
        if cause is not None:
            yield cause
            return


def _unpickled(line: str, scene: Scene) -> Optional[Cause]:
    match = UNPICKLED.search(line)
    package = package_with(match.group(2)) or match.group(2).partition(".")[0] if match else None
    if match is None or package is None or match.group(2).startswith("__"):
        return None
    name, module, place = match.groups()
    if package_with(module) is None and "-packages" not in (place or ""):
        return None  # a module of the user's own
    history = scene.history_with(module)
    spans = history.spans("names", module, name) if history else None
    there = history.where(spans, scene.versions.get(history.package)) if history and spans else None
    text = "the file was saved with another release of {}: `{}.{}` is not in the one that loads it".format(
        package, module, name
    )
    if there is not None:
        return Cause(package, text, {"requirements": [there.bound]})
    return Cause(package, text, {"text": "Load it with the releases of {} and Python that saved it.".format(package)})


def _file(line: str, scene: Scene) -> Optional[Cause]:
    if POINTER.search(line):
        text = "the file is a pointer of Git LFS (`version https://git-lfs...`), not the file itself"
        return Cause(
            "git-lfs", text, {"text": "Install git-lfs, and type `git lfs install; git lfs pull` in its folder."}
        )
    if LOADER.search(line):
        text = "PyYAML 6 requires a loader: `yaml.load(file)` no longer has a default"
        return Cause("pyyaml", text, {"requirements": ["pyyaml<6"], "text": "Or write `yaml.safe_load(file)`."})
    return None


def _numpy(line: str, scene: Scene) -> Optional[Cause]:
    match = NUMPY_MODULE.search(line)
    if match is None:
        if BIT_GENERATOR.search(line):
            text = "the file holds a random generator that another NumPy saved, and this one cannot read it"
            return Cause(
                "numpy", text, {"text": "Load it with the NumPy that saved it: 2 where this is 1, 1 where this is 2."}
            )
        return None
    if match.group(1) == "_core":
        text = "the file was saved, or the package compiled, with NumPy 2, and NumPy 1 is installed"
        return Cause("numpy", text, {"requirements": ["numpy>=2"]})
    if match.group(1) == "core._multiarray_umath":
        text = "NumPy before 1.16 has no such module, or the compiled part of NumPy here is for another Python"
        return Cause("numpy", text, {"requirements": ["numpy>=1.16"], "text": "Or install it again for this Python."})
    if match.group(1) == "random._pickle":
        text = "the file was saved with NumPy 1.17 or newer, and an older NumPy is installed"
        return Cause("numpy", text, {"requirements": ["numpy>=1.17"]})
    return None


def _bytecode(line: str, scene: Scene) -> Optional[Cause]:
    match = BYTECODE.search(line)
    if match is None:
        return None
    if match.group(1):
        text = "the file was saved by a newer Python: pickle protocol {} is unknown here".format(match.group(1))
        return Cause("python", text, {"python": ">=3.8" if match.group(1) == "5" else ">=3.4"})
    text = "the file holds functions that were saved by another Python, whose byte code differs"
    return Cause(
        "python", text, {"text": "Load it with the Python (3.N) that saved it, or pass custom_objects for them."}
    )


def _spaces(line: str, scene: Scene) -> Optional[Cause]:
    match = ALGORITHM.search(line)
    if match is None:
        if SPACES.search(line):
            text = "the saved model's spaces could not be loaded: it was saved with another gym, gymnasium or NumPy"
            way = "Load it with the packages that saved it, or pass custom_objects with both spaces."
            return Cause("stable-baselines3", text, {"text": way})
        return None
    library = next(filter(None, match.groups())).lower()
    if library == "gym":
        text = "this stable-baselines3 is older than 2.0 and knows only gym's spaces; the environment has gymnasium's"
        return Cause("stable-baselines3", text, {"requirements": ["stable-baselines3>=2.0"]})
    text = "stable-baselines3 since 2.0 knows only gymnasium's spaces; the environment has those of gym"
    way = "Or move the environment to gymnasium, or install `shimmy>=2.0`, which adapts it."
    return Cause("stable-baselines3", text, {"requirements": ["stable-baselines3<2.0"], "text": way})
