"""Run the matrix as a pytest suite: `pytest --pyargs harness.smoke --matrix NAME`."""

from __future__ import annotations

SUITE = "harness.smoke"
PLUGIN = "harness.smoke.plugin"
"""The module whose fixtures are ours."""
