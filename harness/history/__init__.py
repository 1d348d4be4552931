"""Derive from the files of every release of a package what it offers: modules, names, signatures, requirements."""

__all__ = ["api_history"]
