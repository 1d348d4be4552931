"""Write tables as Markdown, for a terminal, as annotations of GitHub, and pages of a matrix's author."""
