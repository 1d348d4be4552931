"""Search candidates by bisection and delta debugging. Pure: a callable tests each candidate.

`boundary` finds where a line of candidates turns from good to bad, `minimise` the changes of many that cure. Both step
around candidates that cannot be tested. As answers may be wrong, both repeat tests until they are sure enough.
"""

from harness.rootcause.search.answers import Answer, Observation, Refused, Rules
from harness.rootcause.search.boundaries import Boundary, Progress, Search, Turn, bound, boundary
from harness.rootcause.search.minimal import Minimal, minimise

__all__ = [
    "Answer",
    "Boundary",
    "Minimal",
    "Observation",
    "Progress",
    "Refused",
    "Rules",
    "Search",
    "Turn",
    "bound",
    "boundary",
    "minimise",
]
