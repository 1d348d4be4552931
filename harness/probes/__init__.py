"""Run one probe in a cell and keep its evidence; nothing here judges what a probe showed."""

__all__ = ["array_files", "evidence", "facts", "launch", "measure", "program", "vault", "wire"]
