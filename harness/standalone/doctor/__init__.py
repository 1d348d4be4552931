"""Inspect an environment (`doctor`): the packages it holds, and the problems in it."""

__all__ = ["choosing", "declared", "differences", "doctor"]
