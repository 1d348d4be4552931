"""Find the packages that the environments of a cell really ran, and environment ids that nothing registers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from harness.model import FAILING, CaseRecord, CellRecord, CheckRecord, Phase
from harness.model.report_types import first_few
from harness.model.vocabulary import FAMILY, IMPORT_CHECK

MOST_NAMED = 3
ARGUMENTS = "single.arguments"
ONLY_IMPORT = "only the import was tried"
OWN = "for an environment without an id, name a callable that makes it: --env MODULE:CALLABLE"


def exercised_packages(evidence: CellRecord) -> frozenset[str]:
    """Return the packages that the environments of a cell really ran, as their checks noted."""
    checks = (check for case in evidence.cases for check in _checks(case))
    return frozenset(name for check in checks for name in check.facts.get("exercised", ()))


def idle(evidence: CellRecord) -> tuple[str, ...]:
    """Return the requested packages of which nothing was run; none if no environment came so far."""
    ran = exercised_packages(evidence)
    return tuple(name for name in evidence.cell.asked if name not in ran) if ran else ()


def nothing_of(missed: Iterable[str], evidence: CellRecord) -> str:
    """Return the reason why a cell that passed does not work: something else ran."""
    brought = ((case.env, check.facts.get("environment_of")) for case in evidence.cases for check in _checks(case))
    hint = next((f": {env} is an environment of {package}" for env, package in brought if env and package), "")
    return f"nothing of {' and '.join(missed)} was run{hint}"


def import_fact(case: CaseRecord, name: str) -> Any:
    """Return a fact of the import of a case; None where it has no such fact."""
    checks = (check for check in _checks(case) if check.check == IMPORT_CHECK)
    return next((check.facts[name] for check in checks if name in check.facts), None)


def missing_arguments(evidence: CellRecord) -> str | None:
    """Return in words the arguments that an environment needs and nobody named; None if none is lacking."""
    phases = (phase for case in evidence.cases for phase in case.phases)
    messages = (finding.text for phase in phases for finding in phase.findings if finding.check == ARGUMENTS)
    return next((f"{evidence.cases[0].env} {text}" for text in messages), None)


def unregistered_id(evidence: CellRecord) -> str | None:
    """Return a message about an environment id that nothing registers; None if there is no such id."""
    for case in evidence.cases:
        fact = import_fact(case, "unregistered")
        failed = any(phase.outcome in FAILING for phase in case.phases if phase.phase in {Phase.IMPORT, Phase.SINGLE})
        if isinstance(fact, Mapping) and failed:
            return _message(evidence, case, fact)
    return None


def _message(evidence: CellRecord, case: CaseRecord, fact: Mapping[str, Any]) -> str:
    installed = evidence.installed or {}
    package = case.api.replace("_", "-")
    library = f"{package} {installed[package]}" if package in installed else case.api
    searched = [str(name) for name in fact.get("searched", ())]
    looked = first_few(searched, MOST_NAMED)
    more = f", nor does what was imported to look for it ({looked})" if searched else ""
    nearest = [str(name) for name in fact.get("nearest", ())]
    hint = f"; did you mean {' or '.join(nearest)}?" if nearest else f"; {OWN}"
    verb = "registers no such environment" if case.api in FAMILY else "has no such environment"
    return f"--env {case.env}: {library} {verb}{more}{hint}"


def _checks(case: CaseRecord) -> Iterable[CheckRecord]:
    return (check for phase in case.phases for check in phase.checks)
