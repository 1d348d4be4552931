"""Drive more environments than this process may use cores, in forked workers."""

from .cell_batch import worker_check

run = worker_check("vector.async.many", "fork")
