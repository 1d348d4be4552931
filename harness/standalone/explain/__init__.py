"""Explain a failure from its log (`explain`): its cause, and what to do."""

__all__ = ["explain", "explanation_text"]
