"""The same checks as users write them for pytest."""

import importlib

import pytest


@pytest.mark.parametrize("name", ["single", "vector_sync", "vector_async", "render"])
def test_check(name):
    """A check file runs to its end."""
    importlib.import_module("check_" + name)
