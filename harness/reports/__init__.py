"""Make documents of assessed cells, and all that is shown of them: tables, texts, recommendations, packs."""

__all__ = [
    "doctor_pyz",
    "document",
    "expectation_writer",
    "judge_again",
    "merging",
    "packs",
    "publishing",
    "readme_blocks",
    "size_plot",
    "template_files",
]
