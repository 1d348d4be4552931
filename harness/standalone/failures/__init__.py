"""Match known failures against texts: find the line that says why, say which failure counts, and word its remedy."""

__all__ = ["counting", "lines", "literals", "machine_trouble", "matching", "remedies", "silent", "ties"]
