"""Draft a first matrix for a project: from its metadata, or from the packages that its workflow installs.

Everything is read from texts; `templates/matrix.toml.j2` makes a file of a draft.
"""

from harness.ci.drafts.draft import Draft, Range, of_project, text_of
from harness.ci.drafts.layout import matrix_folder
from harness.ci.drafts.project import Case, Project, environment_ids
from harness.ci.drafts.project import read as read_project
from harness.ci.drafts.suite import SuiteDraft, draft_suite, runtime
from harness.ci.drafts.workflow import of_legs

__all__ = [
    "Case", "Draft", "Project", "Range", "SuiteDraft", "candidates", "draft_suite", "environment_ids",
    "matrix_folder", "of_legs", "of_project", "read_project", "runtime", "text_of", "values",
]  # fmt: skip
