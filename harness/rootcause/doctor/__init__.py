"""Inspect an environment for `doctor`: in place, its rendering, and changes proven in a copy."""
