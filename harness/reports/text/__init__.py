"""Write tables as Markdown, for a terminal, as annotations of GitHub, and pages of a matrix's author."""

__all__ = [
    "author_pages",
    "cause_markdown",
    "family_markdown",
    "github_annotations",
    "markdown_texts",
    "platforms",
    "progress",
    "report_markdown",
    "terminal",
    "try_answer",
]
