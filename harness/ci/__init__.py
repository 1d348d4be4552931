"""Write CI files for a matrix, read somebody's workflow, and draft a first matrix for a project."""

__all__ = ["first_draft", "pipelines"]
