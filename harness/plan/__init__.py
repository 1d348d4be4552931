"""A matrix multiplied into cells; and the one cell that `try` asks for.

Cells share what they have in common (questions, cases, variables), so that ten thousand of them are planned within a
second or two.
"""

from harness.plan.contents import index_settings
from harness.plan.product import expand
from harness.plan.trial import NAME as TRY_MATRIX
from harness.plan.trial import Asked, cases_for, named_api, single

__all__ = ["TRY_MATRIX", "Asked", "cases_for", "expand", "index_settings", "named_api", "single"]
