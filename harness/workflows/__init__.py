"""Workflows of GitHub: the combinations that a matrix claims, and what its steps really install.

Everything is read from the text; nothing is run.
"""

from harness.workflows.legs import Claim, Fate, Leg
from harness.workflows.reading import Job, read

__all__ = ["Claim", "Fate", "Job", "Leg", "read"]
