"""Sees whether a robot pushes what it meets."""

from .cell_contact import contact as run

__all__ = ["run"]
