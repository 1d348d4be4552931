"""Drive environments in forked workers."""

from .cell_batch import worker_check

run = worker_check("vector.async.fork", "fork")
