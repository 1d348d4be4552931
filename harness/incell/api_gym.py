"""The adapter of gym."""

from .cell_family import Family

API = Family("gym")
