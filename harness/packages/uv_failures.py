"""Classify failures of uv: the packages', this machine's or the user's. Written from messages that uv printed.

Only uv's own words decide (its headline, causes and hints); what a build backend printed is quoted, and never taken
for a trouble of the index.
"""

from __future__ import annotations

import re

from msgspec import Struct

from harness.model import Outcome, Phase, Step
from harness.model.errors import UnusableRequirement
from harness.model.machine_trouble import MACHINE_TROUBLE
from harness.standalone.failures.lines import decisive_line, shorten_line, strip_ansi
from harness.standalone.failures.machine_trouble import SHORTAGES

TROUBLE = re.compile(
    r"Failed to fetch|Request failed after|error sending request|dns error|operation timed out"
    r"|lack of valid authentication|returned a 40[13]|network was disabled|Network connectivity is disabled"
    r"|Hash mismatch|Failed to extract archive|Received some unexpected JSON"
    rf"|{SHORTAGES}|No space left|Permission denied|Could not acquire lock|Failed to inspect Python interpreter"
)
"""The index, the network, the disk or the cache: no verdict about packages. A file that is no archive, or not the one
that was locked, is what a broken mirror or a login page serves."""

BAD_INPUT = re.compile(
    r"Couldn't parse requirement|Distribution not found at|Failed to read `--find-links`|Unsupported requirement"
    r"|^(?:error: )?invalid value|Failed to parse: |does not appear to be a Python project"
)
MALFORMED = re.compile(
    r"The wheel is invalid:|`RECORD` file is invalid|Archive contains unacceptable filename"
    r"|unsafe (?:member path|symbolic-link target|hard-link target)|cannot extract unsupported member type"
    r"|failed to open file `[^`]*/\.tmp[^`/]*/[^`/]+\.dist-info/RECORD`"
)
"""Errors of uv about an archive that arrived whole: no index and no disk causes them."""

NO_PROJECT = re.compile(
    r"Failed to (?:download and )?build `[^`]+==[^`]*`\n.*does not appear to be a Python project", re.S
)
"""An sdist of an index without anything to build; a folder of the user's is named by its path."""

URL_REQUIREMENT = re.compile(r"was included as a URL dependency")
FOREIGN = re.compile(r"The \.dist-info directory `([^`]+)` does not start with the normalized package name: (\S+)")
"""A file of another package under this one's name: an index mixed them up, or a build did, which names none of them."""

FOREIGN_METADATA = re.compile(r"returned metadata for the wrong package: expected .* for (\S+), got .* for (\S+)")
"""Metadata of another package: from an index that mixed them up, or from a wheel that is malformed.

uv 0.13.9 does not always look: in 11 of 40 equal resolutions the install was the first to refuse the wheel.
"""

UNKNOWN_TO_INDEX = re.compile(
    r"was not found in the (?:package registry|provided package locations|cache)|has an invalid package format"
)
"""A failed resolution that an index may have caused and mended since."""

OTHER_FILE = (
    "it is not the file that was locked: if the index was wrong then and is right now, lock again "
    "(`simmatrix lock MATRIX --upgrade`)"
)

BUILD = re.compile(
    r"Failed to (?:download and )?build `?([^`\s]+)`?|build backend returned an error|Call to `.*` failed"
)
BUILD_OUTPUT = re.compile(r"^\[(?:stdout|stderr)\]$")
METADATA = re.compile(r"has invalid metadata|could not be parsed|Failed to parse metadata")
SOURCE_BUILD = re.compile(
    r"source distribution|(?:Prepared|Preparing|cached) metadata for|static `PKG-INFO`", re.IGNORECASE
)
UNREADABLE = re.compile(
    r"^WARN `?([^`\s]+)`? has an invalid package format: (.*\b(?:zip|archive|stream)\b.*)", re.MULTILINE
)
NO_VERSION = re.compile(r"there (?:is|are) no versions? of ([A-Za-z0-9][A-Za-z0-9._-]*)")
LEAD = re.compile(r"^\W*(?:error:|cause:)?\s*")
STATEMENT = re.compile(r"^\s*(?:error|cause): ")
DEBUG = re.compile(r"^(?:DEBUG|TRACE|INFO|WARN) ")
WARNING = re.compile(r"^warning: ")


class _UvMessage(Struct, frozen=True, kw_only=True):
    """A message of uv taken apart: its own words, and the output of the build backend that it called."""

    own: tuple[str, ...]
    backend: str

    def __str__(self) -> str:
        return "\n".join(self.own)


def met_source(text: str) -> bool:
    """Return whether uv looked into an sdist (its log is on for `uv_distribution`), be it in the end chosen or not."""
    return any(DEBUG.match(line) and SOURCE_BUILD.search(line) for line in text.splitlines())


def unreadable(text: str) -> str | None:
    """Name a file that uv could not read and passed over, as a cut download leaves it; None if there is none."""
    match = UNREADABLE.search(strip_ansi(text))
    return f"{match[1]} came broken from its index: {shorten_line(match[2])}; try again" if match else None


def unlisted_package(text: str) -> str | None:
    """Return the package that is asked for and of which uv saw no version at all; None if there is none."""
    match = NO_VERSION.search(str(_parse_message(text)))
    return match[1] if match else None


def failure(text: str, phase: Phase) -> Step:
    """Return the step for a failure of uv; `phase` is the phase that called uv.

    Whatever is not known to be about packages is infra: it could not be told. Raises UnusableRequirement for a
    requirement or a setting that uv cannot use.
    """
    words = _parse_message(text)
    own = str(words)
    # First: such texts also hold words of TROUBLE (`Failed to extract archive`) or of BAD_INPUT.
    if MALFORMED.search(own) or NO_PROJECT.search(own):
        return Step(phase=Phase.INSTALL, outcome=Outcome.FAILED, decisive=_places_apart(_plain(words)))
    if BAD_INPUT.search(own):
        message = f"uv cannot use its input: {_plain(words)}; correct the requirement or setting"
        raise UnusableRequirement(message)
    if foreign := FOREIGN.search(own):
        decisive = (
            f"the index hands out another package's file as {foreign[2]} (it holds {foreign[1]}); try again later"
        )
        return Step(phase=phase, outcome=Outcome.INFRA, decisive=decisive)
    if foreign := FOREIGN_METADATA.search(own):
        decisive = (
            f"the metadata of {foreign[1]} are those of {foreign[2]}: the index mixed them up, or a wheel is malformed"
        )
        return Step(phase=phase, outcome=Outcome.INFRA, decisive=f"{decisive}; try again later")
    # Before `_of_packages`: `No solution found` also heads a refused login or a missing network; a hint tells.
    if TROUBLE.search(own):
        return Step(phase=phase, outcome=Outcome.INFRA, decisive=_trouble(words))
    step = _of_packages(words, own, phase)
    unknown = f"uv failed for an unknown reason: {_plain(words)}"
    return step or Step(phase=phase, outcome=Outcome.INFRA, decisive=unknown)


def _of_packages(words: _UvMessage, own: str, phase: Phase) -> Step | None:
    """Return the step for a failure that uv blames on packages; None for any other."""
    # BUILD and METADATA come before `No solution found`, which their texts may hold, too.
    if BUILD.search(own):
        return _build(words)
    if METADATA.search(own):
        return Step(phase=Phase.INSTALL, outcome=Outcome.FAILED, decisive=_metadata(words))
    if URL_REQUIREMENT.search(own):
        return Step(phase=Phase.RESOLVE, outcome=Outcome.FAILED, decisive=_plain(words))
    if "No solution found" in own:
        return Step(phase=Phase.RESOLVE, outcome=Outcome.FAILED, decisive=decisive_line(own))
    if phase is Phase.INSTALL and re.search(r"Failed to install|malformed|has no binary distribution", own):
        return Step(phase=phase, outcome=Outcome.FAILED, decisive=_places_apart(_plain(words)))
    return None


def may_be_mended(step: Step) -> bool:
    """Tell whether a failed resolution may come out otherwise today: an index lacked a page, or had a broken file."""
    return step.phase is Phase.RESOLVE and bool(UNKNOWN_TO_INDEX.search(step.decisive or ""))


def _places_apart(line: str) -> str:
    """Return a line without the random names of folders in uv's cache."""
    return re.sub(
        r"`[^`]*/(?:\.tmp[^`/]*|archive-v\d+/[^`/]+|src)(?:/([^`]*))?`",
        lambda match: f"`{match[1] or 'its source'}`",
        line,
    )


def _parse_message(text: str) -> _UvMessage:
    own: list[str] = []
    backend: list[str] = []
    printed_by_backend = False
    for line in strip_ansi(text).splitlines():
        bare = line.strip()
        if DEBUG.match(line) or WARNING.match(line):
            continue
        if BUILD_OUTPUT.match(bare):
            printed_by_backend = True
        elif bare.startswith("hint: ") or line.startswith("error: "):
            # uv marks no end of the backend's output: its own next hint or headline ends it.
            printed_by_backend = False
        (backend if printed_by_backend else own).append(line)
    return _UvMessage(own=tuple(line for line in own if line.strip()), backend="\n".join(backend))


def _build(words: _UvMessage) -> Step:
    """Return the step of an sdist whose metadata could not be made, or whose build requirements have no solution."""
    if "No solution found" in str(words):
        package = BUILD.search(str(words))
        named = f"{package[1]}: " if package and package[1] else ""
        line: str | None = f"{named}no solution for its build requirements: {_last_cause(words)}"
    else:
        line = decisive_line(words.backend) if words.backend.strip() else _plain(words)
    trouble = MACHINE_TROUBLE.search(f"{line}\n{words.backend}")
    return Step(
        phase=Phase.INSTALL,
        outcome=Outcome.INFRA if trouble else Outcome.FAILED,
        decisive=shorten_line(line or _plain(words)),
    )


def _metadata(words: _UvMessage) -> str:
    """Return the metadata line that uv cannot parse; uv puts it into a hint of several lines."""
    start = next((n for n, line in enumerate(words.own) if "could not be parsed" in line), 0)
    lines = [re.sub(r"^hint: ", "", line.strip()) for line in words.own[start:]]
    return shorten_line("\n".join(line for line in lines if line.strip("^ ~")))


def _trouble(words: _UvMessage) -> str:
    """Return the hint with the index's answer, else the first line and the last cause, the system's own word."""
    hints = [line for line in words.own if line.startswith("hint: ") and TROUBLE.search(line)]
    if hints:
        return shorten_line(hints[0].removeprefix("hint: "))
    statements = [line for line in words.own if STATEMENT.match(line)] or words.own
    lines = [LEAD.sub("", line).strip() for line in statements]
    if any("Hash mismatch" in line for line in lines):
        return shorten_line(f"{lines[0]}: {lines[-1]}; {OTHER_FILE}")
    return shorten_line(": ".join(dict.fromkeys((lines[0], lines[-1]))) if lines else "uv printed nothing")


def _last_cause(words: _UvMessage) -> str:
    causes = [LEAD.sub("", line).strip() for line in words.own if "Because" in line]
    return causes[-1] if causes else _plain(words)


def _plain(words: _UvMessage) -> str:
    """Return all of uv's own words but hints, in one line."""
    lines = [LEAD.sub("", line).strip() for line in words.own if not line.startswith("hint: ")]
    return shorten_line(": ".join(line.rstrip(":") for line in lines if line.strip("^ ~")) or "no word")
