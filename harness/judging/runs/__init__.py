"""Judge the probe runs of a case: how each check ended, what they come to, and which run is needed next."""

__all__ = ["case", "check", "fold", "misleading", "suite", "todo"]
