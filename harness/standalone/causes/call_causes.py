"""Derive from the signatures of releases which of them takes the arguments, or returns the values, that were wanted."""

from __future__ import annotations

import re
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

from ..explain.api_history import Availability, History
from .api_causes import WRAPPERS, places_of, side, spoken_of, where
from .scene import DOTTED, QUOTE, WORD, Cause, Causes, Pattern, Scene, requirement_remedy

UNEXPECTED = Pattern(
    r"({0})\(\) got (?:an unexpected keyword argument|some positional-only arguments passed as keyword arguments:)"
    r" {1}({2}){1}".format(DOTTED, QUOTE, WORD),
    "unexpected keyword argument",
)
LACKING = Pattern(
    r"(?:({0})\(\) )?missing \d+ required (?:positional|keyword-only) arguments?: (.+)".format(DOTTED), "missing "
)
TAKES = Pattern(
    r"({0})\(\) takes (?:from \d+ to )?(\d+) positional arguments? but (\d+)"
    r" (?:positional arguments? \(and \d+ keyword-only arguments?\) )?(?:was|were) given".format(DOTTED),
    "() takes ",
)
UNPACK = Pattern(r"(not enough|too many) values to unpack \(expected (\d)(?:, got (\d))?\)", "values to unpack")
PAIR = Pattern(
    r"expected np\.ndarray \(got tuple\)|detected shape was \(2,\) \+ inhomogeneous part"
    r"|Can't convert non-rectangular Python sequence to Tensor|tuple indices must be integers or slices, not tuple"
    r"|'tuple' object has no attribute '(?:shape|reshape|flatten|dtype|astype|ndim|unsqueeze)'",
    "got tuple", "inhomogeneous part", "non-rectangular", "tuple",
)  # fmt: skip
OBSERVATION = re.compile(r"(?<![A-Za-z])(?:next_)?(?:obs|observations?|states?)(?![A-Za-z])|\.reset\(|from_numpy\(s\)")
ALIKE = 2
"""Packages that may be named for one call."""

RARE = 10
"""Letters of a function's name that few packages have: `reset` and `render` are in every environment."""

SUBCLASSED = frozenset({"gym", "gymnasium"})
"""Packages whose classes everybody derives from: of many that differ in a call, these are the likely ones."""

SPREAD = 3
"""Classes that one word of a line by itself may mean."""

RESET, STEP = re.compile(r"\.reset\("), re.compile(r"\.step\(")
CHECKERS = re.compile(r"[/\\](?:gym|gymnasium|shimmy)[/\\](?:wrappers|utils|core)")
"""Files of wrappers, which expect what the newer interface returns."""


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where a call does not fit the release that is installed."""
    if UNPACK.search(line):
        yield from _unpacked(line, scene)
        return
    if PAIR.search(line):
        yield from _paired(scene)
        return
    answers: Dict[str, Cause] = {}
    for call in _calls(line):
        for history, there in _fitting(call, scene):
            text = _words(call, history, there)
            answers.setdefault(there.package, Cause(there.package, text, requirement_remedy(there.bound)))
    # Of several packages that differ in it, none is accused, unless they changed alike, as gym and gymnasium did.
    if len(answers) > ALIKE:
        answers = {package: cause for package, cause in answers.items() if package in SUBCLASSED}
    sides = {cause.remedy["requirements"][0].partition("<")[1] for cause in answers.values()}
    yield from list(answers.values()) if len(answers) == 1 or (len(answers) == ALIKE and sides == {"<"}) else ()


class Call(NamedTuple):
    """A call that failed: the function, a word of it to look for, which parameters would do, and what was wrong.

    `names` is a parameter that some release has to have by name, for others to be accused of lacking it.
    """

    function: str
    word: str
    admits: Callable[[str], bool]
    what: str
    names: str = ""


def _calls(line: str) -> Iterator[Call]:
    unexpected, lacking, takes = UNEXPECTED.search(line), LACKING.search(line), TAKES.search(line)
    if unexpected:
        function, name = unexpected.groups()
        yield Call(
            function, name, lambda parameters: _takes(parameters, name), "takes the argument `{}`".format(name), name
        )
    elif lacking:
        names = re.findall(r"['\"](\w+)['\"]", lacking.group(2))
        if names:
            what = "can be called without `{}`".format("` and `".join(names))
            yield Call(
                lacking.group(1) or "__init__",
                names[0],
                lambda parameters: not set(names) & set(_required(parameters)),
                what,
            )
    elif takes:
        function, count = takes.group(1), int(takes.group(3))
        what = "takes {} positional arguments, self among them".format(count)
        yield Call(function, "", lambda parameters: _most(parameters) >= count, what)


def _fitting(call: Call, scene: Scene) -> Iterator[Tuple[History, Availability]]:
    """Yield the packages whose releases differ in whether a function may be called so."""
    if "." not in call.function:
        common = call.function != "__init__" and len(call.function) < RARE
        if not call.word or common or not (scene.is_pasted or scene.modules) or scene.is_own:
            return
    kinds = ("parameters", "members") if call.names else ("parameters",)
    for history in (each for kind in kinds for each in spoken_of(scene, call.function, kind, call.word)):
        if scene.is_pasted and "." not in call.function and not _tied(call.word, scene, history):
            continue
        if not scene.is_tied(call.function.split(".")[-2] if "." in call.function else "", call.word, history.package):
            continue
        answers: List[Availability] = []
        for path, texts in history.plain.get("signatures", {}).items():
            if path.endswith("." + call.function):
                there = _of_path(history, texts, call, scene)
                answers += [there] if there is not None else []
        answers += _of_fields(history, call, scene) if not answers else []
        bounds = {each.bound for each in answers}
        if len(bounds) == 1 and (len(answers) <= SPREAD or "." in call.function):
            yield history, answers[0]


def _of_fields(history: History, call: Call, scene: Scene) -> List[Availability]:
    """Return where a class has a field, for a data class: nobody wrote its `__init__` down."""
    owner, _, function = call.function.rpartition(".")
    if not owner or function != "__init__" or not call.names:
        return []
    answers = []
    for path, members in history.plain.get("members", {}).items():
        if path.rpartition(".")[2] == owner.rpartition(".")[2] and call.names in members:
            places = sorted({place for spans in members.values() for place in places_of(spans)} & set(history.read))
            there = where(history, members[call.names], scene, places)
            answers += [there] if there is not None else []
    return answers


def _tied(word: str, scene: Scene, history: History) -> bool:
    """Return whether a word says by itself which package is meant."""
    return scene.speaks_of(history.package, history.package.replace("-", "_")) or (len(word) > 8 and "_" in word)


def _of_path(history: History, texts: Sequence[Any], call: Call, scene: Scene) -> Optional[Availability]:
    wraps = call.function.rpartition(".")[0].rpartition(".")[2] in WRAPPERS
    if call.names and not wraps and not any(call.names in _names(parameters) for _, _, parameters in texts):
        return None
    places = [place for first, last, _ in texts for place in range(first, last + 1) if place in set(history.read)]
    spans = [span[:2] for span in texts if call.admits(span[2])]
    return where(history, spans, scene, places) if places else None


def _items(parameters: str) -> List[str]:
    return [item for item in parameters.split(", ") if item]


def _names(parameters: str) -> List[str]:
    return [item.strip("=") for item in _items(parameters)]


def _takes(parameters: str, name: str) -> bool:
    return name in _names(parameters) or any(item.startswith("**") for item in _items(parameters))


def _required(parameters: str) -> List[str]:
    return [item for item in _items(parameters) if not item.endswith("=") and not item.startswith("*") and item != "/"]


def _most(parameters: str) -> int:
    """Return how many positional arguments may be given, self among them."""
    count = 0
    for item in _items(parameters):
        if item.startswith("*"):
            return 99 if len(item) > 1 and not item.startswith("**") else count
        count += item != "/"
    return count


def _words(call: Call, history: History, there: Availability) -> str:
    name = "`{}`".format(call.function)
    if there.after is None:
        return "{} of {} {} since {}, and the installed release is older".format(
            name, history.package, call.what, there.first
        )
    return "{} of {} {} before {} only, and the installed release is {}".format(
        name, history.package, call.what, there.after, side(there)
    )


# --- what step and reset return ---------------------------------------------------------------------------------


def _unpacked(line: str, scene: Scene) -> Iterator[Cause]:
    """Yield which side is behind where step or reset returns another number of values than was expected.

    Since gym 0.26, and in gymnasium always, step returns five values instead of four, and reset a pair.
    """
    match = UNPACK.search(line)
    if match is None:
        return
    kind, expected = match.group(1), int(match.group(2))
    frames = scene.frames
    source = frames[-1][2] if frames else ""
    bare = scene.is_pasted
    step = bool(STEP.search(source)) or (bare and not RESET.search(scene.failure.text))
    is_spoken_of = RESET.search(scene.failure.text) or scene.speaks_of("reset", "gym", "gymnasium")
    reset = bool(RESET.search(source)) or (bare and is_spoken_of and not STEP.search(scene.failure.text))
    inside = bool(frames) and CHECKERS.search(frames[-1][0]) is not None
    if kind == "too many" and expected == 4 and step:
        text = "step() returns five values since gym 0.26 and in gymnasium, and the code unpacks four"
        way = "Or unpack the new way: `obs, reward, terminated, truncated, info = env.step(action)`."
        yield Cause("gym", text, requirement_remedy("gym<0.26", way))
    elif kind == "not enough" and (expected, match.group(3)) == (5, "4") and step:
        yield _older("step() of the environment returns four values, as before gym 0.26, and five are expected", inside)
    elif kind == "too many" and expected == 2 and reset:
        text = "reset() returned an observation alone, as before gym 0.26, and a pair (observation, info) is expected"
        yield _older(text, inside)


def _paired(scene: Scene) -> Iterator[Cause]:
    """Yield that a pair was taken for an observation, where the source that raised speaks of one."""
    frames = scene.frames
    if OBSERVATION.search("\n".join(frame[2] for frame in frames) if frames else scene.failure.text):
        text = "reset() returns a pair (observation, info) since gym 0.26 and in gymnasium, and the code takes it whole"
        yield Cause("gym", text, requirement_remedy("gym<0.26", "Or write `obs, info = env.reset()`."))


def _older(text: str, inside: bool) -> Cause:
    """Return the cause that an environment has the interface before gym 0.26."""
    if inside:
        way = "Or update the environment's package: gym 0.26 and gymnasium need the new interface."
        return Cause("gym", text + " by the wrapper around it", requirement_remedy("gym<0.26", way))
    way = (
        "Update the package of the environment. If gym's own wrapper raised, `gym<0.26` fits the environment; if your"
        " code raised, it is written for `gym>=0.26`."
    )
    return Cause("gym", text, {"text": way})
