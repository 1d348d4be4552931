"""Checks that compare a case with its own specification. Nothing is raised where one fails: the case misleads."""

from .cell_errors import Skip, summary, violate


def misleading(measure):
    """Make a check of a function that returns a text of the contradiction that it measured, or None.

    Nothing else fails such a check: what it raises, by whose fault ever, shows nothing of the environment.
    """

    def check(probe, facts):
        try:
            text = measure(probe, facts)
        except Skip:
            raise
        except Exception as error:
            reason = "could not be measured: {}".format(summary(error))
            raise Skip(reason) from None
        if text:
            violate("{}", text)

    check.compares = True
    return check
