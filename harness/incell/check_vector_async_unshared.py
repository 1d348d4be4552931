"""Drive environments in forked workers that share no memory."""

from .cell_batch import worker_check

run = worker_check("vector.async.unshared", "fork", shared_memory=False)
