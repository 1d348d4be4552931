"""Explain a failure from its log (`explain`): its cause, and what to do."""

__all__ = ["api_history", "explain", "explanation_text", "import_names", "missing_releases"]
