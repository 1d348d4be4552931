"""Find and read the known failures that come with the harness, and the known issues in words."""

__all__ = ["issue_texts", "shipped_signatures", "signature_files"]
