"""Find the reason why pip, uv, conda or poetry gave up, in one line."""

from __future__ import annotations

import re
from typing import List, Optional, Sequence

from ..failures.lines import decisive_line, shorten_line

CONFLICT = re.compile(r"^ERROR: Cannot install (.+) because these package versions have conflicting dependencies")
NOT_FOUND = re.compile(
    r"^(ERROR: Could not find a version that satisfies the requirement .+?)(?: \(from versions: .*)?$"
)
OTHER_PYTHON = re.compile(r"^ERROR: Package '.+' requires a different Python: ")
NOT_FITTING = re.compile(r"^(?:ERROR: )?(\S+ \S+ (?:requires|depends on) .+, but you(?:'ll)? have .+)$")
CONDA = re.compile(
    r"^\s*(?:Lib[Mm]amba)?(?:UnsatisfiableError|PackagesNotFoundError|ResolvePackageNotFound|SolverError)\b"
    r"|^error\s+libmamba Could not solve"
)
BACKEND = re.compile(r"^Call to `|build backend returned")
"""What uv says where a build says why."""

UV_CAUSE = re.compile(r"^\s+(?:cause|Caused by): (.*)")
POETRY = re.compile(r"version solving failed")


def installer(lines: Sequence[str]) -> Optional[str]:
    """Return the reason why a resolver or installer gave up, in one line; None if there is none."""
    rules = (_pip_conflict, _conda, _poetry, _pip_not_found, _uv, _uv_causes, _not_fitting)
    reasons = (rule(lines) for rule in rules)
    return next((shorten_line(line) for line in reasons if line), None)


def _pip_conflict(lines: Sequence[str]) -> Optional[str]:
    """Return pip's conflict in one line: the packages that conflict, and what each of them requires."""
    place = next((n for n, line in enumerate(lines) if CONFLICT.match(line)), None)
    if place is None:
        return None
    cause = next((n for n in range(place, len(lines)) if lines[n].startswith("The conflict is caused by:")), None)
    details = [] if cause is None else _paragraph(lines[cause + 1 :])
    return (
        "{} conflict: {}".format(_extract_group(CONFLICT, lines[place]), "; ".join(details))
        if details
        else lines[place]
    )


def _extract_group(pattern: re.Pattern[str], line: str) -> str:
    match = pattern.match(line)
    return match.group(1) if match else line


def _pip_not_found(lines: Sequence[str]) -> Optional[str]:
    messages = (_extract_group(NOT_FOUND, line) for line in lines if NOT_FOUND.match(line))
    return next((line for line in lines if OTHER_PYTHON.match(line)), next(messages, None))


def _not_fitting(lines: Sequence[str]) -> Optional[str]:
    return next((_extract_group(NOT_FITTING, line) for line in lines if NOT_FITTING.match(line)), None)


def _conda(lines: Sequence[str]) -> Optional[str]:
    place = next((n for n, line in enumerate(lines) if CONDA.match(line)), None)
    if place is None:
        return None
    rest = [line for line in lines[place + 1 :] if not line.startswith(("Could not solve", "The following packages"))]
    start = next((n for n, line in enumerate(rest) if line.strip()), len(rest))
    details = _paragraph(rest[start:])
    return "{} {}".format(lines[place].strip(), "; ".join(one.lstrip("- ") for one in details)).strip()


def _poetry(lines: Sequence[str]) -> Optional[str]:
    place = next((n for n, line in enumerate(lines) if POETRY.search(line)), None)
    if place is None:
        return None
    start = next((n for n in range(place, -1, -1) if lines[n].lstrip().startswith("Because")), place)
    return " ".join(line.strip() for line in lines[start : place + 1])


def _uv(lines: Sequence[str]) -> Optional[str]:
    if any("No solution found" in line for line in lines):
        return decisive_line("\n".join(lines))
    return next((line.strip() for line in lines if "we can conclude that your requirements are unsat" in line), None)


def _uv_causes(lines: Sequence[str]) -> Optional[str]:
    """Return uv's headline and the last of its causes, which is the system's own message; None without causes."""
    places = [n for n, line in enumerate(lines) if line.startswith("error: ")]
    for place in places:
        causes = []
        for line in lines[place + 1 :]:
            cause = UV_CAUSE.match(line)
            if not cause:
                break
            causes.append(cause.group(1))
        if causes and not BACKEND.search(causes[-1]):
            return "{}: {}".format(lines[place][len("error: ") :], causes[-1])
    return None


def _paragraph(lines: Sequence[str]) -> List[str]:
    end = next((n for n, line in enumerate(lines) if not line.strip()), len(lines))
    return [line.strip() for line in lines[:end]][:12]
