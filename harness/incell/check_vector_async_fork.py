"""Drives environments in forked workers."""

from .cell_batch import in_workers

run = in_workers("vector.async.fork", "fork")
