"""Run one probe in a cell: its request, its reply, how it ended. Keep that as evidence; nothing here judges it."""

__all__ = ["array_files", "evidence", "facts", "launch", "measure", "program", "thumbnails", "vault", "wire"]
