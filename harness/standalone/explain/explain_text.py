"""Explain a text of unknown origin: the deepest known cause, other possible causes, and matching measurements."""

from __future__ import annotations

import re
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from ..causes.derived_causes import derive
from ..failures import matching
from ..failures.counting import select_counting
from ..failures.lines import MASKS, shorten_line
from ..failures.machine_trouble import SHORTAGES, UNREACHABLE
from ..failures.matching import Around, Diagnosis
from ..failures.ties import is_refuted, is_tied, mentions_packages
from ..requirements import named
from ..versions import specifiers, unsatisfiable
from .api_history import Load, no_history
from .cause_order import DECISIVE, find_hits, is_in, place_of, with_derived
from .failure_text import QUOTED, START, Failure, read_failure
from .mentions import is_mention
from .version_hints import Hints, hints

NOTE, WARNING = "note", "warning"
CHANGING = re.compile(r"\bline \d+|0x[0-9a-f…]+|\d+(?:\.\d+)+|(?:/[\w.+-]+){2,}")
"""What differs in two lines about the same failure."""

TROUBLE = re.compile(
    r"{}|{}|dns error|Request failed after|Connection refused|NewConnectionError|ReadTimeoutError".format(
        SHORTAGES, UNREACHABLE
    )
)
"""What a machine or a network lacks: no verdict about packages."""

MENTION = "also mentioned in the log, but probably not the cause: {} ({})"
SHOWN, LIKELY = 3, 2
INSTALLING = ("resolve", "install")


class Facts(NamedTuple):
    """Facts known besides the text: the packages and the Python of an environment, and how a command ended.

    `requirements` are the requirements that a command line names. `failed` is whether it surely failed. `measured` is
    the document of measured results, `history` returns the history of a package.
    """

    installed: Optional[Mapping[str, str]] = None
    requirements: Tuple[str, ...] = ()
    python: Optional[str] = None
    failed: bool = False
    signal: Optional[str] = None
    measured: Optional[Mapping[str, Any]] = None
    history: Load = no_history


NOTHING = Facts()


class Explanation(NamedTuple):
    """An explanation. `diagnoses` are known causes, the deepest first; `findings` are further remarks."""

    failure: Failure
    hints: Hints
    diagnoses: Tuple[Diagnosis, ...]
    findings: Tuple[Tuple[str, str, str], ...]

    @property
    def phase(self) -> Optional[str]:
        """Return the phase that failed: the one that the text suggests, unless the cause shows only in others."""
        cause = _deepest(self.diagnoses)
        if cause is not None and cause.signature.phases and self.failure.phase not in cause.signature.phases:
            return str(cause.signature.phases[0])
        return self.failure.phase

    @property
    def causes(self) -> Tuple[Diagnosis, ...]:
        """Return the causes that count, the deepest first; none if another process died and nothing says why."""
        failure, echoed = self.failure, self.echoed
        return select_counting(self.diagnoses, lambda hit: not echoed and place_of(hit, failure) is DECISIVE)

    @property
    def cause(self) -> Optional[Diagnosis]:
        """Return the deepest cause; None if none is known."""
        return next(iter(self.causes), None)

    @property
    def echoed(self) -> bool:
        """Return whether the line that says why is what one process sees of the death of another."""
        return (self.failure.decisive or "").partition(":")[0].rpartition(".")[2] in MASKS

    def plain(self) -> Dict[str, Any]:
        """Return the document of `explain --json`."""
        return {
            "schema": 1,
            "decisive": self.failure.decisive,
            "phase": self.phase,
            "diagnoses": [_diagnosis(hit, self.failure.phase) for hit in self.diagnoses],
            "findings": [{"check": check, "level": level, "text": text} for check, level, text in self.findings],
        }


def _is_pasted(failure: Failure) -> bool:
    """Return whether a text is a line or two that somebody copied, without the traceback that would decide."""
    return len(failure.text.split("\n", QUOTED)) <= QUOTED and START not in failure.text


def _deepest(hits: Sequence[Diagnosis]) -> Optional[Diagnosis]:
    """Return the deepest cause that hides no other; None where none is known."""
    return next(iter(select_counting(hits, lambda hit: False)), None)


def _diagnosis(hit: Diagnosis, phase: Optional[str]) -> Dict[str, Any]:
    """Return a known cause as all documents hold it.

    Its phase is the given one if the cause can show there, else the cause's first.
    """
    phases = hit.signature.phases
    return matching.diagnosis(hit.signature, phase if not phases or phase in phases else phases[0], hit.seen)


def explain_text(text: str, signatures: Sequence[matching.Signature], here: Facts = NOTHING) -> Explanation:
    """Explain a text that may still contain a terminal's control sequences."""
    failure = read_failure(text, surely=here.failed or here.signal is not None)
    text_hints = hints(failure.text)
    killed = here.signal or failure.signal
    around = _around(here, text_hints, failure)
    sure, could = _candidates(signatures, around, here.python or text_hints.python)
    if is_mention(failure.text) and not (here.failed or here.signal):
        failure = failure._replace(failed=False, decisive=None, lines=())
        sure, could = [], []
    if not failure.failed and len(failure.text.split("\n", QUOTED)) > QUOTED:
        sure, could = [], []  # a log of what went well may mention what is known to fail
    hits, aside = find_hits(sure, failure, killed)
    hits, untied = _divide(hits, failure, around, here)
    if failure.failed or (failure.text.count("\n") < QUOTED and not is_mention(failure.text)):
        derived = derive(failure, text_hints, here.installed, here.python, here.history)
        hits = with_derived(hits, derived, failure)
    if hits and all(hit.generic for hit in hits):
        possible, _ = _divide(find_hits(could, failure, killed)[0], failure, around, here)
        hits = (*_applicable(possible, failure.text), *hits)
    mentions = (MENTION.format(hit.seen, hit.signature.id) for hit in aside[:SHOWN])
    findings: List[Tuple[str, str, str]] = [("besides", NOTE, mention) for mention in mentions]
    if _deepest(hits) is None:
        possible, others = _divide(find_hits(could, failure, killed)[0], failure, around, here)
        spoken = [hit for hit in possible if mentions_packages(hit.signature, failure.text)]
        # Between two broad causes a text without versions cannot decide.
        pasted = [hit for hit in spoken or possible if hit.signature.pattern] if _is_pasted(failure) else []
        if len(spoken) == 1 or 0 < len(pasted) <= LIKELY:
            likely = spoken if len(spoken) == 1 else pasted
            hits = (*likely, *hits)
            findings += [("packages", NOTE, _describe_condition(hit.signature)) for hit in likely]
        else:
            doubtful = spoken or (*possible, *untied, *others)
            findings += [("possible", NOTE, _possible(hit)) for hit in doubtful[:SHOWN]]
    # A known line that somebody only quotes counts as a failure, though no word in it says so.
    if not failure.failed and hits:
        failure = failure._replace(failed=True, decisive=hits[0].seen)
    if TROUBLE.search(failure.decisive or "") and _deepest(hits) is None:
        findings.append(("machine", WARNING, "this machine or its network is at fault, not a package: fix that first"))
    findings += _note_other_failure(failure, hits)
    findings += _note_measurements(failure, hits, here.measured)
    findings += _note_overrides(hits, here.measured)
    return Explanation(failure, text_hints, hits, tuple(findings))


# --- which known failures can be meant -------------------------------------------------------------------------


def _around(here: Facts, text_hints: Hints, failure: Failure) -> Around:
    """Return the packages that the failure met.

    While something is being installed, the packages already there are not the ones that fail.
    """
    hinted = dict(text_hints.packages)
    if here.installed is not None and failure.phase not in INSTALLING:
        return Around(installed=here.installed)
    wanted = {named(text) for text in here.requirements}
    there = {name: version for name, version in (here.installed or {}).items() if name not in wanted}
    pins = ("{}=={}".format(*pair) for pair in {**there, **hinted}.items() if pair[0] not in wanted)
    return Around(requirements=(*here.requirements, *pins))


def _candidates(
    signatures: Iterable[matching.Signature], around: Around, python: Optional[str]
) -> Tuple[List[matching.Signature], List[matching.Signature]]:
    """Return two lists of known failures: those that can be meant, and broad ones that perhaps are.

    A broad one (generic, or without a pattern) can be meant only if all its packages are known to fit; others if
    none is known not to. Where that is unknown for a broad one, it goes into the second list.
    """
    sure: List[matching.Signature] = []
    could: List[matching.Signature] = []
    loud = [one for one in signatures if one.loud and _of_python(one, python)]
    for signature, fits in zip(loud, matching.check_packages(loud, around)):
        broad = signature.generic or signature.pattern is None
        if fits or (fits is None and not broad):
            sure.append(signature)
        elif fits is None:
            could.append(signature)
    return sure, could


def _divide(
    hits: Sequence[Diagnosis], failure: Failure, around: Around, here: Facts
) -> Tuple[Tuple[Diagnosis, ...], Tuple[Diagnosis, ...]]:
    """Return the known failures that something ties to the text, and those whose line anybody may meet.

    A tie is a word of the text, or that the versions at hand are those of the known failure. A known failure of other
    versions than the text names is neither.
    """
    tied: List[Diagnosis] = []
    untied: List[Diagnosis] = []
    look = matching.build_look(around) if hits else None
    for hit in hits:
        fits = bool(hit.signature.packages) and matching.check_packages([hit.signature], around) == [True]
        if fits:
            tied.append(hit)
        elif look is None or not is_refuted(hit.signature, failure.text, look):
            (tied if is_tied(hit.signature, failure.text, here.installed) else untied).append(hit)
    return tuple(tied), tuple(untied)


def _of_python(signature: matching.Signature, python: Optional[str]) -> bool:
    """Return whether a failure is one of this Python, of which the text may tell no more than "3.10"."""
    if not signature.python or python is None:
        return True
    if python.count(".") > 1:
        return specifiers(signature.python).admits(python)
    return not unsatisfiable([specifiers(signature.python), specifiers("=={}.*".format(python))])


def _applicable(possible: Sequence[Diagnosis], text: str) -> List[Diagnosis]:
    """Return the only possible cause whose packages the text names and that a machine can undo; none of several."""
    steps = ("requirements", "environment")
    remedies = [(hit, hit.signature.plain.get("remedy", {})) for hit in possible if not hit.masks]
    likely = [hit for hit, remedy in remedies if any(remedy.get(step) for step in steps)]
    spoken = [hit for hit in likely if hit.signature.packages and mentions_packages(hit.signature, text)]
    return spoken if len(spoken) == 1 else []


def _describe_condition(signature: matching.Signature) -> str:
    parts = [" or ".join("`{}`".format(each) for each in part) for part in signature.packages]
    if not parts:
        return "nothing else in the text points to it"
    return "likely if {} {} installed (the log does not show the version)".format(
        " and ".join(parts), "is" if len(parts) == 1 else "are"
    )


def _possible(hit: Diagnosis) -> str:
    return "could be {}: {} {}".format(
        hit.signature.id, hit.signature.plain["cause"], _describe_condition(hit.signature)
    )


# --- besides ---------------------------------------------------------------------------------------------------


def _note_other_failure(failure: Failure, hits: Sequence[Diagnosis]) -> List[Tuple[str, str, str]]:
    """Return a note on the decisive line if the known cause does not explain it."""
    cause = _deepest(hits)
    if cause is None or not failure.decisive or place_of(cause, failure) is DECISIVE:
        return []
    if any(hit.signature.masks and is_in(hit.seen, failure.decisive) for hit in hits):
        return []
    text = "a later line failed, too, perhaps as a consequence: {}".format(failure.decisive)
    return [("also", NOTE, text)]


def _note_measurements(
    failure: Failure, hits: Sequence[Diagnosis], measured: Optional[Mapping[str, Any]]
) -> List[Tuple[str, str, str]]:
    """Return a note on measured cells with the same cause, or if none is known with the same decisive line.

    Those with the shortest ids are shown, so that the note fits one line.
    """
    cells = (measured or {}).get("cells", ())
    cause = _deepest(hits)
    if cause is not None:
        same = [cell for cell in cells if cause.signature.id in cell.get("causes", ())]
    else:
        shape = _shape(failure.decisive)
        same = [cell for cell in cells if shape and _shape(cell.get("decisive")) == shape]
    if not same:
        return []
    shortest = sorted(same, key=lambda cell: len(cell["id"]))[:SHOWN]
    named = ["{} ({})".format(cell["id"], " ".join(cell.get("requirements", ())[:4])) for cell in shortest]
    more = " and {} more".format(len(same) - SHOWN) if len(same) > SHOWN else ""
    return [("measured", NOTE, shorten_line("measured here, too: " + "; ".join(named) + more))]


def _note_overrides(hits: Sequence[Diagnosis], measured: Optional[Mapping[str, Any]]) -> List[Tuple[str, str, str]]:
    """Return a note on measured cells that work against the requirement that is the conflict."""
    cause = _deepest(hits)
    plain: Mapping[str, Any] = cause.signature.plain if cause else {}
    pairs = [
        pair
        for pair in (measured or {}).get("overrides", ())
        if pair["asker"] == plain.get("asker") and plain.get("id") == "derived:{}".format(pair["package"])
    ]
    if not pairs:
        return []
    pair = pairs[-1]
    text = "measured to work against that requirement: {asker} {version} with {package} {held} ({cell}); uv installs it"
    return [("override", NOTE, (text + " with --override and a file that has `{package}=={held}`").format(**pair))]


def _shape(line: Optional[str]) -> str:
    return CHANGING.sub("…", line or "")
