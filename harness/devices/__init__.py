"""Tell which device each library draws on, and why: rules of releases as pure functions, and advice."""

__all__ = ["egl_advice", "egl_rules", "gl_inventory"]
