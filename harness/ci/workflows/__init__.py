"""Read workflows of GitHub: the combinations that a matrix claims, and the packages that its steps really install.

Everything is read from the text; nothing is run.
"""

from harness.ci.workflows.legs import Claim, Fate, Leg
from harness.ci.workflows.reading import Job, read

__all__ = ["Claim", "Fate", "Job", "Leg", "read"]
