"""Inspect an environment (`doctor`): the packages it holds, and the problems in it."""

__all__ = ["differences", "doctor", "environment_choice", "package_findings"]
