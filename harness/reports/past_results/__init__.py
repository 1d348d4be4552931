"""Read combinations that were measured before and of which only a table is left, and add them to measured results."""

__all__ = ["collection", "table_files"]
