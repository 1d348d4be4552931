"""Compare the pictures that cells left: read them from evidence, add them to a document, and write what differs."""

__all__ = ["boundaries", "picture_markdown", "stored_pictures"]
