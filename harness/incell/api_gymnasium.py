"""The adapter of gymnasium."""

from .cell_family import Family

API = Family("gymnasium")
