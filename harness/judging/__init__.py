"""Turn evidence into meaning: pure functions from stored probe runs to outcomes, phases and verdicts."""
