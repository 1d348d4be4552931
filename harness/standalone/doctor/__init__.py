"""Inspect an environment (`doctor`): the packages it holds, and the problems in it."""
