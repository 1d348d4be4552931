"""Run many cells: open a matrix, lock, reuse, schedule, run controls, split into shards, collect offline bundles."""
