"""Repair: find the smallest change that turns a red cell green, and prove it by a rerun."""

__all__ = [
    "candidate_changes", "failure_hints", "lab", "pasting", "proofs", "repair_all", "repair_text", "repairing",
    "times",
]  # fmt: skip
