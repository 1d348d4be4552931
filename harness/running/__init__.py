"""Run many cells: open a matrix, lock, reuse, schedule, run controls, split into shards, collect offline bundles."""

__all__ = [
    "case_run",
    "cleanup",
    "controls",
    "issue_texts",
    "lock_files",
    "offline_bundle",
    "offline_collect",
    "open_matrix",
    "own_suites",
    "remedy_trials",
    "resolving",
    "shards",
    "shipped_signatures",
    "signature_files",
]
