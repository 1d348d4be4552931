"""Drives environments in forked workers that share no memory."""

from .cell_batch import in_workers

run = in_workers("vector.async.unshared", "fork", shared_memory=False)
