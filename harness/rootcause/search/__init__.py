"""Bisection and delta debugging over candidates: pure, what is asked is a callable.

`boundary` finds where a line of candidates turns from good to bad, `minimise` the changes of many that cure. Both step
around candidates that cannot be tested, and ask again where answers may be wrong until they are sure enough.
"""

from harness.rootcause.search.answers import Answer, Asked, Refused, Rules
from harness.rootcause.search.boundaries import Boundary, Progress, Search, Turn, bound, boundary
from harness.rootcause.search.minimal import Minimal, minimise

__all__ = [
    "Answer",
    "Asked",
    "Boundary",
    "Minimal",
    "Progress",
    "Refused",
    "Rules",
    "Search",
    "Turn",
    "bound",
    "boundary",
    "minimise",
]
