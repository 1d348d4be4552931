"""Repair: find the smallest change that turns a red cell green, and prove it by a rerun."""

__all__ = ["candidate_changes", "every", "failure_hints", "lab", "pasting", "proofs", "repairing", "telling", "times"]
