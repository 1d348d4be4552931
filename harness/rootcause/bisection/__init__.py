"""Bisect: find the release, the day or the Python at which a cell broke, and certify it."""

__all__ = ["behaviour", "bisecting", "candidates", "certificates", "guesses"]
