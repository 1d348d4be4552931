"""Checks that compare a case with its own specification. Nothing is raised where one fails: the case misleads."""

from .cell_errors import ContractViolation, Skip, raised, skip
from .cell_observed import observation


def contradiction(code, **data):
    """Return the contradiction between a misleading check and the specification of its case, as an observation."""
    return observation(code, data)


def misleading(measure):
    """Make a check of a function that returns the contradiction that it measured, or None.

    Nothing else fails such a check: what it raises, by whose fault ever, shows nothing of the environment.
    """

    def check(probe, facts):
        try:
            found = measure(probe, facts)
        except Skip:
            raise
        except Exception as error:
            skip("unmeasured.raised", raised=raised(error))
        if found:
            raise ContractViolation(found)

    check.compares = True
    return check
