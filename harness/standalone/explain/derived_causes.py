"""Derive the cause of an error from the histories of packages: which release has the name that was asked for.

Nothing is derived where no release has the name, where all have it, or where the release at hand has it: then the fault
lies elsewhere, perhaps in the user's own code.
"""

from __future__ import annotations

import re
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Optional, Tuple

from ..failures.matching import Diagnosis, Signature
from . import conflicts, missing_files, missing_releases
from .api_history import OF_IMPORT, Availability, History, Load, package_of
from .failure_text import QUOTED, Failure
from .import_names import package_with
from .missing_files import MissingFile
from .version_hints import Hints

QUOTE = "[`'\"\u2018\u2019\u201c\u201d]"
WORD = r"[A-Za-z_]\w*"
DOTTED = r"[A-Za-z_][\w.]*"

ATTRIBUTE = re.compile("(?:^|[^\\w'])(?:module )?{0}({1}){0} has no attribute {0}({2}){0}".format(QUOTE, DOTTED, WORD))
IMPORTED = re.compile(
    "ImportError: cannot import name {0}({2}){0} from (?:partially initialized module )?{0}({1}){0}".format(
        QUOTE, DOTTED, WORD
    )
)
MODULE = re.compile("(?:ModuleNotFound|Import)Error: No module named {0}({1}){0}".format(QUOTE, DOTTED))
MEMBER = re.compile(
    "AttributeError: (?:type object )?{0}({1}){0} (?:object )?has no attribute {0}({2}){0}".format(QUOTE, DOTTED, WORD)
)
ARGUMENT = re.compile(
    r"TypeError: ({0})\(\) got an unexpected keyword argument {1}({2}){1}".format(DOTTED, QUOTE, WORD)
)
SCHEMA = re.compile(
    r"XML Error: Schema violation: unrecognized (element|attribute)"
    r"(?:: {0}?(\w+){0}?)?(?:\W+Element {0}(\w+){0})?".format(QUOTE)
)
ENVIRONMENT = re.compile(
    "(?:Environment|No registered env with id:?|No registered environment with (?:name|id):?) ?"
    "{0}?([\\w:./-]+-v\\d+){0}?".format(QUOTE)
)
FRAME = re.compile(r"site-packages[/\\](\w+)[/\\.]|dist-packages[/\\](\w+)[/\\.]")


class Missing(NamedTuple):
    """Something that was asked for and is not there: its name in words, and the package that would have it."""

    line: str
    what: str
    availability: Availability


def derive(
    failure: Failure, hints: Hints, installed: Optional[Mapping[str, str]], python: Optional[str], load: Load
) -> List[Diagnosis]:
    """Return the causes that the histories of packages give for the lines that say why something failed."""
    versions = dict(hints.packages)
    versions.update(installed or {})
    causes: Dict[str, Diagnosis] = {}
    for line in failure.lines or _quoted(failure):
        conflict = conflicts.find(line)
        if conflict is not None:
            causes.setdefault(conflict.package, _cause(line, conflict.package, conflict.cause, conflict.remedy))
        file = missing_files.find(line)
        if file is not None:
            causes.setdefault(file.name, _of_file(line, file))
        release = missing_releases.find(line, versions, python or hints.python, load)
        if release is not None:
            causes.setdefault(release.package, _cause(line, release.package, release.cause, release.remedy))
        for missing in _missing(line, failure, versions, load):
            diagnosis = _diagnosis(missing, failure)
            causes.setdefault(diagnosis.signature.id, diagnosis)
        absent = MODULE.search(line)
        package = package_with(absent.group(1)) if absent and "." not in absent.group(1) else None
        if package is not None and absent is not None:
            cause = "the module `{}` is of the package {}, which this Python does not find".format(
                absent.group(1), package
            )
            causes.setdefault(package, _cause(line, package, cause, {"requirements": [package]}))
    return list(causes.values())


def _quoted(failure: Failure) -> List[str]:
    """Return the lines of a short text in which no exception is named."""
    lines = failure.text.splitlines()
    return lines if len(lines) <= QUOTED else []


def _missing(line: str, failure: Failure, versions: Mapping[str, str], load: Load) -> Iterator[Missing]:
    for rule in (_attribute, _module, _member, _argument, _schema, _environment):
        causes: Dict[str, Missing] = {}
        for what, availability in rule(line, failure, versions, load):
            if availability is not None:
                causes.setdefault(availability.package, Missing(line=line, what=what, availability=availability))
        if causes:
            # Of several packages that differ in it, none is accused.
            yield from list(causes.values()) if len(causes) == 1 else ()
            return


Answers = Iterator[Tuple[str, Optional[Availability]]]


def _attribute(line: str, failure: Failure, versions: Mapping[str, str], load: Load) -> Answers:
    attribute, imported = ATTRIBUTE.search(line), IMPORTED.search(line)
    if attribute:
        module, name = attribute.groups()
    elif imported:
        name, module = imported.groups()
    else:
        return
    history = _history(module, load)
    if history is None:
        return
    spans = history.spans("names", module, name) or history.spans("modules", "{}.{}".format(module, name))
    yield "`{}.{}`".format(module, name), _where(history, spans, versions)


def _module(line: str, failure: Failure, versions: Mapping[str, str], load: Load) -> Answers:
    match = MODULE.search(line)
    if match and "." in match.group(1):
        history = _history(match.group(1), load)
        if history is not None:
            yield (
                "the module `{}`".format(match.group(1)),
                _where(history, history.spans("modules", match.group(1)), versions),
            )


def _member(line: str, failure: Failure, versions: Mapping[str, str], load: Load) -> Answers:
    match = MEMBER.search(line)
    if match is None:
        return
    owner, name = match.group(1).rpartition(".")[2], match.group(2)
    for history in _spoken_of(failure, match.group(1), load):
        paths = [path for path in history.plain.get("members", {}) if path.rpartition(".")[2] == owner]
        having = [history.spans("members", path, name) for path in paths]
        spans = max((item for item in having if item), key=len, default=None)
        if spans and len(paths) <= 3:
            yield "`{}.{}`".format(owner, name), _where(history, spans, versions)


def _argument(line: str, failure: Failure, versions: Mapping[str, str], load: Load) -> Answers:
    match = ARGUMENT.search(line)
    if match is None or "." not in match.group(1):
        return
    function, name = match.groups()
    for history in _spoken_of(failure, function, load):
        for path, texts in history.plain.get("signatures", {}).items():
            if path.endswith("." + function):
                spans = [span[:2] for span in texts if _takes(span[2], name)]
                yield (
                    "the argument `{}` of `{}`".format(name, function),
                    _where(history, spans, versions),
                )


def _takes(parameters: str, name: str) -> bool:
    names = [item.strip("=") for item in parameters.split(", ")]
    return name in names or any(item.startswith("**") for item in names)


def _schema(line: str, failure: Failure, versions: Mapping[str, str], load: Load) -> Answers:
    match = SCHEMA.search(failure.text if "Schema violation" in line else line)
    history = load("mujoco") if match else None
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
    yield what, _where(history, [(place, place) for place in places], versions, history.ran)


def _environment(line: str, failure: Failure, versions: Mapping[str, str], load: Load) -> Answers:
    match = ENVIRONMENT.search(line)
    if match is None or not re.search("Error|Exception|NotFound|No registered", line):
        return
    name = match.group(1).rpartition(":")[2]
    libraries = ("gymnasium", "gym") if "gymnasium" in failure.text else ("gym", "gymnasium")
    for library in libraries:
        history = load(library)
        spans = history.spans("environments", name) if history else None
        if history is not None and spans:
            yield "the environment `{}`".format(name), _where(history, spans, versions, history.ran)


# --- what is found ---------------------------------------------------------------------------------------------


def _history(module: str, load: Load) -> Optional[History]:
    package = package_of(module)
    return load(package) if package else None


def _spoken_of(failure: Failure, name: str, load: Load) -> Iterator[History]:
    """Yield the histories of packages that a dotted name or the traceback names, the innermost first."""
    tops = [name.partition(".")[0]] if "." in name else []
    tops += [first or second for first, second in reversed(FRAME.findall(failure.region))]
    packages = list(dict.fromkeys(filter(None, map(package_of, tops))))
    if not packages and failure.text.count("\n") < QUOTED:
        packages = sorted({*OF_IMPORT.values()})  # of a line by itself, any package whose releases differ in it
    for package in packages:
        history = load(package)
        if history is not None:
            yield history


def _where(
    history: History, spans: Any, versions: Mapping[str, str], among: Optional[List[int]] = None
) -> Optional[Availability]:
    return history.where(spans, versions.get(history.package), among)


def _diagnosis(missing: Missing, failure: Failure) -> Diagnosis:
    there = missing.availability
    package = there.package
    if there.after is None:
        when = "{} has {} since {}".format(package, missing.what, there.first)
    elif there.first is None:
        when = "{} has {} no more since {}".format(package, missing.what, there.after)
    else:
        when = "{} has {} from {} to {}".format(package, missing.what, there.first, there.last)
    cause = "{}; the one at hand is {}{}".format(
        when, "newer" if there.too_new else "older", _asker(failure, there.package)
    )
    return _cause(missing.line, there.package, cause, {"requirements": [there.bound]})


def _of_file(line: str, file: MissingFile) -> Diagnosis:
    ways = []
    if file.debian:
        ways.append("`apt-get install {}` on Debian and Ubuntu".format(file.debian))
    if file.conda:
        ways.append("`conda install -c conda-forge {}`".format(file.conda))
    version = ", perhaps in another version" if file.other else ""
    cause = "the {} `{}` is not on this machine, or not where it is looked for".format(file.kind, file.name)
    return _cause(line, file.name, cause, {"text": "Install it{}: {}.".format(version, " or ".join(ways))})


def _cause(line: str, subject: str, cause: str, remedy: Mapping[str, Any]) -> Diagnosis:
    name = "derived:{}".format(subject)
    signature = Signature(
        plain={"id": name, "cause": cause, "remedy": remedy, "derived": True},
        id=name,
        phases=(),
        pattern=re.escape(line),
        signal=None,
        packages=(),
        python=None,
        masks=False,
        generic=False,
        silent=False,
    )
    return Diagnosis(signature=signature, phase=None, seen=line, is_reason=True)


def _asker(failure: Failure, package: str) -> str:
    """Return who asks for it, if it is another package."""
    frames = [first or second for first, second in FRAME.findall(failure.region)]
    asking = frames[-1] if frames else ""
    return "; `{}` asks for it".format(asking) if asking and package_of(asking) != package else ""
