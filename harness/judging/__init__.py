"""Turn evidence into meaning: pure functions from stored probe runs to outcomes, phases and verdicts."""

__all__ = [
    "assess",
    "assessed_case",
    "counted_phases",
    "exercised",
    "expectation",
    "failure_texts",
    "identity",
    "known_failures",
    "known_issues",
]
