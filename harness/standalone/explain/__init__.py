"""Explain a failure from its log (`explain`): its cause, and what to do."""

__all__ = [
    "api_history",
    "explain",
    "explanation_text",
    "failure_text",
    "history_words",
    "import_names",
    "version_hints",
]
