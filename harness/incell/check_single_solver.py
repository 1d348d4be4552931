"""Compares what the sparse and the dense Jacobian give."""

from .cell_solver import solver as run

__all__ = ["run"]
