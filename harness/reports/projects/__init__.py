"""Judge the packages of a project from measured results: `check` as they stand, `upgrade` with other releases.

A project is requirement files, or an environment at hand. Nothing is installed and nothing is run.
"""

__all__ = [
    "check_document",
    "checked",
    "checked_text",
    "labelled_lines",
    "project",
    "tried_task",
    "unknown_names",
    "upgrade_document",
    "upgraded",
    "upgraded_text",
]
