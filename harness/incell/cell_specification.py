"""Make checks that compare a case with its own specification. Where one fails, the case misleads and raises nothing."""

from .cell_errors import ContractViolation, Skip, observed_error, skip
from .cell_observation import observation


def contradiction(code, **data):
    """Return the contradiction between a misleading check and the specification of its case, as an observation."""
    return observation(code, data)


def compares_with_specification(measure):
    """Make a check of a function that returns the contradiction that it measured, or None.

    Nothing else fails such a check: what it raises, whoever is to blame, shows nothing of the environment.
    """

    def check(probe, facts):
        try:
            measured = measure(probe, facts)
        except Skip:
            raise
        except Exception as error:
            skip("unmeasured.raised", raised=observed_error(error))
        if measured:
            raise ContractViolation(measured)

    check.compares = True
    return check
