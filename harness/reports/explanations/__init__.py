"""Make what `explain` starts from, an index of known failures and measured results, and define its document."""

__all__ = ["explain_index"]
