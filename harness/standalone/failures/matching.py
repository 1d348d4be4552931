"""Match known failures against the output of a failure, the deepest cause first.

A known failure is looked at by its attributes only: those of `Signature` here, or of the host's `signatures.Signature`.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import (
    Any,
    Callable,
    Dict,
    Iterable,
    Iterator,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Tuple,
    TypeVar,
)

from ..requirements import named, requirement
from ..versions import canonical, specifiers, unsatisfiable
from . import literals
from .lines import shorten_line

PHASES = ("resolve", "install", "import", "single", "vector", "render", "behave", "interop", "suite")
"""In this order."""
PROBED = frozenset(PHASES[2:])

K = TypeVar("K")


class Signature(NamedTuple):
    """A known failure, `plain` as its file has it. Each of its packages is a list of requirements: one has to hold."""

    plain: Mapping[str, Any]
    id: str
    phases: Tuple[str, ...]
    pattern: Optional[str]
    signal: Optional[str]
    packages: Tuple[Tuple[str, ...], ...]
    python: Optional[str]
    masks: bool
    generic: bool
    silent: bool
    envs: Tuple[str, ...] = ()
    apis: Tuple[str, ...] = ()
    check: Optional[str] = None
    opengl: bool = False
    code: Optional[str] = None
    ties: Tuple[str, ...] = ()

    @property
    def wording(self) -> Optional[str]:
        """Return the pattern for texts of which nothing else is known."""
        return self.pattern

    @property
    def loud(self) -> bool:
        """Return whether it can be recognised by its output or its signal."""
        return bool(self.pattern or self.signal)


def read(plain: Mapping[str, Any]) -> Signature:
    """Make a known failure of its keys in a file of signatures."""
    parts = (each if isinstance(each, (list, tuple)) else [each] for each in plain.get("packages", ()))
    ties = plain.get("ties", ())
    return Signature(
        plain=plain,
        id=plain["id"],
        phases=tuple(plain.get("phases", ())),
        pattern=plain.get("pattern"),
        signal=plain.get("signal"),
        packages=tuple(map(tuple, parts)),
        python=plain.get("python"),
        masks=bool(plain.get("masks")),
        generic=bool(plain.get("generic")),
        silent=bool(plain.get("silent")),
        envs=tuple(plain.get("envs", ())),
        apis=tuple(plain.get("apis", ())),
        check=plain.get("check"),
        opengl=bool(plain.get("opengl")),
        ties=(ties,) if isinstance(ties, str) else tuple(ties),
    )


def diagnosis(signature: Any, phase: Optional[str] = None, seen: str = "") -> Dict[str, Any]:
    """Return a known failure as documents hold it, with the phase that it shows in, and the line that showed it."""
    plain = signature.plain
    return {
        "signature": signature.id,
        "cause": plain["cause"],
        "remedy": dict(plain.get("remedy", {})),
        "proven": False,
        "proof": None,
        "masks": signature.masks,
        "references": list(plain.get("references", ())),
        "generic": signature.generic,
        "phase": phase,
        "seen": seen,
    }


class Evidence(NamedTuple):
    """Evidence of one failure. `reasons` are the lines that say why, `logs` all other output.

    `phase` is None where that is not known: then it may be any. `observed` is what our own of these lines say, as codes
    and data; None where there are only texts.
    """

    phase: Optional[str]
    reasons: Tuple[str, ...] = ()
    logs: Tuple[str, ...] = ()
    signal: Optional[str] = None
    observed: Optional[Tuple[Any, ...]] = None


class Around(NamedTuple):
    """The context of a failure: `installed` versions if anything was installed, else `requirements`."""

    installed: Optional[Mapping[str, str]] = None
    requirements: Tuple[str, ...] = ()
    python: Optional[str] = None


class Diagnosis(NamedTuple):
    """A known failure that fits. `seen` is the line that shows it; without `is_reason`, it is in the log only."""

    signature: Any
    phase: Optional[str]
    seen: str
    is_reason: bool

    @property
    def masks(self) -> bool:
        """Return whether it hides another failure."""
        return bool(self.signature.masks)

    @property
    def generic(self) -> bool:
        """Return whether it speaks of a line in general."""
        return bool(self.signature.generic)

    @property
    def name(self) -> str:
        """Return the id of the known failure."""
        return str(self.signature.id)

    @property
    def rank(self) -> Tuple[Any, ...]:
        """Return a sort key, least for the deepest cause.

        A mask comes last. Causes in packages come before those of the machine, specific ones before generic
        ones, and those in lines that say why before those in logs.
        """
        return rank(self.signature, not self.is_reason, _order(self.phase))


def is_bounded(part: Sequence[str]) -> bool:
    """Return whether each of these requirements names versions."""
    return all(requirement(text).specifiers for text in part)


def rank(signature: Any, *nearness: int) -> Tuple[Any, ...]:
    """Return the sort key of a known failure that fits: the deepest cause first, of equal ones the nearest."""
    return (signature.masks, not signature.phases, signature.generic, *nearness)


def _order(phase: Optional[str]) -> int:
    return PHASES.index(phase) if phase else len(PHASES)


def diagnose(signatures: Iterable[Any], evidence: Sequence[Evidence], around: Around) -> Tuple[Diagnosis, ...]:
    """Return the known failures that fit, each once, the deepest cause first; equal ones by what failed first."""
    look = build_look(around)
    candidates: List[Tuple[Any, int, Diagnosis]] = []
    for signature in signatures:
        if signature.loud and _fits(signature, around, look):
            hits = [
                (hit.rank, place, hit) for place, hit in enumerate(_hit(signature, each) for each in evidence) if hit
            ]
            hits = [each for each in hits if not _beside_the_point(each[2])]
            if hits:
                candidates.append(min(hits, key=lambda each: each[:2]))
    return tuple(hit for _, _, hit in sorted(candidates, key=lambda each: each[:2]))


def _beside_the_point(hit: Diagnosis) -> bool:
    """Return whether a mask is only mentioned in a log, though an exception says why.

    In other phases it counts: what installers say stands in their logs alone.
    """
    return hit.signature.masks and not hit.is_reason and hit.phase in PROBED


def lurking(signatures: Iterable[K], around: Around) -> Tuple[K, ...]:
    """Return the silent failures that the installed packages run into: all their packages are there."""
    silent = [one for one in signatures if one.silent]  # type: ignore[attr-defined]
    look = build_look(around) if silent else None
    return tuple(one for one in silent if look and _of_python(one, around) and _standing(one, look))


def matches(signatures: Iterable[Any], evidence: Any) -> Iterator[Diagnosis]:
    """Yield the known failures that the evidence shows, whatever is installed, in their order."""
    for signature in signatures:
        hit = _hit(signature, evidence)
        if hit:
            yield hit


def check_packages(signatures: Sequence[Any], around: Any) -> List[Optional[bool]]:
    """Return whether the packages that take part in each are there; None where that cannot be told of all of them."""
    look = build_look(around)
    return [_standing(one, look) for one in signatures]


def _hit(signature: Any, evidence: Any) -> Optional[Diagnosis]:
    """Return the hit of a known failure in the evidence; None if it does not fit."""
    if signature.phases and evidence.phase is not None and evidence.phase not in signature.phases:
        return None
    if signature.signal and signature.signal != evidence.signal:
        return None
    if signature.wording is None:
        return Diagnosis(signature, evidence.phase, "killed by {}".format(signature.signal), is_reason=True)
    return _by_code(signature, evidence) or _by_pattern(signature, evidence)


def _by_code(signature: Any, evidence: Any) -> Optional[Diagnosis]:
    """Return the hit of the observation that has the code and data of this failure; None without one."""
    for each in evidence.observed or () if signature.code else ():
        if signature.observes(each.observed):
            return Diagnosis(signature, evidence.phase, shorten_line(each.line), is_reason=each.is_reason)
    return None


def _by_pattern(signature: Any, evidence: Any) -> Optional[Diagnosis]:
    """Return the hit of the text that the failure's pattern finds; None without one.

    If there are only texts, a pattern that finds our own sentences, too, is used.
    """
    pattern = signature.wording if evidence.observed is None else signature.pattern
    for is_reason, texts in ((True, evidence.reasons), (False, evidence.logs)):
        for text in texts if pattern else ():
            match = search(pattern, text)
            if match:
                return Diagnosis(signature, evidence.phase, _line(text, match), is_reason=is_reason)
    return None


@lru_cache(maxsize=None)
def compile_once(pattern: str) -> re.Pattern[str]:
    """Return a pattern, compiled once."""
    # `literals.clauses` parses with the same flag; a pattern that ignored case only here would lose matches.
    return re.compile(pattern, re.MULTILINE)


def search(pattern: str, text: str) -> Optional[re.Match[str]]:
    """Find a pattern; in most texts its literals are missing, which is seen quickly."""
    return compile_once(pattern).search(text) if literals.possible(pattern, text) else None


def _line(text: str, match: re.Match[str]) -> str:
    """Return the line on which a match ends; of a traceback and its exception that is the exception."""
    start = text.rfind("\n", 0, max(match.end() - 1, 0)) + 1
    stop = text.find("\n", match.end())
    return shorten_line(text[start : stop if stop >= 0 else len(text)])


# --- packages --------------------------------------------------------------------------------------------------

Look = Callable[[str], Optional[bool]]
"""Whether the package that a requirement names is there in such a version; None where that is not known."""


def _fits(signature: Any, around: Any, look: Look) -> bool:
    """Return whether packages and Python allow this failure.

    Unknown packages do not speak against it, but a generic failure needs all of them to fit.
    """
    if not _of_python(signature, around):
        return False
    holds = _standing(signature, look)
    return holds is True if signature.generic else holds is not False


def _of_python(signature: Any, around: Any) -> bool:
    return not (signature.python and around.python) or specifiers(signature.python).admits(around.python)


def _standing(signature: Any, look: Look) -> Optional[bool]:
    """Return whether each part holds: one at least of its requirements."""
    results = [_any([look(text) for text in part]) for part in signature.packages]
    return False if False in results else None if None in results else True


def _any(results: List[Optional[bool]]) -> Optional[bool]:
    """Return whether one of several holds; None where that cannot be told."""
    return True if True in results else None if None in results else False


def build_look(around: Any) -> Look:
    """Return a function that tells whether a requirement holds; it returns None if that is unknown."""
    if around.installed is not None:
        installed = {canonical(name): version for name, version in around.installed.items()}
        return lambda text: _installed(text, installed)
    constraints: Dict[str, List[Any]] = {}
    for text in around.requirements:
        constraints.setdefault(requirement(text).name, []).append(requirement(text).specifiers)
    return lambda text: _asked_for(text, constraints)


def _installed(text: str, installed: Mapping[str, str]) -> bool:
    if named(text) not in installed:
        return False
    wanted = requirement(text)
    return wanted.name in installed and wanted.specifiers.admits(installed[wanted.name])


def _asked_for(text: str, constraints: Mapping[str, List[Any]]) -> Optional[bool]:
    if named(text) not in constraints:
        return None
    wanted = requirement(text)
    # A requirement is a range, so it speaks against a failure only if no version is left for both.
    return not unsatisfiable([wanted.specifiers, *constraints[wanted.name]])
