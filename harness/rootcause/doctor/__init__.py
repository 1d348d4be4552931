"""Inspect an environment for `doctor`: in place, its rendering, and changes proven in a copy."""

__all__ = ["doctor_rendering", "in_place", "prove_in_copy", "upgrade_in_copy"]
