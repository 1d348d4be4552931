"""Drive environments in workers that are started anew."""

from .cell_batch import worker_check

run = worker_check("vector.async.spawn", "spawn")
