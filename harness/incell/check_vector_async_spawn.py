"""Drives environments in workers that are started anew."""

from .cell_batch import in_workers

run = in_workers("vector.async.spawn", "spawn")
