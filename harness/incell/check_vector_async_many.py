"""Drives more environments than this process may use cores, in forked workers."""

from .cell_batch import in_workers

run = in_workers("vector.async.many", "fork")
