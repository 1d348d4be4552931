"""Drives environments in workers that a server forks."""

from .cell_batch import in_workers

run = in_workers("vector.async.forkserver", "forkserver")
