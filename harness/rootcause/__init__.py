"""Find by experiment why a cell fails: cells measured one after another, each chosen by the results before it."""

__all__ = ["bench", "search_documents"]
