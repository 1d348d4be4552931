"""Compare the pictures that cells left: read them from evidence, add them to a document, and write what differs."""

__all__ = ["boundaries", "first_pictures", "picture_markdown", "stored_pictures"]
