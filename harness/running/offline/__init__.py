"""Collect what cells need into a folder, and run them from it without a network."""

__all__ = ["offline_bundle", "offline_collect"]
