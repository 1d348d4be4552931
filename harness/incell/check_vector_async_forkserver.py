"""Drive environments in workers that a server forks."""

from .cell_batch import worker_check

run = worker_check("vector.async.forkserver", "forkserver")
