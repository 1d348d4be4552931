"""The adapter of gymnasium."""

from .cell_family import Family

PACKAGES = {"gymnasium": "gymnasium"}

API = Family("gymnasium")
