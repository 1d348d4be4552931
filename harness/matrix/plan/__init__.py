"""Multiply a matrix into cells, and plan the one cell that `try` asks for.

Cells share what they have in common (questions, cases, variables), so that ten thousand of them are planned within a
second or two.
"""

from harness.matrix.plan.adapter_choice import brings_models
from harness.matrix.plan.choosing import Ask, choose
from harness.matrix.plan.product import candidates, make_plan
from harness.matrix.plan.sources import Project, Sources
from harness.matrix.plan.strategies import Candidates
from harness.matrix.plan.trial import NAME as TRY_MATRIX
from harness.matrix.plan.trial import TrialOptions, cases_for, single, unspoken

__all__ = [
    "TRY_MATRIX",
    "Ask",
    "Candidates",
    "Project",
    "Sources",
    "TrialOptions",
    "brings_models",
    "candidates",
    "cases_for",
    "choose",
    "make_plan",
    "single",
    "unspoken",
]
