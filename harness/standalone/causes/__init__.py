"""Derive the cause of a failure: from histories of releases, tables of files, and what a line says itself."""

__all__ = ["derived_causes"]
