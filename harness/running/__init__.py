"""Run many cells: open a matrix, lock, reuse, schedule, run controls, split into shards, fetch, clean up (`gc`)."""

__all__ = [
    "behaviour_runs",
    "case_run",
    "cleanup",
    "controls",
    "lock_files",
    "open_matrix",
    "own_suites",
    "remedy_trials",
    "resolving",
    "shards",
]
